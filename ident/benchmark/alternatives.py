"""What every name alone would close on held-out runs: the yardstick of an oracle that is told the effect.

It is measured for all names alike, so that nobody has to tell the diagnosing process which one is true. Where wrong
inertias could do the same as an effect, tuning them hides it: such effects are measured with the URDF held fast.
"""

from __future__ import annotations

from typing import Any

from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.regression.cross_validation import HeldOut
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.least_squares import Prior, project
from ident.diagnosis.selection.search import Search

MOST_NAMES = 24
"""Names of greatest evidence that are measured in each view; the others close nothing."""


def measure_alternatives(analysis: Analysis, prior: Prior) -> dict[str, Any]:
    """Held-out RMS of each joint [N m] in two views, `tuned` and `fixed`.

    Returns:
        For each view the RMS with no name (`none`) and with those of the diagnosis (`named`); and in `alone`, for each
        `effect:joint` (no joint for the whole arm), its view and the RMS with this name only, at its best
        inner figures.
    """
    search = Search(analysis.evidence, prior, HeldOut(analysis.evidence, prior))
    named = [item.group for item in analysis.search.named]
    views = {"tuned": search.held_out, "fixed": search.fixed}
    record: dict[str, Any] = {
        view: {"none": _rms(held_out, []), "named": _rms(held_out, named)} for view, held_out in views.items()
    }
    record["alone"] = {}
    gram, joints = analysis.evidence.gram(), analysis.diagnosis.joints
    for view, held_out in views.items():
        best = search.best_by_key(project(gram, analysis.evidence, held_out.prior))
        ours = [pair for pair in best.values() if pair[1].effect.inertia_like == (view == "fixed") and pair[0] > 0.0]
        for _, group in sorted(ours, key=lambda pair: -pair[0])[:MOST_NAMES]:
            name = f"{group.effect.id}:{joints[group.joint] if group.effect.scope == 'joint' else ''}"
            if name not in record["alone"]:
                record["alone"][name] = {"view": view, "rms": _rms(held_out, [group])}
    return record


def _rms(held_out: HeldOut, groups: list[Group]) -> list[float]:
    return [float(value) for value in held_out.score(groups).rms]
