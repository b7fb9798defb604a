"""A Python module with the named effects' torque that needs NumPy only.

Its first part is the text of `ident.export.standalone` and of the friction laws that models carry, its second the
numbers of arm and effects, its third what a user calls.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident import laws
from ident.arrays import Float
from ident.effects import base
from ident.errors import InputError
from ident.laws.acting import KNOWN
from ident.laws.chain import Arm, Array
from ident.laws.motion import Losses
from ident.laws.sensing import Effect
from ident.laws.table import COLUMNS
from ident.robot.arm import ArmModel

# Files of `ident.laws` in their order.
PARTS = ("chain", "motion", "sensing", "friction", "bodies", "elastic", "acting")
HEADER = '''"""Torque that the named effects add to a model of the robot called ROBOT. NumPy only.

extra_torque(q, dq, ddq, interval)      what the log reads beyond `modelled_torque`
missing_torque("urdf", q, dq, ddq, …)   what the motors deliver beyond the model in robot.urdf ("mjcf": robot.xml)
log_of_torque(tau, interval)       what the log reads of a joint torque
torque_of_log(log, interval)       joint torque behind a log

Arrays are (T, n), joints in the order of JOINTS, SI units; one state may be given as (n,). A torque is what the motor
must deliver: a simulator applies it with the sign reversed (MuJoCo: data.qfrc_applied[:] = -missing_torque("mjcf", …)).
`interval` is the sampling interval of an even run; laws with a memory need it, dry friction that turns round over a
displacement too. `slip` is the direction of sliding in [-1, 1], where it is known better than from the run; single
states take tanh(dq / v0). `warmth` goes from 0 (cold) to 1 (as warm as the diagnosed session became), (T, n) where
joints differ.

Written by `ident patch`; patch.json beside this file says what the figures leave open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np
'''
CALLS = '''
def _motion(q, dq, ddq, interval, slip, warmth):
    states = (np.atleast_2d(np.asarray(values, dtype=float)) for values in (q, dq, ddq))
    return MovingArm(ARM, LOSSES, *states, interval, None if slip is None else np.atleast_2d(slip), warmth)


def modelled_torque(q, dq, ddq, interval=0.0, slip=None):
    """Rigid torque and losses of the tuned arm, without the effects [N m]."""
    motion = _motion(q, dq, ddq, interval, slip, 0.5)
    return (motion.rigid + LOSSES.torque(motion.dq, motion.ddq, motion.direction)).reshape(np.shape(q))


def extra_torque(q, dq, ddq, interval=0.0, slip=None, warmth=0.5):
    """What the log reads beyond `modelled_torque`, all effects together [N m]."""
    motion = _motion(q, dq, ddq, interval, slip, warmth)
    model = motion.rigid + LOSSES.torque(motion.dq, motion.ddq, motion.direction)
    log = read_log(EFFECTS, model + acting_torque(EFFECTS, motion), interval)
    return (log - model).reshape(np.shape(q))


def missing_torque(file, q, dq, ddq, interval=0.0, slip=None, warmth=0.5):
    """What the motors deliver beyond the model of a file, "urdf" or "mjcf" [N m].

    The effects that the file has no words for, and the difference between the losses and links that go with them and
    those that are in the file.
    """
    motion = _motion(q, dq, ddq, interval, slip, warmth)
    outside = [effect for k, effect in enumerate(EFFECTS) if k not in IN_FILE[file]]
    torque = acting_torque(outside, motion) + LOSSES.torque(motion.dq, motion.ddq, motion.direction)
    torque -= FILE_LOSSES[file].torque(motion.dq, motion.ddq, motion.direction)
    if FILE_LINKS[file] is not None:
        torque += motion.rigid - rigid_torque(ARM, motion.q, motion.dq, motion.ddq, links=np.array(FILE_LINKS[file]))
    return torque.reshape(np.shape(q))


def log_of_torque(torque, interval=0.0):
    """What the log reads of a joint torque: the named gain, offset, delay and flat tops [N m]."""
    return read_log(EFFECTS, np.atleast_2d(torque), interval).reshape(np.shape(torque))


def torque_of_log(log, interval=0.0):
    """Joint torque behind a log [N m]."""
    return undo_log(EFFECTS, np.atleast_2d(log), interval).reshape(np.shape(log))
'''


def describe_arm(arm: ArmModel) -> Arm:
    """The arm's chain in plain arrays."""
    rotations, offsets, axes, sliding, gravity = arm.chain
    return Arm(
        rotations=rotations,
        offsets=offsets,
        axes=axes,
        sliding=sliding,
        links=arm.inertial_parameters.reshape(arm.n, 10),
        gravity=gravity,
        gears=None if arm.gear_ratios is None else np.array(arm.gear_ratios),
        rated=np.array(arm.effort_limit),
    )


@dataclass(frozen=True, eq=False)
class InFile:
    """What a file beside the module holds, of which the module says what is missing.

    Attributes:
        effects: Indices of the effects that it has.
        losses: Its losses.
        links: Ten numbers a link, where they are others than the module's own, else None.
    """

    effects: Sequence[int]
    losses: Losses
    links: Float[Array, "n 10"] | None = None


def write_module(
    arm: ArmModel,
    losses: Losses,
    effects: Sequence[Effect],
    files: Mapping[str, InFile],
    kinds: Sequence[base.Effect] = (),
) -> str:
    """The module's text.

    Args:
        arm: The tuned arm, without the effects.
        losses: Its losses, tuned together with the effects.
        effects: The effects whose law is known.
        files: What `urdf` and `mjcf` hold.
        kinds: The effects themselves: those outside the catalogue bring their law along.
    """
    own = {kind.id: kind for kind in kinds if kind.id not in KNOWN}
    named = ", ".join(f"{name!r}: {name}" for name in COLUMNS)
    more = [inspect.getsource(one).strip() for one in COLUMNS.values() if one.__module__.split(".")[-1] not in PARTS]
    columns = [*more, f"COLUMNS = {{{named}}}"]
    parts = [*map(_body, PARTS[:-1]), *columns, _body(PARTS[-1]), *(_own_law(kind) for kind in own.values())]
    body = "\n\n\n".join(parts)
    held = ", ".join(f"{name!r}: {_call('Losses', one.losses)}" for name, one in files.items())
    shared = {name: list(one.effects) for name, one in files.items()}
    links = ", ".join(f"{name!r}: {_plain(one.links)}" for name, one in files.items())
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
    return f"{HEADER}\n{body}\n\n\n" + "\n".join(numbers) + "\n\n" + CALLS


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
