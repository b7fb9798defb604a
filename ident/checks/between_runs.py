"""Each run held against the others of its session: a run whose torque has another sign or another scale."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.checks.filtered_run import BETWEEN_RUNS as LIMIT
from ident.checks.report import Findings
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel


def check_between_runs(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Finds runs in which gravity pulls the other way, or with another strength, than in all others."""
    if len(session.runs) < LIMIT.least_runs:
        return []
    follows = np.array([follow_gravity(run, arm) for run in session.runs])
    correlation, slope = follows[:, 0], follows[:, 1]
    signs, scales = Findings(session), Findings(session)
    for k, run in enumerate(session.runs):
        others = np.delete(np.arange(len(session.runs)), k)
        known = (np.median(correlation[others], axis=0) > LIMIT.follows) & (correlation[others] > 0.0).all(axis=0)
        turned = known & (correlation[k] < -LIMIT.turned)
        if turned.any():
            what = f"torque of {_names(run, turned)} falls with gravity, that of all other runs rises"
            signs.note(run, what, np.flatnonzero(turned))
        usual = np.median(slope[others], axis=0)
        share = slope[k] / np.where(usual > 0.0, usual, np.nan)
        close = np.minimum(correlation[k], correlation[others].min(axis=0)) > LIMIT.closely
        off = close & ~_between(share)
        if off.any():
            factor = float(np.median(share[off]))
            what = f"torque of {_names(run, off)} follows gravity at {factor:.3g} times what it does in the other runs"
            scales.note(run, what, np.flatnonzero(off))
    return [*signs.issues("sign_of_a_run"), *scales.issues("scale_of_a_run")]


def follow_gravity(run: Recording, arm: ArmModel) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """How closely each joint's torque follows the model's gravity in a run (correlation), and at which slope.

    A constant and what goes with the speed, friction that is, are taken out of both.
    """
    rows = np.unique(np.linspace(0, len(run) - 1, LIMIT.most_rows).astype(int))
    speed = np.gradient(run.position, run.time, axis=0)[rows]
    gravity, effort = arm.gravity(run.position[rows]), np.array(run.effort[rows])
    for joint in range(effort.shape[1]):
        rubbing = np.column_stack([np.ones(len(rows)), np.sign(speed[:, joint]), speed[:, joint]])
        both = np.column_stack([gravity[:, joint], effort[:, joint]])
        left = both - rubbing @ np.linalg.lstsq(rubbing, both, rcond=None)[0]
        gravity[:, joint], effort[:, joint] = left.T
    power = (gravity * gravity).sum(axis=0)
    common = (gravity * effort).sum(axis=0)
    spread = np.sqrt(power * (effort * effort).sum(axis=0))
    correlation = np.divide(common, spread, out=np.zeros(len(power)), where=spread > 0.0)
    slope = np.divide(common, power, out=np.zeros(len(power)), where=power > 0.0)
    return correlation, slope


def _between(share: Array) -> Array:
    """Whether a slope is that of the others but for what runs differ by."""
    return np.asarray((share > 1.0 / LIMIT.scale) & (share < LIMIT.scale))


def _names(run: Recording, which: Array) -> str:
    return ", ".join(run.joints[int(column)] for column in np.flatnonzero(which))
