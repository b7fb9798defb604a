"""Loads what was written, and measures it: against recordings, or against the laws alone.

Without recordings, every file must differ from the file without effects by exactly what its effects say.
"""

from __future__ import annotations

import importlib.util
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.motion.motion import Motion
from ident.patches.gaps import Gap, Helper, measure_gap
from ident.patches.loaded import LoadedMjcf, LoadedModel, LoadedUrdf
from ident.patches.standalone.laws import acting_torque
from ident.patches.standalone.log import Effect, read_log
from ident.patches.standalone.motion import Losses, MovingArm
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel

STATES = 200
# States of the structural check move faster than dry friction's transition [rad/s].
LEAST_SPEED, MOST_SPEED, MOST_ACCELERATION = 0.3, 1.5, 3.0


@dataclass(frozen=True, eq=False)
class WrittenPatch:
    """Where a patch lies, and what it was written from.

    Attributes:
        folder: Its folder.
        arm: The arm that was diagnosed, locked joints locked.
        locked: Joints locked on the way.
        losses: Losses in each file, by `urdf` and `mjcf`.
    """

    folder: Path
    arm: ArmModel
    locked: tuple[str, ...]
    losses: dict[str, Losses]

    def load(self, form: str, payload: Payload | None = None) -> LoadedModel:
        """The file of a format in its simulator."""
        losses = self.losses[form]
        if form == "mjcf":
            return LoadedMjcf(self.folder / "robot.xml", self.arm.joint_names, payload)
        path = self.folder / "robot.urdf"
        return LoadedUrdf(path, self.locked, losses, payload)


def load_module(path: Path) -> ModuleType:
    """Imports a written module from its file."""
    name = f"armgap_patch_{path.parent.name.strip('.')}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up while it is being made; a second patch must not find the first one's.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules[name]
        shutil.rmtree(path.parent / "__pycache__", ignore_errors=True)
    return module


def compare(
    before: Mapping[str, WrittenPatch], after: WrittenPatch, motions: Sequence[Motion]
) -> dict[str, dict[str, Gap]]:
    """Gaps before and after, by format: files without effects, with them, and with the module's help."""
    module = load_module(after.folder / "extra_torque.py")
    payload = motions[0].payload
    found = {}
    for form in ("urdf", "mjcf"):
        patched = after.load(form, payload)
        helper = Helper(module, form, reads_log=form == "urdf")
        found[form] = {
            **{name: measure_gap(files.load(form, payload), motions) for name, files in before.items()},
            "after": measure_gap(patched, motions),
            "after_with_module": measure_gap(patched, motions, helper),
        }
    return found


def check_structure(after: WrittenPatch, expressed: dict[str, list[Effect]], seed: int = 0) -> dict[str, Any]:
    """Largest difference of each loaded file from the tuned arm, its losses, and the laws that it expresses [N m].

    Single random states: what has a memory (an elastic joint, a delay) is not in them.

    Args:
        after: What was written.
        expressed: For each format the effects that it states without approximation.
        seed: Of the states.
    """
    module = load_module(after.folder / "extra_torque.py")
    q, dq, ddq = random_states(after.arm, np.random.default_rng(seed))
    found: dict[str, Any] = {}
    for form, effects in expressed.items():
        losses = after.losses[form]
        memory = [effect for effect in effects if effect[0] in ("joint_elasticity", "torque_delay")]
        if any(effect[0] == "joint_elasticity" for effect in memory):
            found[form] = {"loads": after.load(form) is not None, "torque_difference_Nm": None}
            continue
        states = MovingArm(module.ARM, losses, q, dq, ddq)
        instant = [effect for effect in effects if effect not in memory]
        model = after.load(form)
        wanted = read_log(instant, _plain(states, losses) + acting_torque(instant, states), 0.0)
        torque = model.joint_torque(q, dq, ddq, 0.0)
        # States that lie for ever apart: no delay reaches from one to the next.
        left = model.read_log(torque, 1e9) - wanted
        found[form] = {"loads": True, "torque_difference_Nm": float(np.max(np.abs(left)))}
    return found


def _plain(states: MovingArm, losses: Losses) -> Float[Array, "T n"]:
    return np.asarray(states.rigid + losses.torque(states.dq, states.ddq, states.direction))


def random_states(arm: ArmModel, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Angles within limits, speeds clear of rest, moderate accelerations."""
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    q = rng.uniform(low, high, (STATES, arm.n))
    speed = rng.uniform(LEAST_SPEED, MOST_SPEED, q.shape) * rng.choice([-1.0, 1.0], q.shape)
    return q, speed, rng.uniform(-MOST_ACCELERATION, MOST_ACCELERATION, q.shape)
