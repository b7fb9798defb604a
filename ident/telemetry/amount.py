"""Is there enough to learn from: runs, and motion that tells the parameters apart?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from ident.arm import ArmModel
from ident.arrays import Array, Float
from ident.recording import Session, Severity, TelemetryIssue
from ident.splits import FEWEST_BLOCKS, SHORTEST_BLOCK_S, count_blocks
from ident.telemetry.effort import collect_states
from ident.telemetry.report import joints_at

# An error of the torque becomes up to this many times larger in the base parameters. Optimised exciting motion
# reaches 10 to 60; above 100 a torque error of 1 % can double a parameter.
LARGEST_CONDITION = 100.0
# Below this travel a joint shows neither its friction nor its part of gravity [rad or m].
LEAST_TRAVEL = 0.05
STATES = 800


def check_amount(sessions: Sequence[Session]) -> list[TelemetryIssue]:
    """Whether the sessions, together, give enough blocks for held-out splits."""
    found = sum(count_blocks(session) for session in sessions)
    if found >= FEWEST_BLOCKS:
        return []
    seconds = sum(session.duration for session in sessions)
    runs = sum(len(session.runs) for session in sessions)
    evidence = f"{sessions[0].name}: {seconds:.1f} s in {runs} runs give {found} blocks of {SHORTEST_BLOCK_S} s"
    remedy = f"record {FEWEST_BLOCKS} runs, or one of {FEWEST_BLOCKS * SHORTEST_BLOCK_S:.1f} s; 60 s are better"
    return [TelemetryIssue("too_few_runs", (), "fatal", evidence, remedy)]


def check_excitation(sessions: Sequence[Session], arm: ArmModel | None) -> list[TelemetryIssue]:
    """Whether the motion of the sessions, together, moves every joint and tells the base parameters apart."""
    session = sessions[0]
    q = np.concatenate([run.position for each in sessions for run in each.runs])
    still = np.flatnonzero(np.ptp(q, axis=0) < LEAST_TRAVEL)
    remedy = "record motion of all joints over wide poses (`plan excite` proposes one)"
    issues = []
    if len(still):
        travel = np.ptp(q, axis=0)[still].max()
        names = joints_at(session, still)
        evidence = f"{session.name}: hardly any motion ({travel:.3f} rad at most) of {', '.join(names)}"
        severity: Severity = "fatal" if len(still) == len(session.joints) else "warning"
        issues.append(TelemetryIssue("insufficient_excitation", names, severity, evidence, remedy))
    if arm is None or len(still) == len(session.joints):
        return issues
    condition = base_condition(sessions, arm)
    if condition is not None and condition > LARGEST_CONDITION:
        evidence = f"{session.name}: the base parameters' regressor has a condition number of {condition:.3g}"
        issues.append(TelemetryIssue("insufficient_excitation", (), "warning", evidence, remedy))
    return issues


def base_condition(sessions: Sequence[Session], arm: ArmModel) -> float | None:
    """Condition number of the recorded motion's base regressor, rows per torque's spread, columns of unit length."""
    all_states = [states for session in sessions if (states := collect_states(session, arm)) is not None]
    if not all_states:
        return None
    q, dq, ddq, tau = (
        np.concatenate([getattr(states, name) for states in all_states]) for name in ("q", "dq", "ddq", "tau")
    )
    step = slice(None, None, max(1, len(q) // STATES))
    table = arm.regressor(q[step], dq[step], ddq[step])
    spread = tau.std(axis=0)
    # Without this, the shoulder's torque would drown what the wrist tells.
    table = (table / np.maximum(spread, 1e-3 * spread.max())[:, None]).reshape(-1, 10 * arm.n)
    size = np.linalg.norm(table, axis=0)
    table = table / np.where(size > 1e-9 * size.max(), size, np.inf)
    # The best conditioned set of base columns, so that the figure tells the motion and not the choice of columns.
    triangle = np.asarray(np.linalg.qr(table, mode="r"))
    _, _, order = qr(triangle, pivoting=True)
    values = np.linalg.svd(triangle[:, order[: base_rank(arm)]], compute_uv=False)
    return float(values[0] / max(values[-1], 1e-12 * values[0]))


def base_rank(arm: ArmModel) -> int:
    """Number of base parameters: the regressor's rank in general motion.

    Source: Gautier, Numerical calculation of the base inertial parameters of robots (1991).
    """
    # The rank is a property of the arm: fixed general states find it as well as any others.
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 60, arm.n))
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    q = low + (high - low) * 0.5 * (states[0] + 1.0)
    table: Float[Array, "r 10n"] = arm.regressor(q, states[1], 3.0 * states[2]).reshape(-1, 10 * arm.n)
    size = np.linalg.norm(table, axis=0)
    seen = size > 1e-9 * size.max()
    triangle = np.asarray(np.linalg.qr(table[:, seen] / size[seen], mode="r"))
    return int(np.linalg.matrix_rank(triangle, tol=1e-8))
