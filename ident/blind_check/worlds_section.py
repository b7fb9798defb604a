"""Section of the page of a check: scores over what the worlds differ in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.blind_check.by_world import Stratum
from ident.blind_check.sections import BlindSection
from ident.show.report.figures import make_panel, to_svg
from ident.show.report.numbers import percent

TOLD = ("strict", "class_aware", "joint", "companion", "false_alarm", "told_gap")
AXIS_NAMES = {
    "encoder_noise_rad": "encoder noise and rounding [rad]",
    "rate_hz": "log rate [Hz]",
    "run_spread": "friction from run to run",
    "friction_drift": "drift of friction",
    "torque_noise": "torque noise [of rated]",
    "jitter": "jitter [of the interval]",
    "lost": "samples lost",
    "bandwidth_hz": "controller's bandwidth [Hz]",
    "friction_scale": "friction, of the usual",
    "rotor_scale": "rotor inertia, of the usual",
    "runs": "runs",
    "duration_s": "duration [s]",
    "link_error": "error of the URDF's masses",
    "world": "world",
    "robot": "arm",
    "velocity": "velocity channel",
    "encoder_at": "encoder on the",
    "feed_forward": "feed-forward",
    "reference": "reference",
}
# Curves: score, colour, name in the key.
CURVES = (
    ("strict", "#0b5394", "visible effects named"),
    ("told_gap", "#b45f06", "healthy told a gap"),
    ("false_alarm", "#990000", "healthy with a name"),
)
SLANT, STEEP = 20, 50  # of the names of strata, a few and many [deg]
TITLE_SHARE = 0.07  # of a panel's height for its title
SHIFT = 0.06  # of a panel's width between two intervals at one place


@dataclass(frozen=True, eq=False)
class WorldsSection(BlindSection):
    """A picture for each property, and all figures below."""

    anchor: ClassVar[str] = "worlds"
    title: ClassVar[str] = "In which worlds does it hold?"
    template: ClassVar[str] = "blind_worlds.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.worlds)

    def context(self) -> dict[str, Any]:
        worst = self.report.worst
        return {
            "worst": f"{_label(worst)}: {percent(worst.scores['strict'].value)} named" if worst else "",
            "curves": [{"colour": colour, "name": name} for _, colour, name in CURVES],
            "panels": [draw_axis(axis, strata) for axis, strata in self.report.worlds.items()],
            "rows": [_row(one) for strata in self.report.worlds.values() for one in strata],
        }


def _label(one: Stratum) -> str:
    name = AXIS_NAMES[one.axis]
    return f"{name} {one.value}" if one.value else f"{name} {_place(one)}"


def _place(one: Stratum) -> str:
    return one.value or (_short(one.low) if one.low == one.high else f"{_short(one.low)} to {_short(one.high)}")


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.2g}"


def _row(one: Stratum) -> dict[str, Any]:
    return {
        "axis": AXIS_NAMES[one.axis],
        "place": _place(one),
        "cases": one.cases,
        "values": [percent(one.scores[name].value) for name in TOLD],
    }


def draw_axis(axis: str, strata: Sequence[Stratum]) -> Any:
    """Scores over the strata of one property, with their intervals."""
    figure, axes = make_panel("", "share", size=(3.5, 2.3), bottom=0.85)
    places = np.arange(len(strata))
    for k, (name, colour, _) in enumerate(CURVES):
        told = [(i, one.scores[name]) for i, one in enumerate(strata) if one.scores[name].value is not None]
        if not told:
            continue
        x = np.array([i for i, _ in told]) + SHIFT * (k - 1) * 2.0
        y = np.array([score.value for _, score in told], dtype=float)
        low, high = (np.array([getattr(score, end) for _, score in told], dtype=float) for end in ("low", "high"))
        reach = np.maximum([y - low, high - y], 0.0)
        axes.errorbar(
            x,
            y,
            yerr=reach,
            fmt="o" if strata[0].value else "o-",
            color=colour,
            markersize=3.5,
            linewidth=0.8,
            alpha=0.9,
        )
    turned = len(strata) > 4 or any(len(_place(one)) > 10 for one in strata)
    axes.set_xticks(places, [_place(one) for one in strata])
    if turned:
        axes.tick_params(axis="x", labelrotation=STEEP if len(strata) > 6 else SLANT)
        for label in axes.get_xticklabels():
            label.set_horizontalalignment("right")
            label.set_rotation_mode("anchor")
    axes.set_xlim(-0.5, len(strata) - 0.5)
    axes.set_ylim(-0.03, 1.03)
    axes.set_title(AXIS_NAMES[axis], fontsize=8, loc="left", pad=3)
    box = axes.get_position()
    axes.set_position((box.x0, box.y0, box.width, box.height - TITLE_SHARE))
    return to_svg(figure, f"Scores by {AXIS_NAMES[axis]}")
