"""Plans, comparisons and motions to record in words and pictures, for Python and notebooks."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from ident.results import Result
from ident.show.panels import panel
from ident.trajectories.reference import TICK_S
from plan.experiment.result import Excitation
from plan.problem.result import PlanResult
from plan.show.console import print_comparison, print_excitation, print_result
from plan.solving.compare import Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 300


def write(console: Console, result: PlanResult | Comparison | Excitation) -> None:
    """Prints a result in plain lines, as the command does."""
    if isinstance(result, PlanResult):
        print_result(console, result)
    elif isinstance(result, Comparison):
        print_comparison(console, result)
    else:
        print_excitation(console, result)


@singledispatch
def draw(result: Result) -> Figure:
    """A result as a picture."""
    raise TypeError(f"{type(result).__name__} has no picture")


@draw.register(PlanResult)
def _(result: PlanResult) -> Figure:
    """Angles over time; empty where there is no plan."""
    figure, axes = panel("time [s]", "angle [deg]", f"{result.status} by {result.method}")
    if result.splines is not None:
        times = np.linspace(0.0, float(result.splines.total[0]), SAMPLES)
        angles = np.degrees(result.splines.at(times)[0])
        for j in range(angles.shape[1]):
            axes.plot(times, angles[:, j], label=f"joint {j + 1}")
        axes.legend(fontsize=7)
    return figure


@draw.register(Comparison)
def _(result: Comparison) -> Figure:
    from plan.show.pictures import draw_comparison

    return draw_comparison(result)


@draw.register(Excitation)
def _(result: Excitation) -> Figure:
    """The motion's first run, joint by joint."""
    figure, axes = panel("time [s]", "position", f"{result.status}: {', '.join(result.effects) or result.aim}")
    for motion in result.runs[:1]:
        step = max(1, len(motion.q) // SAMPLES)
        for j, joint in enumerate(result.noise):
            axes.plot(TICK_S * np.arange(len(motion.q))[::step], motion.q[::step, j], label=joint)
        axes.legend(fontsize=7)
    return figure
