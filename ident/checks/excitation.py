"""Is there enough to learn from?

Runs, motion that tells the parameters apart, and each motion more than once. In one sinusoid the
acceleration is the angle times a constant: rotor and link inertia, a spring and gravity's slope are
then one parameter, however long it was recorded, and no held-out part of it says otherwise.
Optimised and everyday motion shows shares of 0.3 to 0.95.

Source: Marquardt, Generalized inverses, ridge regression, biased linear estimation (1970):
inflation beyond ten.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from ident.arrays import Array, Float, Int
from ident.checks.filtered_run import filter_run
from ident.checks.report import TelemetryReport, issue_of, joints_at
from ident.checks.settings import USUAL_EXCITATION, ExcitationSettings
from ident.errors import RecordingError, plural
from ident.recordings.blocks import FEWEST_BLOCKS, SHORTEST_BLOCK_S, count_blocks
from ident.recordings.recording import Session, Severity, TelemetryIssue
from ident.robot.arm import ArmModel

# Parts of a single recording that are left out in turn, as the held-out splits do.
PARTS = 5
# States that are kept of each session or part: there may be very many.
STATES = 800


class Independence:
    """Sums over recordings, each taken and none kept."""

    def __init__(self, travel: float = USUAL_EXCITATION.least_travel) -> None:
        self._travel = travel
        # Of each joint, for each recording: inner products of its parts' columns and target.
        self._sums: list[list[Float[Array, "5 5 5"]]] = []
        self._strokes: Int[Array, "2 n"] = np.zeros((2, 0), dtype=int)

    def take(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
    ) -> None:
        """Adds one recording's filtered motion [rad, rad/s, rad/s²]."""
        joints = q.shape[1]
        if not self._sums:
            self._sums = [[] for _ in range(joints)]
            self._strokes = np.zeros((2, joints), dtype=int)
        for joint in range(joints):
            angle = q[:, joint]
            if np.ptp(angle) >= self._travel:
                of_angle = [np.ones(len(angle)), angle, np.sin(angle), np.cos(angle)]
                table = np.column_stack([*of_angle, ddq[:, joint]])
                parts = np.array_split(table, PARTS)
                self._sums[joint].append(np.stack([piece.T @ piece for piece in parts]))
            self._strokes[:, joint] += self._count_strokes(angle, dq[:, joint])

    def _count_strokes(self, q: Float[Array, " T"], dq: Float[Array, " T"]) -> tuple[int, int]:
        """Pieces of motion between reversals that go far enough, up and down."""
        reversals = np.flatnonzero(np.diff(np.sign(dq))) + 1
        ends = np.r_[0, reversals, len(q) - 1]
        gone = np.diff(q[ends])
        up = (gone > self._travel).sum()
        down = (gone < -self._travel).sum()
        return int(up), int(down)

    def shown(self) -> tuple[Float[Array, " n"], Int[Array, "2 n"]]:
        """What all recordings together show of each joint.

        Returns:
            Share of the acceleration's variance that does not follow from the angle, the least over
            what is left where one recording is left out, NaN where the joint does not move; and
            strokes in either direction.
        """
        least = np.full(len(self._sums), np.nan)
        for joint, recordings in enumerate(self._sums):
            if len(recordings) > 1:
                pieces = np.array([parts.sum(axis=0) for parts in recordings])
            elif recordings:
                pieces = recordings[0]
            else:
                continue
            shares = _unexplained(pieces.sum(axis=0) - pieces)
            if len(shares):
                least[joint] = np.min(np.clip(shares, 0.0, 1.0))
        return least, self._strokes


def _unexplained(sums: Float[Array, "p 5 5"]) -> Float[Array, " k"]:
    """Share of an acceleration's variance that does not follow from the angle.

    Args:
        sums: Inner products of 1, the angle, its sine and cosine, and the acceleration.

    Returns:
        One of each that has any acceleration.
    """
    columns = sums[:, :4, :4]
    target = sums[:, :4, 4]
    square = sums[:, 4, 4]
    diagonal = np.diagonal(columns, axis1=1, axis2=2)
    size = np.sqrt(np.maximum(diagonal, 1e-300))
    scaled = columns / (size[:, :, None] * size[:, None, :])
    inverse = np.linalg.pinv(scaled, rcond=1e-9, hermitian=True)
    along = target / size
    explained = np.einsum("pi,pij,pj->p", along, inverse, along)
    variance = square - target[:, 0] ** 2 / sums[:, 0, 0]
    known = variance > 0.0
    return (square - explained)[known] / variance[known]


class Amount:
    """What the sessions of one set-up, or the parts of long ones, amount to together.

    Each is taken, none is kept.
    """

    def __init__(self, settings: ExcitationSettings = USUAL_EXCITATION) -> None:
        self._settings = settings
        self._first: Session | None = None  # with a run of no samples
        self._runs = 0
        self._seconds = 0.0
        self._blocks = 0
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
        if self._first is None:
            self._first = session.replace(runs=[session.runs[0].at(slice(0))])
        if session.joints != self._first.joints:
            joints = ", ".join(session.joints)
            what = f"has other joints of the robot than {self._first.name}: {joints}"
            remedy = "give sessions that recorded the same joints"
            raise RecordingError(session.path or session.name, what, remedy)
        if not session.samples:
            return
        self._runs += len(session.runs)
        self._seconds += session.duration
        for run in session.runs:
            self._blocks += count_blocks(run.duration)
            if len(run):
                self._low = np.minimum(self._low, run.position.min(axis=0))
                self._high = np.maximum(self._high, run.position.max(axis=0))
        self._arm = self._arm or report.arm
        self._take_motions(session, report.arm is not None)

    def _take_motions(self, session: Session, has_robot: bool) -> None:
        """Adds the filtered motion of a session; its states where there is a robot to ask."""
        filtered = [filter_run(run) for run in session.runs]
        motions = [motion for motion in filtered if motion is not None]
        for motion in motions:
            self._independence.take(motion.q, motion.dq, motion.ddq)
        if not has_robot or not motions:
            return
        of_runs = [np.stack([motion.q, motion.dq, motion.ddq, motion.tau]) for motion in motions]
        states = np.concatenate(of_runs, axis=1)
        step = max(1, states.shape[1] // STATES)
        self._states.append(states[:, ::step])

    def issues(self) -> list[TelemetryIssue]:
        """What all that was taken lacks, together.

        Runs, motion of every joint, and motion that tells the base parameters apart.

        Returns:
            Empty where nothing is lacking or nothing was taken.
        """
        first = self._first
        if first is None or not self._runs:
            return []
        issues = []
        if self._blocks < FEWEST_BLOCKS:
            issues.append(self._too_few(first))
        travel = self._high - self._low
        still = np.flatnonzero(travel < self._settings.least_travel)
        none_moves = len(still) == len(first.joints)
        if len(still):
            severity: Severity = "fatal" if none_moves else "warning"
            names = ", ".join(first.joints[joint] for joint in still)
            farthest = travel[still].max()
            issue = issue_of("still", first, still, None, severity, travel=farthest, names=names)
            issues.append(issue)
        if self._blocks >= FEWEST_BLOCKS:  # else that is what is wrong
            issues += self._check_independence(first)
        if self._arm is not None and self._states and not none_moves:
            condition = base_condition(np.concatenate(self._states, axis=1), self._arm)
            if condition > self._settings.largest_condition:
                issues.append(issue_of("condition", first, condition=condition))
        return issues

    def _too_few(self, first: Session) -> TelemetryIssue:
        """That there are too few blocks."""
        return issue_of(
            "too_few",
            first,
            runs=plural(self._runs, "run"),
            blocks=plural(self._blocks, "block"),
            least=FEWEST_BLOCKS,
            block=SHORTEST_BLOCK_S,
            length=FEWEST_BLOCKS * SHORTEST_BLOCK_S,
            seconds=self._seconds,
        )

    def _check_independence(self, first: Session) -> list[TelemetryIssue]:
        """Whether each joint's inertia and friction are shown apart from gravity.

        And more than once.
        """
        share, (up, down) = self._independence.shown()
        moving = np.isfinite(share)
        one_sinusoid = share < self._settings.least_share
        left_out = "a fifth of the recording" if self._runs == 1 else "one recording"
        words: dict[int, str] = {}
        for joint in map(int, np.flatnonzero(one_sinusoid)):
            words[joint] = (
                f"with {left_out} left out, all but {100 * share[joint]:.2g} % of its acceleration "
                "follows from its angle: it moves in one sinusoid, or nearly, and its inertia "
                "can't be told from gravity or a spring"
            )
        few = np.minimum(up, down) < self._settings.least_strokes
        for joint in map(int, np.flatnonzero(moving & ~one_sinusoid & few)):
            ways = f"{plural(up[joint], 'time')} up and {plural(down[joint], 'time')} down"
            words[joint] = f"it moves {ways}"
        if not words:
            return []
        worst, *others = words
        also = f"; likewise {', '.join(joints_at(first, others))}" if others else ""
        # Strokes that no other repeats still show gravity and friction; one sinusoid shows neither
        # apart.
        severity: Severity = "fatal" if one_sinusoid.sum() == moving.sum() else "warning"
        issue = issue_of(
            "dependent", first, words, worst, severity, reported=words[worst], others=also
        )
        return [issue]


def base_condition(states: Float[Array, "4 T n"], arm: ArmModel) -> float:
    """Condition number of some motion's base regressor.

    Its rows are per torque's spread, its columns of unit length.

    Args:
        states: Position, velocity, acceleration and torque [rad, rad/s, rad/s², N m].
        arm: Whose regressor it is.
    """
    step = max(1, states.shape[1] // STATES)
    tau = states[3]
    q, dq, ddq = states[:3, ::step]
    spread = tau.std(axis=0)
    # Without this, the shoulder's torque would drown what the wrist tells.
    least = 1e-3 * float(spread.max()) or 1.0  # a torque may be all zeros
    table = arm.regressor(q, dq, ddq) / np.maximum(spread, least)[:, None]
    triangle = np.linalg.qr(_in_unit_columns(table.reshape(-1, 10 * arm.n)), mode="r")
    # The best conditioned set of base columns, so that the figure tells the motion and not the
    # choice of columns.
    factor, _ = qr(triangle, mode="r", pivoting=True)
    values = np.linalg.svd(factor[:, : base_rank(arm)], compute_uv=False)
    return float(values[0] / max(values[-1], 1e-12 * values[0]))


def _in_unit_columns(table: Float[Array, "r c"]) -> Float[Array, "r c"]:
    """A table whose columns have unit length; those that are zero but for rounding are zero."""
    size = np.linalg.norm(table, axis=0)
    return table / np.where(size > 1e-9 * size.max(), size, np.inf)


def base_rank(arm: ArmModel) -> int:
    """Number of base parameters: the regressor's rank in general motion.

    Source: Gautier, Numerical calculation of the base inertial parameters of robots (1991).
    """
    # The rank is a property of the arm: fixed general states find it as well as any others.
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-np.pi, np.pi, (3, 60, arm.n))
    regressor = arm.regressor(q, dq, ddq)
    table: Float[Array, "r 10n"] = regressor.reshape(-1, 10 * arm.n)
    triangle = np.linalg.qr(_in_unit_columns(table), mode="r")
    return int(np.linalg.matrix_rank(triangle, tol=1e-8))
