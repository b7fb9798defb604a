"""Torque of the motion that is to be foretold: the arm without what is wrong in its session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.board.baselines import fit_plain, plain_columns
from ident.benchmark.board.files import Board, joint_columns, read_columns
from ident.benchmark.run import edited_arm
from ident.command_options import FitOptions
from ident.export.identified import IdentifiedArm
from ident.export.loaded import LawModel
from ident.fitting.fit import fit_hybrid
from ident.motion.motion import Motion, prepare
from ident.motion.settings import FOR_DIAGNOSIS
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel

Torque = Float[Array, "T n"]


def read_unseen(board: Board, name: str) -> Recording | None:
    """The motion of a session that is to be foretold; None where there is none."""
    if not board.sessions[name]["unseen"]:
        return None
    path = board.unseen_file(name)
    columns = read_columns(path, "get the board anew")
    joints = board.sessions[name]["joints"]
    position = joint_columns(columns, joints, "position", path)
    velocity = None
    if f"{joints[0]}/velocity" in columns:
        velocity = joint_columns(columns, joints, "velocity", path)
    still = np.zeros_like(position)
    return Recording(name, tuple(joints), columns["time"], position, still, velocity)


def prepared(unseen: Recording) -> Motion:
    """The motion, smoothed."""
    return prepare(Session("unseen", (unseen,)), settings=FOR_DIAGNOSIS)[0]


def at_rows(torque: Torque, motion: Motion, run: Recording) -> Torque:
    """Torque of a run's motion, interpolated linearly to the rows of its recording.

    Args:
        torque: At the motion's t samples, by joint, shape (t, n) [N m].
        motion: The motion.
        run: The recording that it was made of.

    Returns:
        Torque at its T rows, shape (T, n) [N m]; before and after the motion that of its ends.
    """
    columns = [np.interp(run.time, motion.time, values) for values in torque.T]
    return np.column_stack(columns)


def urdf_torque(arm: ArmModel, motion: Motion) -> Torque:
    """Torque of a motion foretold by the URDF alone."""
    return _law_torque(IdentifiedArm.as_urdf(arm), motion)


def plain_torque(arm: ArmModel, motions: Sequence[Motion], motion: Motion) -> Torque:
    """Torque of a motion foretold by plain least squares over other motions."""
    return np.asarray(plain_columns(arm, motion) @ fit_plain(arm, motions))


def edited_torque(record: Mapping[str, Any], arm: ArmModel, motion: Motion) -> Torque:
    """Torque foretold by a diagnosed arm with everything that was named taken out of it.

    Nothing is fitted anew.
    """
    every = range(len(record["findings"]))
    return _law_torque(edited_arm(record, arm, every), motion)


def fitted_torque(arm: ArmModel, motions: Sequence[Motion], motion: Motion) -> Torque:
    """Torque of a motion foretold by `ident fit` without a net, over other motions."""
    model = fit_hybrid(motions, arm, FitOptions(net="none")).model
    return np.asarray(model.torque(motion.q, motion.dq, motion.ddq))


def _law_torque(identified: IdentifiedArm, motion: Motion) -> Torque:
    model = LawModel.of(identified)
    torque = model.joint_torque(motion.q, motion.dq, motion.ddq, motion.interval)
    return np.asarray(model.read_log(torque, motion.interval))
