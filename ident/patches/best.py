"""Which of the measured files is written: the one that is nearest to the recordings that it was measured on."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ident.patches.verify import WrittenPatch

FILE_OF = {"urdf": "robot.urdf", "mjcf": "robot.xml"}
PATCHED = ("after", "after_with_module")
# The named effects are kept unless another file is nearer by more than this share: less is chance.
WORTH = 0.01


def best_of(gaps: Mapping[str, Mapping[str, Any]]) -> str:
    """The nearest file, by the mean over the joints of its torque gap as a share of the gap before.

    The patched file is named before its rivals where these are not clearly nearer, and alone before with the module.
    """
    before = np.array(list(gaps["before"]["torque_rms_Nm"].values()))
    scores = {
        when: float(np.mean(np.array(list(gap["torque_rms_Nm"].values())) / np.maximum(before, 1e-12)))
        for when, gap in gaps.items()
    }
    best = "after"
    for when in ("after_with_module", "tuned", "before"):
        if when in scores and scores[when] < (1.0 - WORTH) * scores[best]:
            best = when
    return best


def write_best(
    gaps: Mapping[str, Mapping[str, Mapping[str, Any]]], before: Mapping[str, WrittenPatch], folder: Path
) -> dict[str, str]:
    """Puts the file that measured best into the patch's folder; which one it is, by format."""
    chosen = {}
    for form, found in gaps.items():
        best = best_of(found)
        chosen[form] = "after" if best in PATCHED else best
        if chosen[form] != "after":
            shutil.copyfile(before[best].folder / FILE_OF[form], folder / FILE_OF[form])
    return chosen


def tell_choice(written: Mapping[str, str], best: Mapping[str, str]) -> list[str]:
    """What a user should know of the choice."""
    words = {"tuned": "inertias and losses tuned without the named effects", "before": "losses tuned alone"}
    lines = [
        f"{FILE_OF[form]}: {words[when]} measured better than the patch on these runs, so that is what the file holds; "
        "don't add extra_torque.py to it"
        for form, when in written.items()
        if when != "after"
    ]
    helped = [FILE_OF[form] for form, when in best.items() if when == "after_with_module"]
    return lines + [f"{name}: best together with extra_torque.py's missing_torque" for name in helped]
