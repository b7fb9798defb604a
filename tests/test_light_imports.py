"""What need not be loaded is not loaded: a help text, the version, completion, and commands without a net.

Nor does a check, a diagnosis or a fit without a net need more than the core. Laws about modules, not about seconds:
torch, cvxpy, MuJoCo and the like take seconds of processor time to load.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ident.process import EXTRA_OF
from ident.robot.names import data_path

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


def test_a_missing_extra_ends_in_one_line_that_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"")
    script = (
        CORE_ONLY
        + "import sys\nfrom ident.cli.start import main\nsys.argv = "
        + repr(["ident", "inspect", str(tmp_path / "run.mcap"), "--robot", "tm5-900"])
    )
    done = subprocess.run([sys.executable, "-c", script + "\nmain()"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert 'pip install "armgap[bags]"' in done.stderr


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
