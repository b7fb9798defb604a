"""A Python module with the named effects' torque that needs NumPy only.

Its first part is the text of `ident.export.standalone` and of the friction laws that models carry, its second the
numbers of arm and effects, its third what a user calls.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ident import laws
from ident.effects import base
from ident.errors import InputError
from ident.export.identified import IdentifiedArm, in_module
from ident.export.templates import fill
from ident.laws.acting import KNOWN
from ident.laws.carried import COLUMNS
from ident.laws.motion import Arm, Array, Losses
from ident.robot.arm import ArmModel

# Files of `ident.laws` in their order.
PARTS = ("motion", "friction", "elastic", "acting")


def describe_arm(arm: ArmModel) -> Arm:
    """The arm's chain in plain arrays."""
    chain = arm.chain
    return Arm(
        rotations=chain.rotations[:, 0],
        offsets=chain.offsets,
        axes=chain.axes,
        sliding=chain.sliding,
        links=arm.inertial_parameters.reshape(arm.n, 10),
        gravity=chain.gravity,
        gears=None if arm.gear_ratios is None else np.array(arm.gear_ratios),
        rated=np.array(arm.effort_limit),
    )


# What a file beside the module holds, of which the module says what is missing: indices of the effects that it has, its
# losses, and its links, ten numbers each, where they are others than the module's own, else None.
InFile = tuple[list[int], Losses, Array | None]


def write_module(identified: IdentifiedArm, files: Mapping[str, InFile]) -> str:
    """The module's text: the tuned arm without the effects, its losses, and the effects whose law is known."""
    arm, losses, effects = identified.tuned, identified.losses, in_module(identified.changes)
    kinds = [change.kind for change in identified.changes if change.has_law and change.kind is not None]
    own = {kind.id: kind for kind in kinds if kind.id not in KNOWN}
    named = ", ".join(f"{name!r}: {name}" for name in COLUMNS)
    more = [inspect.getsource(one).strip() for one in COLUMNS.values() if one.__module__.split(".")[-1] not in PARTS]
    columns = [*more, f"COLUMNS = {{{named}}}"]
    parts = [*map(_body, PARTS[:-1]), *columns, _body(PARTS[-1]), *map(_own_law, own.values())]
    held = ", ".join(f"{name!r}: {_call('Losses', one[1])}" for name, one in files.items())
    shared = {name: one[0] for name, one in files.items()}
    links = ", ".join(f"{name!r}: {_plain(one[2])}" for name, one in files.items())
    numbers = [
        # Names come from files: as literals they stay text, whatever stands in them.
        f"ROBOT = {arm.name!a}",
        f"JOINTS = {tuple(arm.joint_names)!a}",
        f"ARM = {_call('Arm', describe_arm(arm))}",
        f"# Tuned together with the effects.\nLOSSES = {_call('Losses', losses)}",
        "EFFECTS = [\n" + "".join(f"    {effect!a},\n" for effect in effects) + "]",
        f"# Which of them the files express.\nIN_FILE = {shared!r}",
        f"FILE_LOSSES = {{{held}}}",
        f"# Links of the files, where they are others than those of ARM.\nFILE_LINKS = {{{links}}}",
    ]
    return fill("torque_model.py.txt", {"LAWS": "\n\n\n".join(parts), "NUMBERS": "\n".join(numbers)})


def _body(part: str) -> str:
    """A file's text after its docstring and imports."""
    text = (Path(laws.__file__).parent / f"{part}.py").read_text(encoding="utf-8")
    kept = [node for node in ast.parse(text).body if not isinstance(node, (ast.Import, ast.ImportFrom))]
    last = max(node.end_lineno or 0 for node in ast.parse(text).body if isinstance(node, (ast.Import, ast.ImportFrom)))
    assert isinstance(kept[0], ast.Expr), "a part begins with its docstring"
    return "\n".join(text.splitlines()[last:]).strip("\n")


def _own_law(kind: base.Effect) -> str:
    """The text of a law that an effect's class gives, under its id.

    Raises:
        InputError: It is no function whose text can be had.
    """
    where = f"law of {type(kind).__name__}"
    try:
        assert kind.law is not None
        found = ast.parse(textwrap.dedent(inspect.getsource(kind.law))).body[0]
    except (OSError, TypeError, SyntaxError) as error:
        raise InputError(where, f"its text can't be read ({error})", "write it as a static method (m, j, p)") from error
    if not isinstance(found, ast.FunctionDef):
        raise InputError(where, "it is no function", "write it as a static method (m, j, p)")
    found.name, found.decorator_list = f"law_of_{kind.id}", []
    return f"{ast.unparse(found)}\n\n\nLAWS[{kind.id!r}] = {found.name}"


def _call(name: str, value: Arm | Losses) -> str:
    """A constructor's call with plain lists."""
    fields = [f"{key}={_plain(item)}" for key, item in vars(value).items()]
    return f"{name}(\n    " + ",\n    ".join(fields) + ",\n)"


def _plain(item: Array | None) -> str:
    return "None" if item is None else repr(np.asarray(item).tolist())
