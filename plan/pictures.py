"""Pictures of plans: motion, torques before and after, power, and cost against evaluations and time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from ident.files import atomic_write
from plan.compare import Comparison
from plan.problem import PlanningProblem
from plan.result import PlanResult
from plan.spline import Splines

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

SAMPLES = 400
BEFORE, AFTER, LIMIT = "#9aa5b1", "#0b6e99", "#b3261e"


def save_figure(figure: Figure, path: str | Path) -> None:
    """Writes a figure, whole or not at all."""
    with atomic_write(path) as part:
        figure.savefig(part, dpi=130, bbox_inches="tight")
    plt.close(figure)


def draw_motion(problem: PlanningProblem, result: PlanResult) -> Figure:
    """Angles, torques against their limits and power of a plan, a column a joint, with the initial motion behind.

    The torque row is the paper's Fig. 13: before and after.
    """
    assert result.splines is not None
    n = problem.n
    figure, axes = plt.subplots(3, n, figsize=(3.2 * n, 7), sharex=True, squeeze=False)
    before = problem.decode(problem.initial)
    for splines, colour, label in ((before, BEFORE, "initial"), (result.splines, AFTER, result.method)):
        times, q, dq, tau = _profiles(problem, splines)
        for j in range(n):
            axes[0, j].plot(times, np.degrees(q[:, j]), color=colour, label=label)
            axes[1, j].plot(times, tau[:, j], color=colour)
            axes[2, j].plot(times, tau[:, j] * dq[:, j], color=colour)
    stamps = np.cumsum(result.splines.durations[0])[:-1]
    for j in range(n):
        if len(stamps) <= 10:
            axes[0, j].plot(stamps, np.degrees(result.splines.points[0, 1:-1, j]), "o", color=AFTER, ms=4)
        _draw_limits(axes[1, j], problem.limits.torque[j])
        axes[0, j].set_title(problem.scene.arm.joint_names[j])
        axes[2, j].set_xlabel("time [s]")
        axes[2, j].axhline(0, color="#cccccc", lw=0.8, zorder=0)
    for row, name in enumerate(("angle [deg]", "torque [N m]", "power [W]")):
        axes[row, 0].set_ylabel(name)
    axes[0, 0].legend(frameon=False, fontsize=8)
    figure.suptitle(f"{result.method}: {result.cost:.4g} {'s' if result.objective == 'time' else 'J'}")
    figure.tight_layout()
    return figure


def draw_comparison(comparison: Comparison) -> Figure:
    """Best cost against evaluations and against time: the median run of every method, all seeds in thin lines."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True)
    colours = plt.get_cmap("tab10")
    everything = []
    for i, method in enumerate(comparison.methods):
        runs = comparison.of(method)
        order = np.argsort([run.cost for run in runs])
        middle = runs[int(order[len(order) // 2])]
        for axis, column in zip(axes, (0, 1), strict=True):
            for run in runs:
                _draw_history(axis, run, column, colours(i), run is middle, method)
        everything += [row[2] for run in runs for row in run.history if np.isfinite(row[2])]
    if everything:
        low, high = min(everything), float(np.quantile(everything, 0.9))
        axes[0].set_ylim(low - 0.05 * (high - low), high + 0.3 * (high - low))
    axes[0].set_ylabel("best cost " + ("[s]" if comparison.objective == "time" else "[J]"))
    for axis, name in zip(axes, ("evaluations", "time [s]"), strict=True):
        axis.set_xscale("log")
        axis.set_xlabel(name)
        axis.grid(alpha=0.25)
    axes[0].legend(frameon=False, fontsize=8)
    figure.suptitle(comparison.name)
    figure.tight_layout()
    return figure


def _draw_history(axis: Any, run: PlanResult, column: int, colour: Any, middle: bool, label: str) -> None:
    rows = [row for row in run.history if np.isfinite(row[2])]
    if not rows:
        return
    x = [max(row[column], 1e-3) for row in rows]
    x.append(max(run.evaluations if column == 0 else run.seconds, x[-1]))
    y = [row[2] for row in rows]
    axis.step(
        x,
        [*y, y[-1]],
        where="post",
        color=colour,
        lw=1.8 if middle else 0.6,
        alpha=1.0 if middle else 0.4,
        label=label if middle else None,
    )
    axis.plot(x[-1], y[-1], "o", color=colour, ms=4 if middle else 2)


def _draw_limits(axis: Any, limit: float) -> None:
    for value in (-limit, limit):
        axis.axhline(value, color=LIMIT, lw=1)


def _profiles(problem: PlanningProblem, splines: Splines) -> tuple[Any, Any, Any, Any]:
    times = np.linspace(0.0, float(splines.total[0]), SAMPLES)
    q, dq, ddq = splines.at(times)
    return times, q, dq, problem.model.torque(q[None], dq[None], ddq[None])[0]
