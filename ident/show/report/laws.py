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

DATA = "#7f7f7f"
LAW = NAMED
PLAIN = TUNED
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
        law = finding.estimate.refined
        beta = finding.estimate.coefficients
        series = analysis.series
        columns = law.effect.columns(analysis.session, law.joint, law.variant)
        joint = law.joint
        if law.effect.rows != "own":
            joint = _joint_of_largest_fall(analysis, finding)
        torques = []
        left = []
        for item, of_run in zip(series, columns, strict=True):
            whole = item.run.motion.filtered(of_run @ beta)
            torque = np.asarray(whole if whole.ndim == 1 else whole[:, joint])
            torques.append(torque)
            left.append(item.after[:, joint] + torque)
        return cls(joint, torques, left, series)

    def where(self) -> list[Array]:
        """Which samples of each run count: those where the joint moves steadily."""
        return [item.valid[:, self.joint] for item in self.items]

    def gathered(self, values: Sequence[Array]) -> Float[Array, " T"]:
        """Values of all runs where the joint moves steadily."""
        pairs = zip(values, self.where(), strict=True)
        return np.concatenate([of_run[inside] for of_run, inside in pairs])


def _joint_of_largest_fall(analysis: Analysis, finding: Finding) -> int:
    """The joint at which a finding lowers the error most."""
    falls = {}
    for name, before in finding.rms_before.items():
        falls[name] = before - finding.rms_after[name]
    most = max(falls, key=lambda name: falls[name])
    return analysis.diagnosis.joints.index(most)


def draw_laws(analysis: Analysis) -> tuple[LawPicture | None, ...]:
    """One picture a finding, in the order of the findings; None where nothing can be drawn."""
    findings = analysis.diagnosis.findings
    if not analysis.series:
        return (None,) * len(findings)
    return tuple(_draw_law(analysis, finding) for finding in findings)


def _draw_law(analysis: Analysis, finding: Finding) -> LawPicture | None:
    """A finding's picture; None where nothing can be drawn."""
    law = _Law.of(analysis, finding)
    effect = finding.estimate.group.effect
    if not sum(int(inside.sum()) for inside in law.where()):
        return None
    if effect.drawn_over in CURVES:
        return _over_curve(analysis, law, effect)
    return _over_time(analysis, law)


def _over_curve(analysis: Analysis, law: _Law, effect: Effect) -> LawPicture | None:
    """What is left without the law, and the law itself, over what it is a curve of."""
    name, unit, axis = CURVES[effect.drawn_over]
    j = law.joint
    joint = analysis.diagnosis.joints[j]
    x = law.gathered([axis(item, j) for item in law.items])
    data = law.gathered(law.left)
    curve = law.gathered(law.torque)
    plain = np.zeros_like(data)
    if effect.drawn == "whole":
        plain = _tuned_friction(analysis, law)
    sign = np.ones_like(x)
    if effect.drawn == "odd":
        speeds = [np.asarray(item.speed[:, j]) for item in law.items]
        sign = np.sign(law.gathered(speeds))
    edges = _edges(x)
    recorded = binned(x, sign * (plain + data), edges, LEAST_SAMPLES)
    with_law = binned(x, sign * (plain + curve), edges, LEAST_SAMPLES)
    without = binned(x, sign * plain, edges, LEAST_SAMPLES)
    if len(recorded) < 2:
        return None
    slides = bool(analysis.baseline.nominal.sliding_joints[j])
    load = unit_for(TORQUE, slides)
    unit = unit_for(unit, slides)
    what = "friction" if effect.drawn else "torque without the law"
    labels = f"{name} of {joint} [{unit}]", f"{what} [{load}]"
    figure, axes = make_panel(*labels, WIDE, left=0.65, bottom=0.45)
    for side in _unbroken(recorded):
        axes.fill_between(side[:, 0], side[:, 1], side[:, 3], color=DATA, alpha=0.25, linewidth=0)
    axes.plot(recorded[:, 0], recorded[:, 2], "o", color=DATA, markersize=3.5)
    for rows, colour, style in ((without, PLAIN, "--"), (with_law, LAW, "-")):
        for side in _unbroken(rows):
            axes.plot(side[:, 0], side[:, 2], style, color=colour, linewidth=1.6)
    rest = "zero, without it"
    if effect.drawn == "whole":
        rest = "Coulomb and viscous friction beside it"
    caption = (
        f"{what[0].upper()}{what[1:]} of {joint} over its {name}. Grey: recorded, medians and "
        f"80 % of the samples; green: with the named law; dashed: {rest}."
    )
    return LawPicture(to_svg(figure, caption), caption)


def _tuned_friction(analysis: Analysis, law: _Law) -> Float[Array, " T"]:
    """Coulomb and viscous friction as tuned beside the names [N m]."""
    assert analysis.diagnosis.details is not None, "an analysis has fitted something"
    j = law.joint
    tuned = analysis.diagnosis.details.baseline[analysis.diagnosis.joints[j]]
    filtered = []
    for item in law.items:
        run = item.run
        friction = tuned.coulomb * run.direction[:, j] + tuned.viscous * run.motion.dq[:, j]
        filtered.append(np.asarray(run.motion.filtered(friction)))
    return law.gathered(filtered)


def _edges(x: Float[Array, " T"]) -> Array:
    """Edges of bins of like counts, none across zero."""
    ends = []
    for side in (x[x < 0.0], x[x > 0.0]):
        if len(side):
            count = max(2, round(BINS * len(side) / max(len(x), 1)))
            ends.append(np.quantile(side, np.linspace(0.0, 1.0, count + 1)))
    return np.unique(np.concatenate(ends)) + 0.0


def _unbroken(rows: Float[Array, "b 4"]) -> list[Float[Array, "b 4"]]:
    """Negative and positive places apart: a line across zero would hide that friction jumps."""
    negative = rows[rows[:, 0] < 0.0]
    positive = rows[rows[:, 0] >= 0.0]
    return [side for side in (negative, positive) if len(side) > 1]


def _over_time(analysis: Analysis, law: _Law) -> LawPicture | None:
    """Residual without and with the law over the run in which it shows most."""
    places = law.where()
    power = []
    for torque, inside in zip(law.torque, places, strict=True):
        power.append(float(np.mean(torque[inside] ** 2)) if inside.any() else 0.0)
    k = int(np.argmax(power))
    item = law.items[k]
    inside = places[k]
    joint = analysis.diagnosis.joints[law.joint]
    if inside.sum() < LEAST_SAMPLES:
        return None
    time = item.time - item.time[0]
    slides = bool(analysis.baseline.nominal.sliding_joints[law.joint])
    load = unit_for(TORQUE, slides)
    labels = f"time in {item.run.motion.name} [s]", f"torque left [{load}]"
    figure, axes = make_panel(*labels, WIDE, left=0.65, bottom=0.45)
    without = law.left[k]
    with_law = law.left[k] - law.torque[k]
    for values, colour in ((without, PLAIN), (with_law, LAW)):
        shown = np.where(inside, values, np.nan)
        axes.plot(*thin(time, shown), color=colour, linewidth=0.8)
    of_law = np.where(inside, law.torque[k], np.nan)
    axes.plot(*thin(time, of_law), color=DATA, linewidth=1.4, linestyle=":")
    caption = (
        f"What the model leaves of {joint}'s torque in {item.run.motion.name}. Orange: without "
        "the named law; green: with it; grey, dotted: the law itself."
    )
    return LawPicture(to_svg(figure, caption), caption)
