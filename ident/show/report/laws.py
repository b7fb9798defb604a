"""A picture of each named law over the data: what is left without it, against what it goes with,
and its curve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ident.arrays import Array, Float
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.gap_map import reversal_age
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.result import Finding
from ident.effects.base import Effect
from ident.show.palette import NAMED, TUNED
from ident.show.report.figures import WIDE, binned, make_panel, thin, to_svg
from ident.units import ANGLE, SPEED, TIME, TORQUE, unit_for

DATA, LAW, PLAIN = "#7f7f7f", NAMED, TUNED
BINS = 18
# Bins of fewer samples than this say nothing.
LEAST_SAMPLES = 8

Axis = Callable[[RunResidual, int], Float[Array, " t"]]
# What a law is a curve over (`Effect.drawn_over`), with the unit of the axis where a joint turns.
CURVES: Mapping[str, tuple[str, str, Axis]] = {
    "speed": ("speed", SPEED, lambda item, j: np.asarray(item.speed[:, j])),
    "angle": (
        "angle",
        ANGLE,
        lambda item, j: np.asarray(item.run.motion.q[item.run.motion.coarse][:, j]),
    ),
    "load": (
        "load",
        TORQUE,
        lambda item, j: np.asarray(item.run.link[item.run.motion.coarse][:, j]),
    ),
    "torque": (
        "torque",
        TORQUE,
        lambda item, j: np.asarray(item.run.total[item.run.motion.coarse][:, j]),
    ),
    "reversal": ("time since it turned round", TIME, reversal_age),
}


@dataclass(frozen=True, eq=False)
class LawPicture:
    """One finding's picture."""

    svg: Markup  # the picture
    caption: str  # what it shows, in words


@dataclass(frozen=True, eq=False)
class _Law:
    """A finding's own torque, run by run, beside what is left without it."""

    joint: int  # the joint that is shown
    torque: list[Float[Array, " t"]]  # of the law, one array a run [N m]
    left: list[Float[Array, " t"]]  # what all other names leave [N m]
    items: Sequence[RunResidual]  # the runs

    @classmethod
    def of(cls, analysis: Analysis, finding: Finding) -> _Law:
        """That of a finding, at the joint where it tells most."""
        law, beta = finding.estimate.refined, finding.estimate.coefficients
        session, series = analysis.session, analysis.series
        columns = law.effect.columns(session, law.joint, law.variant)
        if law.effect.rows == "own":
            joint = law.joint
        else:
            falls = {
                name: before - finding.rms_after[name]
                for name, before in finding.rms_before.items()
            }
            joint = analysis.diagnosis.joints.index(max(falls, key=lambda name: falls[name]))
        torque = []
        for item, one in zip(series, columns, strict=True):
            whole = item.run.motion.filtered(one @ beta)
            torque.append(np.asarray(whole if whole.ndim == 1 else whole[:, joint]))
        return cls(
            joint,
            torque,
            [item.after[:, joint] + own for item, own in zip(series, torque, strict=True)],
            series,
        )

    def where(self) -> list[Array]:
        return [item.valid[:, self.joint] for item in self.items]

    def gathered(self, values: Sequence[Array]) -> Float[Array, " T"]:
        """Values of all runs where the joint moves steadily."""
        return np.concatenate(
            [one[inside] for one, inside in zip(values, self.where(), strict=True)]
        )


def draw_laws(analysis: Analysis) -> tuple[LawPicture | None, ...]:
    """One picture a finding, in the order of the findings; None where nothing can be drawn."""
    pictures: list[LawPicture | None] = []
    for finding in analysis.diagnosis.findings if analysis.series else ():
        law, effect = _Law.of(analysis, finding), finding.estimate.group.effect
        if not sum(int(inside.sum()) for inside in law.where()):
            pictures.append(None)
        elif effect.drawn_over in CURVES:
            pictures.append(_over_curve(analysis, law, effect))
        else:
            pictures.append(_over_time(analysis, law))
    return tuple(pictures) if analysis.series else (None,) * len(analysis.diagnosis.findings)


def _over_curve(analysis: Analysis, law: _Law, effect: Effect) -> LawPicture | None:
    name, unit, axis = CURVES[effect.drawn_over]
    joint, j = analysis.diagnosis.joints[law.joint], law.joint
    x = law.gathered([axis(item, j) for item in law.items])
    data, curve = law.gathered(law.left), law.gathered(law.torque)
    plain = np.zeros_like(data)
    if effect.drawn == "whole":  # Coulomb and viscous friction as tuned beside the names [N m]
        assert analysis.diagnosis.details is not None, "an analysis has fitted something"
        tuned, runs = analysis.diagnosis.details.baseline[joint], [item.run for item in law.items]
        friction = [
            tuned.coulomb * run.direction[:, j] + tuned.viscous * run.motion.dq[:, j]
            for run in runs
        ]
        plain = law.gathered(
            [np.asarray(run.motion.filtered(one)) for run, one in zip(runs, friction, strict=True)]
        )
    sign = np.ones_like(x)
    if effect.drawn == "odd":
        sign = np.sign(law.gathered([np.asarray(item.speed[:, j]) for item in law.items]))
    # Bins of like counts, none across zero.
    sides = [side for side in (x[x < 0.0], x[x > 0.0]) if len(side)]
    counts = [max(2, round(BINS * len(side) / max(len(x), 1))) for side in sides]
    ends = [
        np.quantile(side, np.linspace(0.0, 1.0, k + 1))
        for side, k in zip(sides, counts, strict=True)
    ]
    edges = np.unique(np.concatenate(ends)) + 0.0
    found = [
        binned(x, sign * values, edges, LEAST_SAMPLES)
        for values in (plain + data, plain + curve, plain)
    ]
    if len(found[0]) < 2:
        return None
    slides = bool(analysis.baseline.nominal.sliding_joints[j])
    load = unit_for(TORQUE, slides)
    unit = unit_for(unit, slides)
    what = "friction" if effect.drawn else "torque without the law"
    figure, axes = make_panel(
        f"{name} of {joint} [{unit}]", f"{what} [{load}]", WIDE, left=0.65, bottom=0.45
    )
    for part in _unbroken(found[0]):
        axes.fill_between(part[:, 0], part[:, 1], part[:, 3], color=DATA, alpha=0.25, linewidth=0)
    axes.plot(found[0][:, 0], found[0][:, 2], "o", color=DATA, markersize=3.5)
    for rows, colour, style in ((found[2], PLAIN, "--"), (found[1], LAW, "-")):
        for part in _unbroken(rows):
            axes.plot(part[:, 0], part[:, 2], style, color=colour, linewidth=1.6)
    rest = (
        "Coulomb and viscous friction beside it" if effect.drawn == "whole" else "zero, without it"
    )
    caption = (
        f"{what[0].upper()}{what[1:]} of {joint} over its {name}. Grey: recorded, medians and "
        f"80 % of the samples; green: with the named law; dashed: {rest}."
    )
    return LawPicture(to_svg(figure, caption), caption)


def _unbroken(rows: Float[Array, "b 4"]) -> list[Float[Array, "b 4"]]:
    """Negative and positive places apart: a line across zero would hide that friction jumps."""
    negative = rows[rows[:, 0] < 0.0]
    positive = rows[rows[:, 0] >= 0.0]
    return [side for side in (negative, positive) if len(side) > 1]


def _over_time(analysis: Analysis, law: _Law) -> LawPicture | None:
    """Residual without and with the law over the run in which it shows most."""
    power = [
        float(np.mean(own[inside] ** 2)) if inside.any() else 0.0
        for own, inside in zip(law.torque, law.where(), strict=True)
    ]
    k = int(np.argmax(power))
    item, inside, joint = law.items[k], law.where()[k], analysis.diagnosis.joints[law.joint]
    if inside.sum() < LEAST_SAMPLES:
        return None
    time = item.time - item.time[0]
    load = unit_for(TORQUE, bool(analysis.baseline.nominal.sliding_joints[law.joint]))
    labels = f"time in {item.run.motion.name} [s]", f"torque left [{load}]"
    figure, axes = make_panel(*labels, WIDE, left=0.65, bottom=0.45)
    for values, colour, width in (
        (law.left[k], PLAIN, 0.8),
        (law.left[k] - law.torque[k], LAW, 0.8),
    ):
        axes.plot(*thin(time, np.where(inside, values, np.nan)), color=colour, linewidth=width)
    axes.plot(
        *thin(time, np.where(inside, law.torque[k], np.nan)),
        color=DATA,
        linewidth=1.4,
        linestyle=":",
    )
    caption = (
        f"What the model leaves of {joint}'s torque in {item.run.motion.name}. Orange: without "
        "the named law; green: with it; grey, dotted: the law itself."
    )
    return LawPicture(to_svg(figure, caption), caption)
