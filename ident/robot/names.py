"""Robots by name, and the files that are shipped."""

from __future__ import annotations

import difflib
import importlib
import importlib.metadata
import importlib.util
import shlex
import sys
import tomllib
from functools import cache
from pathlib import Path

from ident.errors import RobotError, first_line

ROBOTS = tomllib.loads(Path(__file__).with_name("robots.toml").read_text(encoding="utf-8"))
SHIPPED_ROBOTS: dict[str, str] = ROBOTS["shipped"]
EXAMPLE_ROBOTS: dict[str, str] = ROBOTS["examples"]
# Names of the package robot_descriptions end so; each is a module that knows the path of a URDF or
# of a xacro file.
DESCRIPTION = "_description"


def data_path(relative: str) -> Path:
    """A file or folder shipped with armgap: inside the installed package, else in the
    source tree.
    """
    here = Path(__file__).resolve().parents[1]
    packaged = here / "_data" / relative
    return packaged if packaged.exists() else here.parent / relative


def example_robots_folder() -> Path:
    """Where example-robot-data's wheel (data only, no module) puts its robots; without it a folder
    that isn't there.
    """
    relative = "cmeel.prefix/share/example-robot-data/robots"
    for wheel in importlib.metadata.distributions(name="example-robot-data"):
        return Path(str(wheel.locate_file(relative)))
    return Path(sys.prefix, relative)


def named_files() -> dict[str, Path]:
    """The URDFs of the names in robots.toml by these names, whether or not they are installed."""
    folder = example_robots_folder()
    shipped = {name: data_path(path) for name, path in SHIPPED_ROBOTS.items()}
    return shipped | {name: folder / path for name, path in EXAMPLE_ROBOTS.items()}


@cache
def example_files() -> dict[str, Path]:
    """Every URDF of example-robot-data by the name of its file; a name that two folders have is
    left out.
    """
    files: dict[str, list[Path]] = {}
    for path in sorted(example_robots_folder().rglob("*.urdf")):
        files.setdefault(path.stem, []).append(path)
    return {name: paths[0] for name, paths in files.items() if len(paths) == 1}


def robot_names() -> list[str]:
    """The names that `--robot` takes beside a URDF path, but for example-robot-data's further
    files.
    """
    return [*SHIPPED_ROBOTS, *EXAMPLE_ROBOTS]


def split_tip(robot: str | Path) -> tuple[str, str]:
    """A robot and the last joint of the arm that is meant: `baxter:left_w2`; no joint where none is
    named.

    Args:
        robot: A name or a path, with ":JOINT" behind it or not; a file of that name has no joint.

    Returns:
        The robot and the joint; "" for none.
    """
    name, colon, tip = str(robot).rpartition(":")
    named = bool(colon and name and tip) and "/" not in tip and not Path(robot).is_file()
    return (name, tip) if named else (str(robot), "")


def find_urdf(robot: str | Path) -> Path:
    """The URDF (or xacro) file of a path or name, whichever arm of it is meant.

    Raises:
        RobotError: Neither a file nor a known name.
        ModuleNotFoundError: A name of example-robot-data, which is not installed.
    """
    name, _ = split_tip(robot)
    named = named_files()
    if known := named.get(name) or named.get(name.replace("_", "-")):
        if not known.is_file():
            raise ModuleNotFoundError(f"no {known}", name="example_robot_data")
        return known
    path = Path(name)
    if path.is_file():
        return path
    if name in example_files():
        return example_files()[name]
    if is_fetched(name):
        return _described(name)
    near = difflib.get_close_matches(name, example_files(), n=3)
    also = f", {', '.join(near)}" if near else "; or a file's name of example-robot-data"
    remedy = f"give a URDF path or one of: {', '.join(robot_names())}{also}"
    raise RobotError(name, "no such URDF file or robot", remedy)


def is_fetched(robot: str | Path) -> bool:
    """Whether it is a name of robot_descriptions, whose modules download and are run: for a user to
    say, not a file.
    """
    name, _ = split_tip(robot)
    known = Path(name).is_file() or name in example_files()
    return name.endswith(DESCRIPTION) and name.isidentifier() and not known


def _described(name: str) -> Path:
    """The file that a module of robot_descriptions names; its first import may download the
    robot.
    """
    if importlib.util.find_spec("robot_descriptions") is None:
        raise RobotError(
            name,
            "the package robot_descriptions is not installed",
            "pip install robot_descriptions",
        )
    try:
        module = importlib.import_module(f"robot_descriptions.{name}")
    except ModuleNotFoundError as error:
        if error.name != f"robot_descriptions.{name}":
            lacks = f"robot_descriptions lacks a package that it needs ({error.name})"
            raise RobotError(name, lacks, "pip install robot_descriptions") from None
        raise RobotError(
            name, "robot_descriptions has no such robot", "see its list of names"
        ) from None
    except Exception as error:  # git and the network have their own
        raise RobotError(
            name, f"robot_descriptions can't fetch it ({first_line(error)})", "give a URDF path"
        ) from None
    path = getattr(module, "URDF_PATH", None) or getattr(module, "XACRO_PATH", None)
    if path is None:
        raise RobotError(name, "robot_descriptions has it as MJCF only", "give a URDF path")
    return Path(path)


def robot_argument(name: str, source: Path | None, tip: str = "") -> str:
    """What `--robot` takes for an arm, quoted for a shell: its name or its URDF's path, and its
    last joint if given.

    Args:
        name: The arm's.
        source: Its URDF; None if it is of no file.
        tip: Name of its last joint; "" for none.
    """
    known = next((known_name for known_name, path in named_files().items() if path == source), None)
    robot = known or (name if source is None else str(source))
    return shlex.quote(f"{robot}:{tip}" if tip else robot)
