"""Is there enough to learn from: runs, motion that tells the parameters apart, and each motion more than once?

In one sinusoid the acceleration is the angle times a constant: rotor and link inertia, a spring and gravity's slope are
then one parameter, however long it was recorded, and no held-out part of it says otherwise.
Optimised and everyday motion shows shares of 0.3 to 0.95.

Source: Marquardt, Generalized inverses, ridge regression, biased linear estimation (1970): inflation beyond ten.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import qr

from ident.arrays import Array, Float, Int
from ident.checks.filtered_run import USUAL_EXCITATION, ExcitationSettings, filter_run
from ident.checks.report import TelemetryReport, issue_of, joints_at
from ident.errors import RecordingError, plural
from ident.recordings.recording import FEWEST_BLOCKS, SHORTEST_BLOCK_S, Session, Severity, TelemetryIssue
from ident.robot.arm import ArmModel

# Parts of a single recording that are left out in turn, as the held-out splits do.
PARTS = 5


class Independence:
    """Sums over recordings, each taken and none kept."""

    def __init__(self, travel: float = USUAL_EXCITATION.least_travel) -> None:
        self._travel = travel
        self._sums: list[list[Float[Array, "5 5"]]] = []
        self._strokes: Int[Array, "2 n"] = np.zeros((2, 0), dtype=int)

    def take(self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]) -> None:
        """Adds one recording's filtered motion."""
        joints = q.shape[1]
        if not self._sums:
            self._sums, self._strokes = [[] for _ in range(joints)], np.zeros((2, joints), dtype=int)
        for j in range(joints):
            if np.ptp(q[:, j]) >= self._travel:
                table = np.column_stack([np.ones(len(q)), q[:, j], np.sin(q[:, j]), np.cos(q[:, j]), ddq[:, j]])
                self._sums[j].append(np.stack([part.T @ part for part in np.array_split(table, PARTS)]))
            # Pieces of motion between reversals that go far enough, up and down.
            cuts = np.r_[0, np.flatnonzero(np.diff(np.sign(dq[:, j]))) + 1, len(q) - 1]
            gone = np.diff(q[cuts, j])
            self._strokes[:, j] += (gone > self._travel).sum(), (gone < -self._travel).sum()

    def shown(self) -> tuple[Float[Array, " n"], Int[Array, "2 n"]]:
        """What all recordings together show of each joint.

        Returns:
            Share of the acceleration's variance that does not follow from the angle, the least over what is left where
            one recording is left out, NaN where the joint does not move; and strokes in either direction.
        """
        least = np.full(len(self._sums), np.nan)
        for j, taken in enumerate(self._sums):
            if not taken:
                continue
            parts = np.array([one.sum(axis=0) for one in taken] if len(taken) > 1 else list(taken[0]))
            sums = parts.sum(axis=0) - parts
            columns, target = sums[:, :4, :4], sums[:, :4, 4]
            size = np.sqrt(np.maximum(np.diagonal(columns, axis1=1, axis2=2), 1e-300))
            inverse = np.linalg.pinv(columns / (size[:, :, None] * size[:, None, :]), rcond=1e-9, hermitian=True)
            explained = np.einsum("pi,pij,pj->p", target / size, inverse, target / size)
            variance = sums[:, 4, 4] - target[:, 0] ** 2 / sums[:, 0, 0]
            known = variance > 0.0
            if known.any():
                left = (sums[:, 4, 4] - explained)[known] / variance[known]
                least[j] = np.min(np.clip(left, 0.0, 1.0))
        return least, self._strokes


# States that are kept of each session or part: there may be very many.
STATES = 800


class Amount:
    """What the sessions of one set-up, or the parts of long ones, amount to together: each is taken, none is kept."""

    def __init__(self, settings: ExcitationSettings = USUAL_EXCITATION) -> None:
        self._settings = settings
        self._first: Session | None = None  # with a run of no samples
        self._runs, self._seconds, self._blocks = 0, 0.0, 0
        self._low: Array = np.array(np.inf)
        self._high: Array = np.array(-np.inf)
        self._states: list[Float[Array, "4 T n"]] = []
        self._arm: ArmModel | None = None
        self._independence = Independence(settings.least_travel)

    def take(self, session: Session, report: TelemetryReport) -> None:
        """Counts one more session as its check mended it, with the robot as it needs it.

        Raises:
            RecordingError: It has other joints than the first.
        """
        session = report.session
        first = self._first = self._first or session.replace(runs=[session.runs[0].at(slice(0))])
        if session.joints != first.joints:
            what = f"has other joints of the robot than {first.name}: {', '.join(session.joints)}"
            remedy = "give sessions that recorded the same joints"
            raise RecordingError(session.path or session.name, what, remedy)
        if not session.samples:
            return
        self._runs += len(session.runs)
        self._seconds += session.duration
        self._blocks += sum(int(run.duration / SHORTEST_BLOCK_S) for run in session.runs)
        for run in (run for run in session.runs if len(run)):
            self._low = np.minimum(self._low, run.position.min(axis=0))
            self._high = np.maximum(self._high, run.position.max(axis=0))
        self._arm = self._arm or report.arm
        motions = list(filter(None, map(filter_run, session.runs)))
        for motion in motions:
            self._independence.take(motion.q, motion.dq, motion.ddq)
        if report.arm is not None and motions:
            states = np.concatenate([np.stack([one.q, one.dq, one.ddq, one.tau]) for one in motions], axis=1)
            self._states.append(states[:, :: max(1, states.shape[1] // STATES)])

    def issues(self) -> list[TelemetryIssue]:
        """What all that was taken lacks, together: runs, motion of every joint, and of the base parameters apart."""
        if self._first is None or not self._runs:
            return []
        first, found, travel = self._first, list[TelemetryIssue](), self._high - self._low
        if self._blocks < FEWEST_BLOCKS:
            seen: dict[str, Any] = {"runs": plural(self._runs, "run"), "blocks": plural(self._blocks, "block")}
            least = {"least": FEWEST_BLOCKS, "block": SHORTEST_BLOCK_S, "length": FEWEST_BLOCKS * SHORTEST_BLOCK_S}
            seen |= least | {"seconds": self._seconds}
            found.append(issue_of("too_few", first, **seen))
        still = np.flatnonzero(travel < self._settings.least_travel)
        none_moves = len(still) == len(first.joints)
        if len(still):
            severity: Severity = "fatal" if none_moves else "warning"
            names = ", ".join(first.joints[j] for j in still)
            found.append(issue_of("still", first, still, None, severity, travel=travel[still].max(), names=names))
        if self._blocks >= FEWEST_BLOCKS:  # else that is what is wrong
            found += self._check_independence(first)
        if self._arm is not None and self._states and not none_moves:
            condition = base_condition(np.concatenate(self._states, axis=1), self._arm)
            if condition > self._settings.largest_condition:
                found.append(issue_of("condition", first, condition=condition))
        return found

    def _check_independence(self, first: Session) -> list[TelemetryIssue]:
        """Whether each joint's inertia and friction are shown apart from gravity, and more than once."""
        share, (up, down) = self._independence.shown()
        moving, one_sinusoid = np.isfinite(share), share < self._settings.least_share
        part = "a fifth of the recording" if self._runs == 1 else "one recording"
        text = (
            f"with {part} left out, all but {{:.2g}} % of its acceleration follows from its angle: it moves in one "
            "sinusoid, or nearly, and its inertia can't be told from gravity or a spring"
        )
        found = [(int(j), text.format(100 * share[j])) for j in np.flatnonzero(one_sinusoid)]
        once = np.flatnonzero(moving & ~one_sinusoid & (np.minimum(up, down) < self._settings.least_strokes))
        found += [(int(j), f"it moves {up[j]} times up and {down[j]} times down") for j in once]
        if not found:
            return []
        columns = [j for j, _ in found]
        others = f"; likewise {', '.join(joints_at(first, columns[1:]))}" if columns[1:] else ""
        # Strokes that no other repeats still show gravity and friction; one sinusoid shows neither apart.
        severity: Severity = "fatal" if one_sinusoid.sum() == moving.sum() else "warning"
        return [issue_of("dependent", first, columns, columns[0], severity, reported=found[0][1], others=others)]


def base_condition(states: Float[Array, "4 T n"], arm: ArmModel) -> float:
    """Condition number of some motion's base regressor, rows per torque's spread, columns of unit length."""
    q, dq, ddq, tau = states
    step = slice(None, None, max(1, len(q) // STATES))
    table = arm.regressor(q[step], dq[step], ddq[step])
    spread = tau.std(axis=0)
    # Without this, the shoulder's torque would drown what the wrist tells.
    least = 1e-3 * float(spread.max()) or 1.0  # a torque may be all zeros
    table = (table / np.maximum(spread, least)[:, None]).reshape(-1, 10 * arm.n)
    size = np.linalg.norm(table, axis=0)
    table = table / np.where(size > 1e-9 * size.max(), size, np.inf)
    # The best conditioned set of base columns, so that the figure tells the motion and not the choice of columns.
    factor, _ = qr(np.linalg.qr(table, mode="r"), mode="r", pivoting=True)
    values = np.linalg.svd(factor[:, : base_rank(arm)], compute_uv=False)
    return float(values[0] / max(values[-1], 1e-12 * values[0]))


def base_rank(arm: ArmModel) -> int:
    """Number of base parameters: the regressor's rank in general motion.

    Source: Gautier, Numerical calculation of the base inertial parameters of robots (1991).
    """
    # The rank is a property of the arm: fixed general states find it as well as any others.
    q, dq, ddq = np.random.default_rng(0).uniform(-np.pi, np.pi, (3, 60, arm.n))
    table: Float[Array, "r 10n"] = arm.regressor(q, dq, ddq).reshape(-1, 10 * arm.n)
    size = np.linalg.norm(table, axis=0)
    triangle = np.linalg.qr(table / np.where(size > 1e-9 * size.max(), size, np.inf), mode="r")
    return int(np.linalg.matrix_rank(triangle, tol=1e-8))
