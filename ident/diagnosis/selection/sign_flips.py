"""Is there anything at all? Score tests whose null distribution comes from flipping the signs of whole blocks.

Under the null a block's score Σ φ̃ r is as likely positive as negative. Flipping signs block by block keeps all that is
true inside a block (autocorrelation, unequal variance) and needs no noise model. The greatest statistic over all
candidates is compared, so the chance of any false alarm in the family is the nominal one.

Some effects show in few stretches (slow motion, reversals): one block then holds nearly all of the score, and its sign
alone can't show anything. Scores are therefore clipped in size, not in sign: no block speaks louder than the
one of a certain rank (`voices`). Clipping by size leaves the flips' null distribution exact.

Source: Romano and Wolf 2005 (step-down); Cameron, Gelbach and Miller 2008 (score flipping by cluster).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from scipy.special import gammaincc

from ident.arrays import Array, Float, Int
from ident.diagnosis.regression.design import Group, Key
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Projection
from ident.diagnosis.regression.run_spread import block_sums_left
from ident.diagnosis.selection.settings import USUAL_SELECTION, SelectionSettings


def block_scores(evidence: Evidence, projection: Projection) -> Float[Array, "B P"]:
    """Score of every column in every block, after the model: Φ̃_bᵀ r_b."""
    raw = block_sums_left(evidence, projection)
    return raw - raw[:, projection.inside] @ projection.slopes


def family_p_values(
    scores: Float[Array, "B P"],
    groups: Sequence[Group],
    rng: np.random.Generator,
    settings: SelectionSettings = USUAL_SELECTION,
) -> Float[Array, " G"]:
    """p-value of each group, corrected for having looked at all of them.

    Args:
        scores: Of `block_scores`.
        groups: The family.
        rng: Draws the signs.
        settings: How many draws, and how loud a block may speak.
    """
    blocks, flips = len(scores), settings.flips
    signs = rng.choice([-1.0, 1.0], size=(flips, blocks)).astype(np.float32)
    observed, greatest = np.zeros(len(groups)), np.zeros(flips)
    widths = np.array([len(group.columns) for group in groups])
    for width in np.unique(widths):
        slots = np.flatnonzero(widths == width).tolist()
        at = np.concatenate([groups[g].columns for g in slots])
        white, degrees = _whitened(scores[:, at].reshape(blocks, len(slots), width).transpose(1, 0, 2), settings.voices)
        flipped = signs @ white.transpose(1, 0, 2).reshape(blocks, -1).astype(np.float32)
        lengths = np.sqrt(np.square(flipped.reshape(flips, len(slots), width)).sum(axis=2))
        whole = np.linalg.norm(white.sum(axis=1), axis=1)
        for one in np.unique(degrees[degrees > 0]):
            # Of groups of one size the longest sum is the greatest surprise, flip by flip.
            same = degrees == one
            observed[np.array(slots)[same]] = _surprise(whole[same], int(one))
            greatest = np.maximum(greatest, _surprise(lengths[:, same].max(axis=1), int(one)))
    return (1.0 + (greatest[None, :] >= observed[:, None]).sum(axis=1)) / (1.0 + flips)


def _whitened(scores: Float[Array, "g B k"], voices: int) -> tuple[Float[Array, "g B k"], Int[Array, " g"]]:
    """Scores of limited size on the scale on which their sum over flips has unit variance in every direction.

    Returns:
        The scores, and each group's number of directions.
    """
    size = np.linalg.norm(scores, axis=1, keepdims=True)
    scores = scores / np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(scores.transpose(0, 2, 1) @ scores)
    kept = (values > 1e-6 * values[:, -1:]) & (values > 0.0)
    scores = (scores @ vectors) * np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)[:, None, :]
    size = np.linalg.norm(scores, axis=2, keepdims=True)
    loudest = np.sort(size, axis=1)[:, -min(voices, scores.shape[1]), None]
    scores = scores * np.minimum(1.0, loudest / np.maximum(size, 1e-300))
    values, vectors = np.linalg.eigh(scores.transpose(0, 2, 1) @ scores)
    least = np.maximum(1e-12 * values[:, -1:], 1e-300)
    return scores @ vectors / np.sqrt(np.maximum(values, least))[:, None, :], kept.sum(axis=1)


def family_p_values_by_run(
    scores: Float[Array, "R P"],
    information: Callable[[Int[Array, " k"]], Float[Array, "k k"]],
    groups: Sequence[Group],
    rng: np.random.Generator,
    settings: SelectionSettings = USUAL_SELECTION,
) -> dict[Key, float]:
    """p-value of each name over its grid where blocks are few (whole runs): too few to take a variance from.

    The statistic is the fall of the misfit itself, Uᵀ I⁻¹ U with the model's information I; the greatest over all names
    and grids is compared.

    Args:
        scores: Of `block_scores`, summed run by run.
        information: What the model leaves of the sums of some columns (`Projection.rest`).
        groups: The family: all names that are judged so, with their grids.
        rng: Draws the signs.
        settings: Number of flips.
    """
    signs = np.concatenate([np.ones((1, len(scores))), rng.choice([-1.0, 1.0], size=(settings.flips, len(scores)))])
    best: dict[Key, Float[Array, " f"]] = {}
    for group in groups:
        fall = best.setdefault(group.key, np.zeros(len(signs)))
        matrix = information(group.columns)
        kept = np.diag(matrix) > 0.0
        sums, matrix = signs @ scores[:, group.columns[kept]], matrix[np.ix_(kept, kept)]
        inverse = np.linalg.pinv(matrix + np.diag(1e-6 * np.diag(matrix)), hermitian=True)
        np.maximum(fall, np.einsum("fk,kl,fl->f", sums, inverse, sums), out=fall)
    greatest = np.max(list(best.values()), axis=0)
    return {key: float((greatest >= fall[0] * (1 - 1e-9)).mean()) for key, fall in best.items()}


def _surprise(length: Array, degrees: int) -> Array:
    """−log of the χ² tail beyond a sum's length: brings groups of different size on one scale."""
    # Asked for a thousand times a candidate: read off a table, straight between its points, and beyond them.
    table = _surprises(degrees)
    beyond = np.maximum(length - LONGEST, 0.0) * (LONGEST + 0.5 * (length - LONGEST))
    return np.asarray(np.interp(length, _LENGTHS, table) + beyond)


LONGEST = 36.0  # of a sum of scores: its tail is the smallest number that differs from zero
_LENGTHS = np.linspace(0.0, LONGEST, 3601)


@cache
def _surprises(degrees: int) -> Float[Array, " k"]:
    return np.asarray(-np.log(np.maximum(gammaincc(degrees / 2, _LENGTHS**2 / 2), np.finfo(float).tiny)))
