"""How well a model explains runs that it never saw: energy and torque error of every rung.

Energy error of a run, joint by joint: E = ∫ (τ_model − τ_measured) dq dt, negative where the model
knows too little loss. Torque errors are taken after the common low-pass, so that they are the
model's and not the sensor's, and where the joint moves: a joint at rest carries any torque up to
its Coulomb level, which no model of (q, dq, ddq) can tell. The error at rest is given beside it.

Source: paper, tables 1 and 2 and figure 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.records import JsonRecord
from ident.results import ONE_RUN, Result

SCHEMA = "ident.evaluation/1"
# A joint that moves in no more samples than this has no coefficient of determination.
FEWEST_SAMPLES = 10
# A table by rung and joint, of what JSON knows.
Table = dict[str, dict[str, float | None]]


@dataclass(frozen=True, eq=False)
class RunTrace:
    """One run through every rung, for scores and pictures."""

    motion: Motion  # the run, with the model's joints
    rungs: dict[str, Float[Array, "T n"]]  # torque of each rung, not filtered, shape (T, n) [N m]

    @cached_property
    def filtered(self) -> dict[str, Float[Array, "t n"]]:
        """Torque of each rung through the common filter [N m]."""
        return {name: self.motion.filtered(torque) for name, torque in self.rungs.items()}

    @property
    def time(self) -> Float[Array, " t"]:
        """Times of the filtered samples [s]."""
        return self.motion.time[self.motion.coarse]

    def error(self, rung: str) -> Float[Array, "t n"]:
        """Measured less modelled torque of the filtered samples [N m]."""
        return self.motion.tau_filtered - self.filtered[rung]

    def energy_error(self, rung: str) -> Float[Array, " n"]:
        """Modelled less measured work of each joint [J]."""
        power = (self.rungs[rung] - self.motion.tau) * self.motion.dq
        return np.trapezoid(power, dx=self.motion.interval, axis=0)


@dataclass(frozen=True, eq=False)
class SessionScore:
    """Scores of one group of runs; R rungs, K runs, n joints."""

    name: str  # name of the session, or of the sessions taken together
    joints: tuple[str, ...]  # joint names
    runs: tuple[str, ...]  # run names
    rungs: tuple[str, ...]  # rung names, from the analytic model up
    payload_kg: float  # known mass at the flange [kg]
    energy_error: Float[Array, "R K n"]  # energy error, shape (R, K, n) [J]
    # Mean square torque error where the joint moves, shape (R, K, n); NaN if it never does [N² m²].
    squares: Float[Array, "R K n"]
    rest_squares: Float[Array, "R K n"]  # the same where it rests [N² m²]
    r2: Float[Array, "R n"]  # coefficient of determination where the joint moves, shape (R, n)

    @property
    def energy_mean(self) -> Float[Array, "R n+1"]:
        """Mean energy error over the runs; the last column is the sum over the joints [J]."""
        return self._with_total().mean(axis=1)

    @property
    def energy_std(self) -> Float[Array, "R n+1"]:
        """Standard deviation over the runs [J]; last that of the sum over the joints."""
        return self._with_total().std(axis=1)

    @property
    def rmse_mean(self) -> Float[Array, "R n+1"]:
        """Mean over the runs of the torque RMSE [N m]; the last column is over all joints."""
        return _mean(self._rmse(self.squares), axis=1)

    @property
    def rmse_std(self) -> Float[Array, "R n+1"]:
        """Its standard deviation over the runs [N m]."""
        deviation = self._rmse(self.squares) - self.rmse_mean[:, None]
        return np.sqrt(_mean(deviation**2, axis=1))

    @property
    def rest_rmse(self) -> Float[Array, "R n+1"]:
        """Torque RMSE where the joints rest, over the runs: what dry friction hides [N m]."""
        return _mean(self._rmse(self.rest_squares), axis=1)

    def _with_total(self) -> Float[Array, "R K n+1"]:
        total = self.energy_error.sum(axis=2, keepdims=True)
        return np.concatenate([self.energy_error, total], axis=2)

    @staticmethod
    def _rmse(squares: Float[Array, "R K n"]) -> Float[Array, "R K n+1"]:
        total = _mean(squares, axis=2)[..., None]
        return np.sqrt(np.concatenate([squares, total], axis=2))

    def to_dict(self) -> JsonRecord:
        """For JSON, which knows no NaN.

        What a joint that never moves, or a single run, can't tell is null.

        Returns:
            "session", "runs" (their number), "payload_kg", "energy_error_J", "torque_rmse_Nm",
            "torque_rmse_at_rest_Nm" and "r2_moving".
        """
        return {
            "session": self.name,
            "runs": len(self.runs),
            "payload_kg": self.payload_kg,
            "energy_error_J": self._spread(self.energy_mean, self.energy_std),
            "torque_rmse_Nm": self._spread(self.rmse_mean, self.rmse_std),
            "torque_rmse_at_rest_Nm": self._table(self.rest_rmse),
            "r2_moving": self._table(self.r2),
        }

    def _table(self, values: Float[Array, "R k"]) -> Table:
        """Figures by rung and joint, with the total where there is a column for it."""
        columns = [*self.joints, "total"]
        rungs: Table = {}
        for rung, row in zip(self.rungs, values.tolist(), strict=True):
            cells = [None if np.isnan(value) else value for value in row]
            rungs[rung] = dict(zip(columns[: len(cells)], cells, strict=True))
        return rungs

    def _spread(
        self, mean: Float[Array, "R k"], std: Float[Array, "R k"]
    ) -> dict[str, Table | str]:
        """Mean and standard deviation over the runs; of a single run there is no deviation."""
        if len(self.runs) > 1:
            return {"mean": self._table(mean), "std": self._table(std)}
        missing = self._table(np.full_like(std, np.nan))
        return {"mean": self._table(mean), "std": missing, "std_missing": ONE_RUN}


@dataclass(frozen=True, eq=False)
class Evaluation(Result):
    """Scores of one model on several sessions; `pooled` takes those without payload together."""

    model: str
    robot: str
    sessions: tuple[SessionScore, ...]
    pooled: SessionScore
    traces: tuple[RunTrace, ...]
    fitted_files: int = 0  # how many of the files that were read the model was fitted to

    def to_dict(self) -> JsonRecord:
        return {
            "schema": SCHEMA,
            "model": self.model,
            "robot": self.robot,
            "fitted_files": self.fitted_files,
            "joints": list(self.pooled.joints),
            "sessions": [score.to_dict() for score in self.sessions],
            "pooled": self.pooled.to_dict(),
            "provenance": self.provenance.to_dict(),
        }


def trace_run(model: HybridModel, motion: Motion) -> RunTrace:
    """Every rung of a model on one run."""
    selected = motion.select(model.joint_names)
    q = selected.q
    dq = selected.dq
    ddq = selected.ddq
    return RunTrace(selected, model.ladder(q, dq, ddq, selected.payload))


def evaluate(
    model: HybridModel, sessions: Sequence[tuple[str, Sequence[Motion]]], name: str = "model"
) -> Evaluation:
    """Scores a model on named groups of runs that its fit never saw.

    Args:
        model: The model.
        sessions: Names and runs.
        name: The model's name in reports.
    """
    scores = []
    traces: list[RunTrace] = []
    without_payload: list[tuple[str, list[RunTrace]]] = []
    for session, motions in sessions:
        session_traces = [trace_run(model, motion) for motion in motions]
        scores.append(score_runs(session, session_traces))
        traces += session_traces
        if session_traces[0].motion.payload is None:
            without_payload.append((session, session_traces))
    pooled_name = " + ".join(session for session, _ in without_payload or sessions)
    pooled_traces = [trace for _, group in without_payload for trace in group]
    pooled = score_runs(pooled_name, pooled_traces or traces)
    return Evaluation(name, model.robot.name, tuple(scores), pooled, tuple(traces))


def score_runs(name: str, traces: Sequence[RunTrace]) -> SessionScore:
    """Scores a group of runs."""
    first = traces[0]
    rungs = tuple(first.rungs)
    payload = first.motion.payload
    energy = []
    squares = []
    rest_squares = []
    for rung in rungs:
        energy.append([trace.energy_error(rung) for trace in traces])
        squares.append([_mean_square(trace, rung, moving=True) for trace in traces])
        rest_squares.append([_mean_square(trace, rung, moving=False) for trace in traces])
    return SessionScore(
        name=name,
        joints=first.motion.joints,
        runs=tuple(trace.motion.name for trace in traces),
        rungs=rungs,
        payload_kg=payload.mass_kg if payload else 0.0,
        energy_error=np.array(energy),
        squares=np.array(squares),
        rest_squares=np.array(rest_squares),
        r2=_determination(traces, rungs),
    )


def _determination(traces: Sequence[RunTrace], rungs: Sequence[str]) -> Float[Array, "R n"]:
    """1 − mean square error over variance, where a joint moves: a bias is an error too."""
    measured = np.concatenate([trace.motion.tau_filtered for trace in traces])
    moving = np.concatenate([trace.motion.moving for trace in traces])
    r2 = np.full((len(rungs), measured.shape[1]), np.nan)
    for r, rung in enumerate(rungs):
        left = np.concatenate([trace.error(rung) for trace in traces])
        for j, rows in enumerate(moving.T):
            if rows.sum() <= FEWEST_SAMPLES:
                continue
            variance = np.var(measured[rows, j])
            if variance > 0.0:
                square = np.mean(left[rows, j] ** 2)
                r2[r, j] = 1.0 - square / variance
    return r2


def _mean_square(trace: RunTrace, rung: str, moving: bool) -> Float[Array, " n"]:
    """Mean square error of each joint over the samples where it moves, or rests [N² m²]."""
    counts = trace.motion.moving == moving
    return _mean(np.where(counts, trace.error(rung) ** 2, np.nan), 0)


def _mean(values: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """Mean of what is not NaN; NaN where nothing is."""
    there = ~np.isnan(values)
    count = there.sum(axis=axis)
    total = np.where(there, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
