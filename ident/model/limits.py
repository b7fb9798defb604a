"""Limits that a model must keep on recordings: a gate for the test run of a robot fleet.

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError
from ident.model.evaluation import SessionScore
from ident.safe_read import read_toml

SCHEMA = "ident.verification/1"
LARGEST, LEAST = ("torque_rmse_Nm", "energy_error_J"), ("r2_moving",)


@dataclass(frozen=True)
class Limit:
    """One figure and the value that it must keep to.

    Attributes:
        figure: A table of the file.
        joint: A joint's name, or `total`.
        bound: Largest value, or least value of an R².
    """

    figure: str
    joint: str
    bound: float


@dataclass(frozen=True)
class Check:
    """One limit on one session; a figure that the recordings can't tell does not pass."""

    session: str
    limit: Limit
    value: float | None

    @property
    def passed(self) -> bool:
        if self.value is None:
            return False
        return self.value >= self.limit.bound if self.limit.figure in LEAST else self.value <= self.limit.bound

    def to_dict(self) -> dict[str, Any]:
        return {"session": self.session, **vars(self.limit), "value": self.value, "passed": self.passed}


@dataclass(frozen=True)
class ModelLimits:
    """All limits of a file.

    Attributes:
        limits: In the file's order.
        rung: Rung of the ladder that must keep them; None for the last.
    """

    limits: tuple[Limit, ...]
    rung: str | None = None

    def check(self, score: SessionScore) -> tuple[Check, ...]:
        """Every limit on one session."""
        row = -1 if self.rung is None else score.rungs.index(self.rung)
        return tuple(Check(score.name, limit, _value(score, limit, row)) for limit in self.limits)


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
            limits.append(Limit(figure, joint, float(bound)))
    if not limits:
        raise InputError(path, "holds no limit", "give one, such as [torque_rmse_Nm] total = 2.0")
    return ModelLimits(tuple(limits), rung)


def _value(score: SessionScore, limit: Limit, row: int) -> float | None:
    column = len(score.joints) if limit.joint == "total" else score.joints.index(limit.joint)
    table = {
        "torque_rmse_Nm": score.rmse_mean,
        "energy_error_J": np.abs(score.energy_mean),
        "r2_moving": score.r2,
    }[limit.figure]
    value = float(table[row, column])
    return None if math.isnan(value) else value
