"""Twelve sets of recordings of real arms as neutral motions, each with three splits into training and held-out runs.

The states are neutral: those of a zero-phase Butterworth filter and central differences, the same for every program
that is measured, at training and at test. A recording of one run is cut into thirds, of which each is held out once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.motion.filter import Lowpass, design_lowpass, filter_both_ways
from ident.motion.motion import Motion
from ident.recordings.joint_names import match_joints
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from tests.ident.conftest import UR10E_TEST, UR10E_TRAINING, load_sapienza, load_ur10e

# Corner of the filter of states and torques [Hz], its share of the sampling rate at most, and the grid's rate [Hz].
CORNER_HZ, CORNER_SHARE, FASTEST_GRID_HZ = 10.0, 0.2, 250.0
FILTER_ORDER = 4
# Left out at either end of a run, where a filter of both ways is not itself [s].
BORDER_S = 0.7
# Between two thirds of one run [s].
GAP_S = 0.3
SPLITS = 3
LWR4_FILES = ("measurements_1", "measurements_2", "measurements_3")


@dataclass(frozen=True)
class HeldOutSet:
    """One arm's recordings."""

    name: str  # in the table
    arm: ArmModel  # as its URDF describes it
    runs: tuple[Motion, ...]  # neutral motions

    def splits(self) -> Iterator[tuple[list[Motion], list[Motion]]]:
        """Training and held-out runs, three times."""
        parts = np.arange(len(self.runs)) * SPLITS // len(self.runs)
        for number in range(SPLITS):
            train = [run for run, part in zip(self.runs, parts, strict=True) if part != number]
            test = [run for run, part in zip(self.runs, parts, strict=True) if part == number]
            yield train, test


def neutral_motion(run: Recording, effort_sign: float = 1.0) -> Motion:
    """A recording on an even grid, its states by a filter and differences that know nothing of the arm."""
    rate = 1.0 / run.sample_interval
    grid = np.arange(run.time[0], run.time[-1], 1.0 / rate)
    corner = min(CORNER_HZ, CORNER_SHARE * rate)
    assert run.effort is not None
    q = _smoothed(_at(grid, run.time, np.asarray(run.position)), rate, corner)
    dq = np.gradient(q, 1.0 / rate, axis=0)
    ddq = np.gradient(dq, 1.0 / rate, axis=0)
    every = max(1, round(rate / FASTEST_GRID_HZ))
    edge = round(BORDER_S * rate)
    inside = slice(edge, len(grid) - edge, every)
    tau = effort_sign * _at(grid, run.time, np.asarray(run.effort))
    if every > 1:
        tau = _smoothed(tau, rate, 0.4 * FASTEST_GRID_HZ)
    return Motion(
        name=run.name,
        joints=run.joints,
        time=grid[inside],
        q=q[inside],
        dq=dq[inside],
        ddq=ddq[inside],
        tau=tau[inside],
        lowpass=Lowpass.design(rate / every, corner),
        std=np.zeros((3, len(run.joints))),
        log_interval=1.0 / rate,
    )


def _smoothed(values: Float[Array, "T n"], rate: float, corner: float) -> Float[Array, "T n"]:
    padding = min(len(values) - 1, int(3 * rate / corner))
    return filter_both_ways(design_lowpass(FILTER_ORDER, corner, rate), values, padding)


def _at(grid: Float[Array, " t"], time: Float[Array, " T"], values: Float[Array, "T n"]) -> Float[Array, "t n"]:
    return np.stack([np.interp(grid, time, column) for column in values.T], axis=1)


def read_lwr4(folder: Path) -> tuple[Recording, ...]:
    """The three recordings of the KUKA LWR4+, whose files are NumPy's."""
    joints = ArmModel.load(folder / "robot.urdf").joint_names
    runs = []
    for name in LWR4_FILES:
        with np.load(folder / f"{name}.npz") as arrays:
            runs.append(Recording(name, joints, arrays["times"], arrays["positions"], arrays["torques"]))
    return tuple(runs)


def _thirds(run: Motion) -> list[Motion]:
    """Thirds of a motion, a gap between them as wide as the filter reaches."""
    bounds = np.linspace(0, len(run.time), SPLITS + 1).astype(int)
    gap = round(GAP_S / run.interval)
    thirds = []
    for k in range(SPLITS):
        inside = slice(bounds[k] + gap * (k > 0), bounds[k + 1])
        channels = {name: getattr(run, name)[inside] for name in ("time", "q", "dq", "ddq", "tau")}
        thirds.append(replace(run, name=f"{run.name}_{k}", **channels))
    return thirds


def _session_runs(path: Path, arm: ArmModel) -> list[Recording]:
    return list(match_joints(load_session(path), arm.joint_names)[0].runs)


def _read(folder: Path, path: str, robot: str) -> tuple[ArmModel, list[Recording]]:
    arm = ArmModel.load(robot if "/" not in robot else folder / robot)
    return arm, _session_runs(folder / path, arm)


def _ur10e(folder: Path) -> tuple[ArmModel, list[Recording]]:
    arm = ArmModel.load(folder / "ur10e/ur10e.urdf")
    session: Session = load_ur10e(folder, (*UR10E_TRAINING, *UR10E_TEST))
    return arm, list(match_joints(session, arm.joint_names)[0].runs)


def _panda(folder: Path) -> tuple[ArmModel, list[Recording]]:
    arm = ArmModel.load("panda")
    session = load_sapienza(folder)
    return arm, list(match_joints(session, arm.joint_names)[0].runs)


def _lwr4(folder: Path) -> tuple[ArmModel, list[Recording]]:
    place = folder / "published/kuka_lwr4"
    return ArmModel.load(place / "robot.urdf"), list(read_lwr4(place))


READERS: dict[str, Callable[[Path], tuple[ArmModel, list[Recording]]]] = {
    "UR10e": _ur10e,
    "UR10 CB": lambda folder: _read(folder, "ur10_cb/ur10_exciting_trajectory.db3", "ur10"),
    "Panda 1 kHz": _panda,
    "Panda 30 Hz": lambda folder: _read(folder, "panda/unisa_fer/panda_exciting_trajectory.db3", "panda"),
    "Rokae AR5": lambda folder: _read(folder, "rokae_ar5", "rokae_ar5/robot.urdf"),
    "AIRBOT": lambda folder: _read(folder, "airbot_play", "airbot_play/robot.urdf"),
    "dual arm": lambda folder: _read(folder, "dual_arm_v2", "dual_arm_v2/robot.urdf"),
    "IC arm": lambda folder: _read(folder, "ic_arm", "ic_arm/robot_scaled.urdf"),
    "TX40": lambda folder: _read(folder, "tx40/session", "tx40/robot.urdf"),
    "LWR4+": _lwr4,
    "Gen3": lambda folder: _read(folder, "kinova_gen3/session", "kinova_gen3/robot.urdf"),
    "xMate": lambda folder: _read(folder, "xmate7p/session", "xmate7p/robot.urdf"),
}
# Torque sensors of the other sign, as their users turn them.
FLIPPED = ("Gen3",)


def read_set(folder: Path, name: str) -> HeldOutSet:
    """One of the sets.

    Args:
        folder: Where the recordings of real arms are.
        name: A key of `READERS`.
    """
    arm, runs = READERS[name](folder)
    sign = -1.0 if name in FLIPPED else 1.0
    kept = arm if runs[0].joints == arm.joint_names else arm.keeping(runs[0].joints)
    motions = [neutral_motion(run, sign) for run in runs]
    if len(motions) == 1:
        motions = _thirds(motions[0])
    return HeldOutSet(name, kept, tuple(motions))


def read_sets(folder: Path, names: Sequence[str] = ()) -> Iterator[HeldOutSet]:
    """The sets that are asked for, or all."""
    for name in names or READERS:
        yield read_set(folder, name)
