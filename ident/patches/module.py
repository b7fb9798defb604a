"""A Python module with the named effects' torque that needs NumPy only.

Its first part is the text of `ident.patches.standalone`, its second the figures of arm and effects, its third what a
user calls.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ident.effects import base
from ident.errors import InputError
from ident.patches import standalone
from ident.patches.standalone.chain import Arm, Array
from ident.patches.standalone.laws import KNOWN
from ident.patches.standalone.log import Effect
from ident.patches.standalone.motion import Losses
from ident.robot.arm import ArmModel

PARTS = ("chain", "motion", "log", "rubbing", "masses", "elastic", "laws")
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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, copysign
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

    The effects that the file has no words for, and the difference between the losses that go with them and those that
    stand in for them in the file.
    """
    motion = _motion(q, dq, ddq, interval, slip, warmth)
    outside = [effect for k, effect in enumerate(EFFECTS) if k not in IN_FILE[file]]
    torque = acting_torque(outside, motion) + LOSSES.torque(motion.dq, motion.ddq, motion.direction)
    torque -= FILE_LOSSES[file].torque(motion.dq, motion.ddq, motion.direction)
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
    placements = list(arm.model.jointPlacements)[1:]
    return Arm(
        rotations=np.array([placement.rotation for placement in placements]),
        offsets=np.array([placement.translation for placement in placements]),
        axes=np.array(arm.joint_axes),
        sliding=np.array(arm.sliding_joints),
        links=arm.inertial_parameters.reshape(arm.n, 10),
        gravity=np.array(arm.model.gravity.linear),
        gears=None if arm.gear_ratios is None else np.array(arm.gear_ratios),
        rated=np.array(arm.effort_limit),
    )


def write_module(
    arm: ArmModel,
    losses: Losses,
    effects: Sequence[Effect],
    in_file: Mapping[str, Sequence[int]],
    file_losses: Mapping[str, Losses],
    kinds: Sequence[base.Effect] = (),
) -> str:
    """The module's text.

    Args:
        arm: The tuned arm, without the named effects.
        losses: Its losses, tuned together with the effects.
        effects: The effects whose law is known.
        in_file: For `urdf` and `mjcf`, indices of the effects that the file expresses.
        file_losses: The losses that stand in each file.
        kinds: The effects themselves: those outside the catalogue bring their law along.
    """
    own = {kind.id: kind for kind in kinds if kind.id not in KNOWN}
    body = "\n\n\n".join([*(_body(part) for part in PARTS), *(_own_law(kind) for kind in own.values())])
    held = ", ".join(f"{name!r}: {_call('Losses', value)}" for name, value in file_losses.items())
    figures = [
        # Names come from files: as literals they stay text, whatever stands in them.
        f"ROBOT = {arm.name!a}",
        f"JOINTS = {tuple(arm.joint_names)!a}",
        f"ARM = {_call('Arm', describe_arm(arm))}",
        f"# Tuned together with the effects.\nLOSSES = {_call('Losses', losses)}",
        "EFFECTS = [\n" + "".join(f"    {effect!a},\n" for effect in effects) + "]",
        f"# Which of them the files express.\nIN_FILE = { ({name: list(found) for name, found in in_file.items()})!r}",
        f"FILE_LOSSES = {{{held}}}",
    ]
    return f"{HEADER}\n{body}\n\n\n" + "\n".join(figures) + "\n\n" + CALLS


def _body(part: str) -> str:
    """A file's text after its docstring and imports."""
    text = (Path(standalone.__file__).parent / f"{part}.py").read_text(encoding="utf-8")
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
