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

import numpy as np

from ident.errors import InputError
from ident.model.evaluation import SessionScore
from ident.safe_read import read_toml, require_finite

VERIFICATION_SCHEMA = "ident.verification/1"
# Figures whose bound is a largest value, and those whose bound is a least one.
LARGEST = ("torque_rmse_Nm", "energy_error_J")
LEAST = ("r2_moving",)
# Figure, joint and bound of each limit in the file's order, and the rung that must keep them; None
# for the last.
ModelLimits = tuple[list[tuple[str, str, float]], str | None]


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
        """Whether the limit is kept."""
        if self.value is None:
            return False
        if self.figure in LEAST:
            return self.value >= self.bound
        return self.value <= self.bound

    def to_dict(self) -> dict[str, object]:
        """Its fields by their names, and "passed"."""
        return {**vars(self), "passed": self.passed}


def check_limits(score: SessionScore, limits: ModelLimits) -> tuple[Check, ...]:
    """Every limit on one session."""
    bounds, rung = limits
    row = -1 if rung is None else score.rungs.index(rung)
    columns = [*score.joints, "total"]
    tables = {
        "torque_rmse_Nm": score.rmse_mean,
        "energy_error_J": np.abs(score.energy_mean),
        "r2_moving": score.r2,
    }
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
        InputError: Not TOML, an unknown figure, joint or rung, a bound that is no number, or no
            limit.
    """
    record = read_toml(path, "give a TOML file of limits")
    rung = record.pop("rung", None)
    if rung is not None and rung not in rungs:
        what = f"{rung!r} is no rung of this model"
        raise InputError(f"{path}, rung", what, f"use one of: {', '.join(rungs)}")
    limits = []
    for figure, table in record.items():
        where = f"{path}, {figure}"
        if figure not in (*LARGEST, *LEAST):
            names = ", ".join((*LARGEST, *LEAST))
            raise InputError(where, "no such figure", f"use: rung, {names}")
        if not isinstance(table, dict):
            raise InputError(where, "is no table", f"write [{figure}] and one line a joint")
        columns = joints if figure in LEAST else (*joints, "total")
        for joint, bound in table.items():
            number = _read_bound(f"{where}.{joint}", figure, joint, bound, columns)
            limits.append((figure, joint, number))
    if not limits:
        raise InputError(path, "holds no limit", "give one, such as [torque_rmse_Nm] total = 2.0")
    return limits, rung


def _read_bound(
    where: str, figure: str, joint: str, bound: object, columns: tuple[str, ...]
) -> float:
    """The bound of a figure of a joint, or of the total.

    Raises:
        InputError: There is no such joint, or the bound is no finite number, or one that no model
            can keep.
    """
    if joint not in columns:
        remedy = f"use one of: {', '.join(columns)}"
        raise InputError(where, "no such joint in the model", remedy)
    try:
        number = require_finite(bound, joint)
    except ValueError as error:
        raise InputError(where, str(error), "give a finite number") from None
    # A bound that nothing can keep is a slip of the pen, not a gate that no model passes.
    if figure in LARGEST and number < 0.0:
        what = f"{number:g} is negative, which no {figure} is"
        raise InputError(where, what, "give the largest value that passes")
    if figure in LEAST and number > 1.0:
        what = f"{number:g} is above 1, which no {figure} is"
        raise InputError(where, what, "give the least value that passes, such as 0.98")
    return number
