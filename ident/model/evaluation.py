"""How well a model explains runs that it never saw: energy error and torque error of every rung of the ladder.

Energy error of a run, joint by joint: E = ∫ (τ_model − τ_measured) dq dt, negative where the model knows too little
loss. Torque errors are taken after the common low-pass, so that they are the model's and not the sensor's, and where
the joint moves: a joint at rest carries any torque up to its Coulomb level, which no model of (q, dq, ddq) can tell.
The error at rest is given beside it.

Source: paper, tables 1 and 2 and figure 9.

Limits that a model must keep on recordings: a gate for the test run of a robot fleet.

A file of limits names figures of `ident evaluate`, each by joint or for the `total`:

    rung = "loss"                   # the last rung if not given
    [torque_rmse_Nm]
    joint_2 = 2.0
    total = 1.5
    [energy_error_J]                # of the mean over the runs, without sign
    total = 3.0
    [r2_moving]                     # a least value
    joint_1 = 0.98
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.results import ONE_RUN, Result
from ident.safe_read import read_toml

SCHEMA = "ident.evaluation/1"


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
        """Standard deviation over the runs; the last column is that of the sum over the joints [J]."""
        return self._with_total().std(axis=1)

    @property
    def rmse_mean(self) -> Float[Array, "R n+1"]:
        """Mean over the runs of the torque RMSE; the last column is over all joints together [N m]."""
        return _mean(self._rmse(self.squares), axis=1)

    @property
    def rmse_std(self) -> Float[Array, "R n+1"]:
        """Its standard deviation over the runs [N m]."""
        return np.sqrt(_mean((self._rmse(self.squares) - self.rmse_mean[:, None]) ** 2, axis=1))

    @property
    def rest_rmse(self) -> Float[Array, "R n+1"]:
        """Torque RMSE where the joints rest, over the runs: what dry friction hides [N m]."""
        return _mean(self._rmse(self.rest_squares), axis=1)

    def _with_total(self) -> Float[Array, "R K n+1"]:
        return np.concatenate([self.energy_error, self.energy_error.sum(axis=2, keepdims=True)], axis=2)

    @staticmethod
    def _rmse(squares: Float[Array, "R K n"]) -> Float[Array, "R K n+1"]:
        return np.sqrt(np.concatenate([squares, _mean(squares, axis=2)[..., None]], axis=2))

    def to_dict(self) -> dict[str, Any]:
        """For JSON, which knows no NaN: what a joint that never moves, or a single run, can't tell is null."""
        columns = [*self.joints, "total"]

        def table(values: Float[Array, "R k"]) -> dict[str, dict[str, float | None]]:
            cells = [[None if np.isnan(value) else float(value) for value in row] for row in values]
            rows = zip(self.rungs, cells, strict=True)
            return {rung: dict(zip(columns[: len(row)], row, strict=True)) for rung, row in rows}

        def spread(mean: Float[Array, "R k"], std: Float[Array, "R k"]) -> dict[str, Any]:
            if len(self.runs) > 1:
                return {"mean": table(mean), "std": table(std)}
            return {"mean": table(mean), "std": table(np.full_like(std, np.nan)), "std_missing": ONE_RUN}

        return {
            "session": self.name,
            "runs": len(self.runs),
            "payload_kg": self.payload_kg,
            "energy_error_J": spread(self.energy_mean, self.energy_std),
            "torque_rmse_Nm": spread(self.rmse_mean, self.rmse_std),
            "torque_rmse_at_rest_Nm": table(self.rest_rmse),
            "r2_moving": table(self.r2),
        }


@dataclass(frozen=True, eq=False)
class Evaluation(Result):
    """Scores of one model on several sessions; `pooled` takes those without payload together."""

    model: str
    robot: str
    sessions: tuple[SessionScore, ...]
    pooled: SessionScore
    traces: tuple[RunTrace, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "model": self.model,
            "robot": self.robot,
            "joints": list(self.pooled.joints),
            "sessions": [score.to_dict() for score in self.sessions],
            "pooled": self.pooled.to_dict(),
            "provenance": self.provenance.to_dict(),
        }


def trace_run(model: HybridModel, motion: Motion) -> RunTrace:
    """Every rung of a model on one run."""
    own = motion.select(model.joint_names)
    return RunTrace(own, model.ladder(own.q, own.dq, own.ddq, own.payload))


def evaluate(model: HybridModel, sessions: Sequence[tuple[str, Sequence[Motion]]], name: str = "model") -> Evaluation:
    """Scores a model on named groups of runs that its fit never saw.

    Args:
        model: The model.
        sessions: Names and runs.
        name: The model's name in reports.
    """
    traced = [(session, [trace_run(model, motion) for motion in motions]) for session, motions in sessions]
    scores = tuple(score_runs(session, traces) for session, traces in traced)
    free = [(session, traces) for session, traces in traced if traces[0].motion.payload is None] or traced
    pooled = score_runs(" + ".join(session for session, _ in free), [trace for _, traces in free for trace in traces])
    return Evaluation(name, model.robot.name, scores, pooled, tuple(trace for _, traces in traced for trace in traces))


def score_runs(name: str, traces: Sequence[RunTrace]) -> SessionScore:
    """Scores a group of runs."""
    rungs = tuple(traces[0].rungs)
    payload = traces[0].motion.payload
    errors = [{rung: t.motion.tau_filtered - t.filtered[rung] for rung in rungs} for t in traces]
    measured = np.concatenate([trace.motion.tau_filtered for trace in traces])
    moving = np.concatenate([trace.motion.moving for trace in traces])
    r2 = np.full((len(rungs), measured.shape[1]), np.nan)  # 1 − mean square error over variance: a bias is an error too
    for j, rows in enumerate(moving.T):
        variance = np.var(measured[rows, j]) if rows.sum() > 10 else 0.0
        for r, rung in enumerate(rungs if variance > 0.0 else ()):
            left = np.concatenate([error[rung][:, j] for error in errors])[rows]
            r2[r, j] = 1.0 - np.mean(left**2) / variance
    return SessionScore(
        name=name,
        joints=traces[0].motion.joints,
        runs=tuple(trace.motion.name for trace in traces),
        rungs=rungs,
        payload_kg=payload.mass_kg if payload else 0.0,
        energy_error=np.array([[trace.energy_error(rung) for trace in traces] for rung in rungs]),
        squares=_squares(traces, errors, rungs, moving=True),
        rest_squares=_squares(traces, errors, rungs, moving=False),
        r2=r2,
    )


def _squares(
    traces: Sequence[RunTrace], errors: Sequence[dict[str, Array]], rungs: Sequence[str], moving: bool
) -> Float[Array, "R K n"]:
    """Mean square error of each rung, run and joint over the samples where the joint moves, or rests."""
    where = [trace.motion.moving == moving for trace in traces]
    return np.array(
        [
            [_mean(np.where(w, error[rung] ** 2, np.nan), 0) for error, w in zip(errors, where, strict=True)]
            for rung in rungs
        ]
    )


def _mean(values: Array, axis: int) -> Array:
    """Mean of what is not NaN; NaN where nothing is."""
    there = ~np.isnan(values)
    count = there.sum(axis=axis)
    return np.where(count > 0, np.where(there, values, 0.0).sum(axis=axis) / np.maximum(count, 1), np.nan)


VERIFICATION_SCHEMA = "ident.verification/1"
LARGEST, LEAST = ("torque_rmse_Nm", "energy_error_J"), ("r2_moving",)


@dataclass(frozen=True)
class Check:
    """One limit on one session; a figure that the recordings can't tell does not pass."""

    session: str
    figure: str  # a table of the file
    joint: str  # a joint's name, or `total`
    bound: float  # largest value, or least value of an R²
    value: float | None

    @property
    def passed(self) -> bool:
        if self.value is None:
            return False
        return self.value >= self.bound if self.figure in LEAST else self.value <= self.bound

    def to_dict(self) -> dict[str, Any]:
        return {**vars(self), "passed": self.passed}


# Figure, joint and bound of each limit in the file's order, and the rung that must keep them; None for the last.
ModelLimits = tuple[list[tuple[str, str, float]], str | None]


def check_limits(score: SessionScore, limits: ModelLimits) -> tuple[Check, ...]:
    """Every limit on one session."""
    bounds, rung = limits
    row = -1 if rung is None else score.rungs.index(rung)
    columns = [*score.joints, "total"]
    tables = dict(zip((*LARGEST, *LEAST), (score.rmse_mean, np.abs(score.energy_mean), score.r2), strict=True))
    checks = []
    for figure, joint, bound in bounds:
        value = float(tables[figure][row, columns.index(joint)])
        checks.append(Check(score.name, figure, joint, bound, None if math.isnan(value) else value))
    return tuple(checks)


def load_limits(path: Path, joints: tuple[str, ...], rungs: tuple[str, ...]) -> ModelLimits:
    """Reads a file of limits.

    Args:
        path: The TOML file.
        joints: Joints of the model.
        rungs: Rungs of the model's ladder.

    Raises:
        InputError: Not TOML, an unknown figure, joint or rung, a bound that is no number, or no limit at all.
    """
    record = read_toml(path, "give a TOML file of limits")
    rung = record.pop("rung", None)
    if rung is not None and rung not in rungs:
        raise InputError(f"{path}, rung", f"{rung!r} is no rung of this model", f"use one of: {', '.join(rungs)}")
    limits = []
    for figure, table in record.items():
        if figure not in (*LARGEST, *LEAST):
            raise InputError(f"{path}, {figure}", "no such figure", f"use: rung, {', '.join((*LARGEST, *LEAST))}")
        if not isinstance(table, dict):
            raise InputError(f"{path}, {figure}", "is no table", f"write [{figure}] and one line a joint")
        names = joints if figure in LEAST else (*joints, "total")
        for joint, bound in table.items():
            where = f"{path}, {figure}.{joint}"
            if joint not in names:
                raise InputError(where, "no such joint in the model", f"use one of: {', '.join(names)}")
            if isinstance(bound, bool) or not isinstance(bound, (int, float)) or not math.isfinite(bound):
                raise InputError(where, f"{bound!r} is no number", "give a finite number")
            limits.append((figure, joint, float(bound)))
    if not limits:
        raise InputError(path, "holds no limit", "give one, such as [torque_rmse_Nm] total = 2.0")
    return limits, rung
