PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# The stamp is newer than the lock file once everything in it is installed.
STAMP := $(VENV)/.installed

.PHONY: run test slow lint types docs fuzz wheel clean install

run: install
	$(BIN)/ident demo --out out/demo

# Two workers on two cores: threads of their own would only wait for each other.
test: lint types
	$(BIN)/lint-imports
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 -m "not slow"

# What takes a minute or more, a test: once a week, and before a release.
slow: install
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 -m slow

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: install
	$(BIN)/mypy

# The documentation's site, with the references made from the code; a warning is an error.
docs: install
	$(BIN)/python docs/write.py
	$(BIN)/python docs/draw_flow.py
	$(BIN)/mkdocs build --quiet --config-file .ci/mkdocs.yml

# Spoilt files into every reader. More than a minute: make fuzz SECONDS=36000; the same again: SEED=…
SECONDS ?= 60
fuzz: install
	$(BIN)/python -m tests.fuzz.run --seconds $(SECONDS) $(if $(SEED),--seed $(SEED))

# The package with its arm and recordings, in dist/.
wheel: install
	$(BIN)/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .
	ls dist/*.whl

install: $(STAMP)

# CPU torch first: any later requirement on torch is then met, and no CUDA package is fetched.
$(STAMP): requirements.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet torch==2.13.0
	$(BIN)/pip install --quiet -r requirements.lock
	$(BIN)/pip install --quiet --no-deps --no-build-isolation -e .
	touch $@

clean:
	rm -rf $(VENV) out build dist
