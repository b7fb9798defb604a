"""Semi-real cases: a known effect on top of recordings of a real arm, which has unknown ones of its own.

Its size is set by what an ordinary model (link inertias, rotor, linear friction, offset) already leaves of that arm:
three times as large, equal, or 0.3 of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.blind_check.law_torque import Track, law_torque
from ident.diagnosis.regression.baseline import fit_baseline
from ident.errors import InputError
from ident.model.loss import LossParameters
from ident.motion.motion import Motion, prepare
from ident.plant.answer import Answer, TrueEffect
from ident.plant.causes import CATALOGUE, Cause, Circumstances
from ident.plant.causes.base import View
from ident.plant.friction import plain_friction
from ident.plant.hardware import Hardware, draw_hardware
from ident.plant.request import EffectRequest
from ident.plant.sensing import Sensing, read_torque
from ident.plant.visibility import STILL_RAD_S, VisibleRows, remainder
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.session_toml import NAME
from ident.robot.arm import ArmModel
from ident.telemetry import inspect
from ident.trajectories.reference import TICK_S, ReferenceMotion

# Effects that live by changing the motion, or need a place to push at.
NOT_OFFERED = ("joint_coupling", "joint_elasticity", "backlash", "external_contact")
EFFECTS = tuple(effect for effect in CATALOGUE if effect not in NOT_OFFERED)
TRIES, TOLERANCE = 12, 0.1


def find_sources(folder: Path) -> tuple[Path, ...]:
    """Folders of recordings below a folder: those with a session.toml that names the robot.

    Raises:
        InputError: There is none.
    """
    found = [path.parent for path in sorted(folder.rglob(NAME)) if _names_robot(path)]
    if not found:
        raise InputError(folder, f"no folder below it has a {NAME} with robot = …", "add one beside the recordings")
    return tuple(found)


def _names_robot(path: Path) -> bool:
    return any(line.split("=")[0].strip() == "robot" for line in path.read_text(encoding="utf-8").splitlines())


@dataclass(frozen=True, eq=False)
class RealArm:
    """Recordings of a real arm, and what is known of it.

    Attributes:
        robot: Its name or URDF.
        arm: Its model.
        session: Its recordings, mended.
        motions: The same, smoothed.
        loss: Its friction and rotor inertia, fitted.
    """

    robot: str
    arm: ArmModel
    session: Session
    motions: tuple[Motion, ...]
    loss: LossParameters

    @classmethod
    def load(cls, folder: Path) -> RealArm:
        """Reads, mends and smooths the recordings of a folder."""
        session = load_session(folder)
        assert session.robot is not None
        arm = ArmModel.load(session.robot)
        report = inspect(session, arm)
        report.require_fit()
        arm = arm.keeping(session.joints)
        motions = prepare(report.session)
        names = [motion.name for motion in motions]
        kept = report.session.replace(runs=[run for run in report.session.runs if run.name in names])
        return cls(session.robot, arm, kept, motions, fit_baseline(motions, arm).loss)

    def hardware(self, rng: np.random.Generator) -> Hardware:
        """An arm of the plant with this arm's friction and rotors, nominal links and silent sensors."""
        drawn = draw_hardware(self.arm, rng, inertia_error=0.0)
        rotor = np.maximum(self.loss.motor_inertia, 1e-3)
        friction = plain_friction(np.maximum(self.loss.coulomb, 1e-3), np.maximum(self.loss.viscous, 1e-3), rotor)
        sensing = drawn.sensing.silent()
        return drawn.replace(
            friction=friction, drive=drawn.drive._replace(rotor_inertia=rotor), sensing=sensing, friction_spread=0.0
        )

    @cached_property
    def paths(self) -> tuple[Track, ...]:
        """The motions at the plant's ticks."""
        return tuple(self._path(motion) for motion in self.motions)

    def _path(self, motion: Motion) -> Track:
        ticks = np.arange(0.0, motion.time[-1] - motion.time[0], TICK_S)
        q, dq, ddq = (_at(ticks, motion.time - motion.time[0], x) for x in (motion.q, motion.dq, motion.ddq))
        return Track(float(motion.time[0]), q, dq, ddq, self.arm.inverse_dynamics(q, dq, ddq))

    @property
    def planned(self) -> tuple[ReferenceMotion, ...]:
        """The motions as the plant's causes want to see them."""
        return tuple(ReferenceMotion(m.name, p.q, p.dq, p.ddq) for m, p in zip(self.motions, self.paths, strict=True))

    def left(self, torques: Sequence[Float[Array, "T n"]], view: View) -> Float[Array, " n"]:
        """RMS that an ordinary model leaves of torques on the motions' grids, where joints move [N m]."""
        rest = remainder(self._rows(torques, view))
        moving = np.concatenate([np.abs(m.dq[m.coarse]) > STILL_RAD_S for m in self.motions])
        return np.sqrt((rest**2).sum(axis=0) / np.maximum(moving.sum(axis=0), 1))

    def _rows(self, torques: Sequence[Float[Array, "T n"]], view: View) -> VisibleRows:
        columns, filtered = [], []
        for motion, torque in zip(self.motions, torques, strict=True):
            q, dq, ddq = motion.q, motion.dq, motion.ddq
            own = [ddq, dq, np.sign(dq)] + ([] if view == "raw" else [np.ones_like(q)])
            parts = [value[:, :, None] * np.eye(self.arm.n) for value in own]
            if view == "refit":
                parts.insert(0, self.arm.regressor(q, dq, ddq))
            columns.append(motion.filtered(np.concatenate(parts, axis=2)))
            filtered.append(motion.filtered(torque))
        speed = np.concatenate([motion.dq[motion.coarse] for motion in self.motions])
        torque, none = np.concatenate(filtered), np.zeros(len(speed))
        moving = np.abs(speed) > STILL_RAD_S
        return VisibleRows(np.concatenate(columns), torque, np.zeros_like(torque), moving, speed, run=none, time=none)

    @cached_property
    def floor(self) -> Float[Array, " n"]:
        """What an ordinary model leaves of the recorded torque [N m]."""
        return self.left([motion.tau for motion in self.motions], "refit")


def _at(times: Array, knots: Array, values: Array) -> Array:
    return np.column_stack([np.interp(times, knots, column) for column in values.T])


def change_session(real: RealArm, before: Hardware, after: Hardware) -> Session:
    """The recordings as they would be if the arm were changed so, its motion being the same."""
    plain, changed = law_torque(before, real.paths), law_torque(after, real.paths)
    shift = after.sensing.encoder_offset - before.sensing.encoder_offset
    runs = []
    for run, path, old, new in zip(real.session.runs, real.paths, plain, changed, strict=True):
        times = np.clip(run.time - run.time[0], 0.0, path.ticks[-1])
        recorded = _at(path.ticks, run.time - run.time[0], run.effort)
        told = _read(after.sensing, path, recorded + new - old, times)
        effort = run.effort + told - _read(before.sensing, path, recorded, times)
        runs.append(_with(run, effort, shift))
    return real.session.replace(runs=runs)


def _read(sensing: Sensing, path: Track, torque: Float[Array, "K n"], times: Float[Array, " T"]) -> Float[Array, "T n"]:
    return read_torque(sensing, path.ticks, torque, path.dq, times, path.start, np.random.default_rng(0))


def _with(run: Recording, effort: Float[Array, "T n"], shift: Float[Array, " n"]) -> Recording:
    """A run with another torque and shifted encoders; currents would betray the change, so they go."""
    return replace(run, effort=effort, position=run.position + shift, current=None, effort_command=None, source=None)


def visible(real: RealArm, cause: Cause, changed: Session, shift: Float[Array, " n"]) -> Float[Array, " n"]:
    """Visible amplitude of a change at each joint [N m]."""
    torques = []
    for run, old, motion in zip(changed.runs, real.session.runs, real.motions, strict=True):
        added = _at(motion.time, run.time, run.effort - old.effort)
        if np.any(shift):  # the model looks at the wrong angle
            moved = self_torque(real.arm, motion, shift)
            added = added + self_torque(real.arm, motion, np.zeros_like(shift)) - moved
        torques.append(added)
    # Nominal inertias are not in these torques: there is nothing to take away but what is fitted.
    return real.left(torques, cause.view)


def self_torque(arm: ArmModel, motion: Motion, shift: Float[Array, " n"]) -> Float[Array, "T n"]:
    """Rigid torque of a run whose angles are read with a shift [N m]."""
    return arm.inverse_dynamics(motion.q + shift, motion.dq, motion.ddq)


def add_effect(real: RealArm, request: EffectRequest, joint: int, seed: int) -> tuple[Session, Answer]:
    """The recordings with one effect of a wanted visible amplitude, and the answer.

    Raises:
        InputError: No physical size shows that much.
    """
    cause, before = request.cause, real.hardware(np.random.default_rng([seed, 1]))
    low, high = cause.bounds(_scene(real, before, joint, seed))
    size = float(np.clip(cause.typical(_scene(real, before, joint, seed)), low, high))
    wanted = request.amplitude or 1.0
    for _ in range(TRIES):
        after, parameters = cause.apply(_scene(real, before, joint, seed), size)
        changed = change_session(real, before, after)
        amplitude = visible(real, cause, changed, after.sensing.encoder_offset - before.sensing.encoder_offset)
        shares = amplitude / real.floor
        seen = float(shares.max() if cause.whole_arm else shares[joint])
        if abs(seen / wanted - 1.0) < TOLERANCE:
            names = real.arm.joint_names
            at = () if cause.whole_arm else (names[joint],)
            told = dict(zip(names, map(float, amplitude), strict=True))
            effect = TrueEffect(cause.id, True, at, size, cause.parameter, parameters, told)
            floor = dict(zip(names, map(float, real.floor), strict=True))
            return changed, Answer(real.arm.name, seed, (effect,), (), floor)
        step = float(np.clip(wanted / max(seen, 1e-9), 0.2, 5.0))
        size = float(np.clip(size / np.sqrt(step) if cause.inverse else size * step, low, high))
    raise InputError(f"--effect {cause.id}", f"can't show {wanted:g} times what is left", "choose another joint")


def _scene(real: RealArm, hardware: Hardware, joint: int, seed: int) -> Circumstances:
    return Circumstances(hardware, joint, real.planned, np.random.default_rng(seed))
