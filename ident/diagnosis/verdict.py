"""Decision rules: from probabilities of names and of gaps without a name to a verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Float
from ident.diagnosis.settings import USUAL_VERDICT, VerdictSettings
from ident.inference.conclusion import EVEN_ODDS, Named
from ident.records import JsonTable


def decide(
    names: Sequence[Named], gap_probability: Float[np.ndarray, " n"], judged: int = 1
) -> str:
    """The verdict.

    Args:
        names: Effects that are likelier than not.
        gap_probability: For each joint the probability that a cause without a name is left there.
        judged: Samples, of all joints, at which the model was held against the recordings.

    Returns:
        `named`, `partial` (named, and more is left), `none_of_catalogue`, `no_gap`, or
        `not_testable` where nothing was named and nothing was there to be judged.
    """
    unexplained = bool(np.any(gap_probability >= EVEN_ODDS))
    if names:
        return "partial" if unexplained else "named"
    if not judged:
        return "not_testable"
    return "none_of_catalogue" if unexplained else "no_gap"


def score_outside(gap_probability: Float[np.ndarray, " n"]) -> float:
    """Score from 0 to 1 of a cause outside the catalogue, for ranking sessions.

    Args:
        gap_probability: For each joint the probability that a cause without a name is left there.
    """
    return float(gap_probability.max(initial=0.0))


def above_noise(gap: JsonTable, settings: VerdictSettings = USUAL_VERDICT) -> bool:
    """Whether a joint's error is clearly above its noise.

    Args:
        gap: The joint's gap as a diagnosis records it (`JointGap.to_dict`).
        settings: How many times the noise's is loud.

    Returns:
        False where the noise is 0 or None.
    """
    return bool(gap["rms_Nm"] > settings.loud * (gap["noise_floor_Nm"] or np.inf))
