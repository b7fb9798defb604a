"""What a diagnosis adds to the timeline.

What is left at each joint, and where that stands highest above the noise.
"""

from __future__ import annotations

import numpy as np

from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.gap_map import session_axes
from ident.show.palette import NAMED, TUNED
from ident.show.report.words import axis_name, interval_words
from ident.show.timeline.series import Curve, Mark

MOST_MARKS = 60
MARK_LENGTH = 0.5  # [s]
# Mean square of a stretch that is marked, in units of the noise's.
MARK_FROM = 4.0


def gap_marks(analysis: Analysis) -> list[Mark]:
    """The half seconds in which a joint's residual stands highest above its noise, and the cells
    that they lie in.
    """
    highest: list[tuple[float, int, int, slice]] = []
    level = np.maximum(analysis.evidence.floor, 1e-9)
    for k, item in enumerate(analysis.series):
        width = max(1, round(MARK_LENGTH / item.step))
        power = np.where(item.valid, (item.before / level) ** 2, 0.0)
        for start in range(0, len(power) - width + 1, width):
            rows = slice(start, start + width)
            heights = power[rows].mean(axis=0)
            highest += [
                (float(heights[j]), k, int(j), rows) for j in np.flatnonzero(heights > MARK_FROM)
            ]
    highest.sort(key=lambda stretch: -stretch[0])
    axes = session_axes(analysis.series)
    sure = analysis.diagnosis.settings.gap.map.significant
    marks = []
    for height, k, j, rows in highest[:MOST_MARKS]:
        item = analysis.series[k]
        name = analysis.diagnosis.joints[j]
        words = [f"gap {np.sqrt(height):.1f} times the noise"]
        for place in analysis.diagnosis.where:
            if place.joint == name and place.axis in axes and place.p_value <= sure:
                middle = float(np.median(axes[place.axis](item, j)[rows]))
                if place.low <= middle <= place.high:
                    interval = interval_words(place.axis, place.low, place.high)
                    words.append(f"{axis_name(place.axis)} {interval}")
        marks.append(
            Mark(item.index, rows.start * item.step, rows.stop * item.step, name, ", ".join(words))
        )
    return marks


def gap_curves(analysis: Analysis) -> list[list[Curve]]:
    """What the tuned model leaves, run by run, with the named effects and without.

    The latter last: it is marked.
    """
    rungs = [("tuned", "after tuning", TUNED)]
    if analysis.diagnosis.findings:
        rungs.insert(0, ("named", "with the named effects", NAMED))
    curves: list[list[Curve]] = [[] for _ in analysis.session.runs]
    for item in analysis.series:
        curves[item.index] = [
            Curve(
                joint,
                ("residual", rung),
                words,
                colour,
                (item.after if rung == "named" else item.before)[:, j],
            )
            for j, joint in enumerate(analysis.diagnosis.joints)
            for rung, words, colour in rungs
        ]
    return curves
