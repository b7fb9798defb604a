"""What is loaded, and what must be installed: no command loads anything heavy without need; extras hold the rest."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from ident.process import EXTRA_OF, missing_extra
from ident.robot.names import data_path
from tests.house.sources import ROOT, Source, read_sources

HEAVY = (
    "torch",
    "cvxpy",
    "mujoco",
    "pinocchio",
    "coal",
    "casadi",
    "sklearn",
    "scipy",
    "numba",
    "matplotlib",
    "rerun",
    "pyarrow",
    "rosbags",
    "pandas",
    "distributed",
    "numpy",
)
# Of the extras' packages those that no package of the core brings along.
BEYOND_CORE = sorted({*EXTRA_OF} - {"coal", "joblib", "llvmlite", "pydantic", "typing_extensions"})
CORE_ONLY = f"""
import sys
class Missing:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in {BEYOND_CORE!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
"""
RUN = """
import sys
from {package}.cli.app import main
sys.argv = {arguments!r}
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print("loaded:", *(name for name in {heavy!r} if name in sys.modules))
"""
E1 = Path(data_path("logs/tm5_900")) / "E1"


def loaded(script: str, **environment: str) -> set[str]:
    """The heavy modules that a script ends up with, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env={**os.environ, **environment}
    )
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("loaded:"))
    return set(line.split()[1:])


def loaded_by(*arguments: object, **environment: str) -> set[str]:
    """The same of a command, where no extra is installed."""
    package, *rest = map(str, arguments)
    return loaded(CORE_ONLY + RUN.format(package=package, arguments=[package, *rest], heavy=HEAVY), **environment)


@pytest.mark.parametrize("package", ["ident", "plan"])
@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("{first}", "--help")])
def test_help_and_version_load_nothing_heavy(package: str, arguments: tuple[str, ...]) -> None:
    first = {"ident": "diagnose", "plan": "solve"}[package]
    assert loaded_by(package, *(part.format(first=first) for part in arguments)) == set()


@pytest.mark.parametrize("package", ["ident", "plan"])
def test_packages_load_nothing_heavy(package: str) -> None:
    assert loaded(f"import sys, {package}\nprint('loaded:', *(n for n in {HEAVY!r} if n in sys.modules))") == set()


def test_a_diagnosis_of_nominal_inertias_loads_neither_torch_nor_pictures(tmp_path: Path) -> None:
    """One run is too little for a verdict, but goes through the same door."""
    diagnose = ("ident", "diagnose", E1 / "01_trajectory_1.parquet", "--robot", "tm5-900", "--json")
    found = loaded_by(*diagnose, tmp_path / "why.json")
    assert not found & {"torch", "mujoco", "matplotlib", "rerun", "sklearn", "pandas"}


def test_a_diagnosis_loads_no_part_of_scipy_that_takes_a_second() -> None:
    """Nor what learns trees, until something stands out that they may learn."""
    slow = ("scipy.signal", "scipy.stats", "scipy.integrate", "sklearn", "pandas")
    script = "import sys, ident.api.diagnosing, ident.show.terminal\n"
    script += f"print('loaded:', *(n for n in {slow!r} if n in sys.modules))"
    assert loaded(script) == set()


def test_a_fit_without_a_net_loads_neither_torch_nor_pictures(tmp_path: Path) -> None:
    """Of solvers CVXPY is loaded, and SciPy with it."""
    fit = ("ident", "fit", E1, "--robot", "tm5-900", "--net", "none", "--out")
    heavy = {"torch", "mujoco", "sklearn", "rosbags", "matplotlib", "rerun", "pandas"}
    assert not loaded_by(*fit, tmp_path / "model") & heavy


@pytest.mark.parametrize(
    ("command", "extra"),
    [(("inspect", "run.mcap"), "bags"), (("fit", "nothing_there", "--out", "model"), "net")],
    ids=["inspect", "fit"],
)
def test_a_missing_extra_ends_in_one_line_that_says_what_to_install(
    command: tuple[str, ...], extra: str, tmp_path: Path
) -> None:
    """Law: before the work that needs it is begun; a net's, before any recording is read."""
    (tmp_path / "run.mcap").write_bytes(b"")
    arguments = ["ident", *command, "--robot", "tm5-900"]
    script = f"{CORE_ONLY}import sys\nfrom ident.cli.start import main\nsys.argv = {arguments!r}\nmain()"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f'pip install "armgap[{extra}]"' in done.stderr


def test_a_slip_in_a_scene_file_is_told_before_anything_heavy_is_loaded(tmp_path: Path) -> None:
    """A wrong key costs no compiler, no solver and no net."""
    scene = tmp_path / "scene.toml"
    scene.write_text('robot = "tm5-900"\n[task]\nstart = [0, 0, 0]\n')
    script = RUN.replace("    assert not end.code, end.code\n", "    assert end.code == 2, end.code\n")
    found = loaded(script.format(package="plan", arguments=["plan", "solve", str(scene)], heavy=HEAVY))
    assert not found & {"torch", "numba", "scipy", "cvxpy", "matplotlib", "pyarrow", "sklearn"}


@pytest.mark.parametrize("package", ["ident", "plan"])
def test_completion_loads_nothing_heavy(package: str) -> None:
    asked = {f"_{package.upper()}_COMPLETE": "complete_bash", "COMP_WORDS": f"{package} ", "COMP_CWORD": "1"}
    assert loaded_by(package, **asked) == set()


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
KNOWN = packages_distributions()
# Packages whose name is not the one they are installed by, where no metadata says so.
INSTALLED_AS = {
    "pinocchio": "pin",
    "yaml": "pyyaml",
    "rerun": "rerun-sdk",
    "mujoco": "mujoco",
    "backports": "backports.zstd",
    "pxr": "usd-core",
}
# Asked for by name where the user has them: neither is ours to install.
OPTIONAL = {"ompl", "robot_descriptions"}


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[\[<>=~! ]", one)[0].lower().replace("_", "-") for one in requirements}


def outside(source: Source) -> set[str]:
    """Top names of other people's packages that a module imports; what only type checkers read is left out."""
    skipped = {
        inner
        for node in ast.walk(source.tree)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
        for line in node.body
        for inner in ast.walk(line)
    }
    found = set()
    for node in ast.walk(source.tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").partition(".")[0])
    return found - {"ident", "plan"} - set(sys.stdlib_module_names)


def distribution(package: str) -> str:
    return INSTALLED_AS.get(package, KNOWN.get(package, [package])[0]).lower().replace("_", "-")


def test_everything_used_is_declared_in_the_core_or_in_the_extra_that_its_message_names() -> None:
    used = set().union(*map(outside, read_sources(ROOT))) - OPTIONAL
    core = names(PROJECT["dependencies"])
    undeclared = {
        package
        for package in used
        if distribution(package) not in (names(EXTRAS[EXTRA_OF[package]]) if package in EXTRA_OF else core)
    }
    assert not undeclared


def test_the_core_holds_nothing_that_an_extra_holds_and_all_holds_every_extra() -> None:
    groups = {*EXTRA_OF.values()}
    assert not {one for group in groups for one in names(EXTRAS[group])} & names(PROJECT["dependencies"])
    assert groups == {*re.findall(r"\w+", EXTRAS["all"][0].partition("[")[2])}


def test_another_missing_module_is_our_own_fault() -> None:
    assert missing_extra(ModuleNotFoundError("No module named 'ident.nothing'", name="ident.nothing")) is None
    assert missing_extra(ValueError("torch")) is None


def test_the_lock_file_holds_every_dependency() -> None:
    locked = names(Path(ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines())
    declared = names(PROJECT["dependencies"]).union(*(names(EXTRAS[group]) for group in [*EXTRA_OF.values(), "dev"]))
    assert declared - locked == set()
