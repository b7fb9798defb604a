"""xacro files: expanded by the package of the same name."""

from __future__ import annotations

from pathlib import Path

from ident.errors import RobotError

SUFFIX = ".xacro"


def expand(path: Path) -> str:
    """The URDF text of a xacro file, its arguments at their defaults. The expressions in it are evaluated.

    Raises:
        RobotError: It can't be expanded: damaged, an argument without a default, a package that is not installed.
    """
    import xacro

    try:
        return str(xacro.process_file(str(path)).toxml())
    except Exception as error:  # the XML parser, the expressions and the search for packages each raise their own
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise RobotError(
            path, f"can't be expanded ({reason})", f"expand it where its packages are: xacro {path.name} > arm.urdf"
        ) from None
