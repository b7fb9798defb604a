"""Several models or sessions side by side, as the paper's figure 9: bars with their standard deviation."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.errors import plural
from ident.model.evaluation import Evaluation, SessionScore
from ident.model.hybrid import HybridModel
from ident.show.palette import model_colour
from ident.show.report.figures import WIDE, make_panel, to_svg
from ident.show.report.numbers import pair, table_places
from ident.show.report.page import Section
from ident.show.report.source import ReportInput, pool_name

TICK_WIDTH = 16  # [characters]


@dataclass(frozen=True, eq=False)
class ComparisonSection(Section):
    """The last rung of every model on every session without payload, over the joints that all models have."""

    source: ReportInput
    anchor: ClassVar[str] = "comparison"
    title: ClassVar[str] = "Side by side"
    template: ClassVar[str] = "comparison.html"

    @property
    def is_present(self) -> bool:
        return len(self.source.evaluations) > 1 or len(compared_scores(self.source.evaluation)) > 1

    def context(self) -> dict[str, Any]:
        evaluations = self.source.evaluations
        joints = tuple(
            joint for joint in evaluations[0].pooled.joints if all(joint in e.pooled.joints for e in evaluations)
        )
        groups = [[restrict(score, joints) for score in compared_scores(one)] for one in evaluations]
        names = [pool_name(score, 24) for score in groups[0]]
        several = [len(score.runs) > 1 for score in groups[0]]
        energy, energy_std = _totals(groups, "energy_mean"), _totals(groups, "energy_std")
        torque, torque_std = _totals(groups, "rmse_mean"), _totals(groups, "rmse_std")
        models = [one.model for one in evaluations]
        return {
            "models": [(name, model_colour(k)) for k, name in enumerate(models)],
            "joints": joints,
            "all_joints": all(len(one.pooled.joints) == len(joints) for one in evaluations),
            "sessions": names,
            "figures": [
                draw_bars("energy error of a run [J]", names, models, energy, energy_std),
                draw_bars("torque error, RMS [N m]", names, models, torque, torque_std),
            ],
            "rows": [
                _row(
                    model, one, k, _cells(energy[k], energy_std[k], several), _cells(torque[k], torque_std[k], several)
                )
                for k, (model, one) in enumerate(zip(self.source.models, evaluations, strict=True))
            ],
        }


def compared_scores(evaluation: Evaluation) -> list[SessionScore]:
    """Sessions without payload and, where there are several, all of them together; all sessions if each has one."""
    free = [score for score in evaluation.sessions if score.payload_kg == 0] or list(evaluation.sessions)
    return [*free, evaluation.pooled] if len(free) > 1 else free


def restrict(score: SessionScore, joints: tuple[str, ...]) -> SessionScore:
    """The same scores over some joints only: totals of other joints can't be compared."""
    columns = [score.joints.index(joint) for joint in joints]
    return replace(
        score,
        joints=joints,
        energy_error=score.energy_error[..., columns],
        squares=score.squares[..., columns],
        rest_squares=score.rest_squares[..., columns],
        r2=score.r2[:, columns],
    )


def draw_bars(
    label: str,
    sessions: list[str],
    models: list[str],
    mean: Float[Array, "m s"],
    std: Float[Array, "m s"],
) -> dict[str, Any]:
    """Grouped bars: one group a session, one bar a model, black lines one standard deviation each way."""
    ticks = [textwrap.fill(name, TICK_WIDTH) for name in sessions]
    lines = max(tick.count("\n") for tick in ticks)
    figure, axes = make_panel("evaluated on", label, WIDE, bottom=0.42 + 0.13 * lines)
    width = 0.8 / len(models)
    for k in range(len(models)):
        x = np.arange(len(sessions)) + (k - (len(models) - 1) / 2) * width
        axes.bar(x, mean[k], 0.88 * width, color=model_colour(k))
        axes.errorbar(x, mean[k], std[k], fmt="none", ecolor="#111111", elinewidth=0.9, capsize=2)
    axes.axhline(0.0, color="#333333", linewidth=0.6)
    axes.set_xticks(np.arange(len(sessions)), ticks)
    return {"title": label[0].upper() + label[1:], "svg": to_svg(figure, f"{label} of {', '.join(models)}")}


def _totals(groups: list[list[SessionScore]], name: str) -> Float[Array, "m s"]:
    return np.array([[getattr(score, name)[-1, -1] for score in scores] for scores in groups])


def _cells(mean: Float[Array, " s"], std: Float[Array, " s"], several: list[bool]) -> list[str]:
    places = table_places(mean)
    return [pair(a, b if more else None, places) for a, b, more in zip(mean, std, several, strict=True)]


def _row(
    model: HybridModel, evaluation: Evaluation, index: int, energy: list[str], torque: list[str]
) -> dict[str, Any]:
    past = model.provenance
    trained = f"{plural(past['runs'], 'run')}, {past['samples']:,} samples" if "samples" in past else "not recorded"
    return {
        "name": evaluation.model,
        "colour": model_colour(index),
        "trained": trained,
        "joints": len(model.joint_names),
        "inertia": model.inertia,
        "net": f"{past.get('net_parameters', 0):,}" if model.net is not None else "none",
        "energy": energy,
        "torque": torque,
    }
