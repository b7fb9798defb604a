"""A reading of a log and a URDF in plain words, for lines in which it is compared with others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.checks.conventions.closely import Scored
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, ZEROS, Hypothesis
from ident.errors import join_words

AS_THEY_SAY = "as log and URDF say"
# What the file's positions are, by the unit's name.
UNIT_WORDS = {
    "deg": "in degrees",
    "turns": "in turns",
    "rad": "in radians, not in degrees",
}


def in_words(scored: Scored, joints: Sequence[str]) -> str:
    """A reading in words, with the share of the torque that it explains."""
    explained = f"{100.0 * scored.explains:.1f} % of the torque"
    return f"{reading_in_words(scored.hypothesis, joints)} ({explained})"


def reading_in_words(hypothesis: Hypothesis, joints: Sequence[str]) -> str:
    """What a reading changes, as it would be said of the log and of the arm."""
    phrases = _columns(hypothesis, joints)
    phrases += _axes(hypothesis, joints)
    phrases += _zeros(hypothesis, joints)
    phrases += _units(hypothesis, joints)
    phrases += _angles(hypothesis, joints)
    phrases += _signs(hypothesis, joints)
    phrases += _gravity(hypothesis)
    phrases += _masses(hypothesis, joints)
    return join_words(phrases) if phrases else AS_THEY_SAY


def columns_in_words(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """A phrase for each column that stands under another joint's name; empty without any.

    Args:
        hypothesis: The reading.
        joints: Names of the joints.
    """
    phrases = []
    for joint, column in enumerate(hypothesis.order):
        if column != joint:
            phrases.append(f"{joints[joint]} stands under {joints[column]}")
    for joint, column in enumerate(hypothesis.effort_order):
        if column != hypothesis.order[joint]:
            phrases.append(f"the effort of {joints[joint]} stands under {joints[column]}")
    return phrases


def _columns(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """Columns that change places: pairs by name, more of them as an order."""
    plain = tuple(range(len(joints)))
    phrases = []
    if hypothesis.order != plain:
        phrases.append(_exchange("the columns", hypothesis.order, plain, joints))
    if hypothesis.effort_order != hypothesis.order:
        phrases.append(_exchange("the efforts", hypothesis.effort_order, hypothesis.order, joints))
    return phrases


def _exchange(
    what: str, order: tuple[int, ...], usual: tuple[int, ...], joints: Sequence[str]
) -> str:
    """That columns stand in another order than the usual one."""
    moved = [joint for joint in range(len(order)) if order[joint] != usual[joint]]
    if len(moved) == 2:
        return f"{what} of {joints[moved[0]]} and {joints[moved[1]]} exchanged"
    names = [joints[joint] for joint in np.argsort(order)]
    return f"{what} in the order {', '.join(names)}"


def _axes(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """Axes that turn the other way."""
    reversed_joints = [joints[j] for j, sign in enumerate(hypothesis.direction) if sign < 0]
    if not reversed_joints:
        return []
    return [f"{join_words(reversed_joints)} turning the other way"]


def _zeros(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """Zeros that are quarters of a turn off."""
    phrases = []
    for joint, quarters in enumerate(hypothesis.quarters):
        if quarters:
            angle = np.degrees(ZEROS[quarters])
            phrases.append(f"the zero of {joints[joint]} {angle:+.0f}° off")
    return phrases


def _units(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """Positions in another unit, by unit."""
    phrases = []
    for unit, words in UNIT_WORDS.items():
        named = [joints[j] for j, name in enumerate(hypothesis.unit) if name == unit]
        if len(named) == len(joints):
            phrases.append(f"all positions {words}")
        elif named:
            phrases.append(f"the positions of {join_words(named)} {words}")
    return phrases


def _angles(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """Angles that are counted elsewhere than between a joint's two links."""
    phrases = []
    for joint, factor in enumerate(hypothesis.gear):
        if factor != 1.0:
            phrases.append(f"the angle of {joints[joint]} {1.0 / factor:.3g} times the joint's")
    for joint, share in enumerate(hypothesis.share):
        if share:
            how = "plus" if share > 0 else "minus"
            phrases.append(f"the angle of {joints[joint]} {how} that of {joints[joint - 1]}")
    return phrases


def _signs(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """Efforts of the other sign."""
    named = [joints[j] for j, sign in enumerate(hypothesis.effort_sign) if sign < 0]
    if not named:
        return []
    if len(named) == len(joints):
        return ["all efforts of the other sign"]
    return [f"the effort of {join_words(named)} of the other sign"]


def _gravity(hypothesis: Hypothesis) -> list[str]:
    """What a hypothesis says of gravity that the robot's description does not; nothing where they
    agree.

    Returns:
        One phrase at most: that the effort holds no gravity, or along which vector of the base it
        pulls [m/s²].
    """
    if hypothesis.gravity == AS_STATED:
        return []
    if hypothesis.gravity == COMPENSATED:
        return ["no gravity in the effort"]
    parts = ", ".join(f"{float(value):.1f}" for value in hypothesis.gravity)
    return [f"gravity along [{parts}] m/s² of the base"]


def _masses(hypothesis: Hypothesis, joints: Sequence[str]) -> list[str]:
    """All masses by a factor, joints in another unit, and a body at the end."""
    phrases = []
    if hypothesis.mass_factor != 1.0:
        phrases.append(f"all masses of the URDF times {hypothesis.mass_factor:.3g}")
    for joint, scale in hypothesis.effort_scale:
        phrases.append(f"the effort of {joints[joint]} {scale:.3g} times what it is in N m")
    if hypothesis.body is not None:
        mass = hypothesis.body[0]
        comparison = "more" if mass > 0.0 else "less"
        phrases.append(f"{abs(mass):.3g} kg {comparison} at the arm's end than in the URDF")
    if hypothesis.parameters is not None:
        phrases.append("other masses and centres at the same links")
    return phrases


def guess_in_words(hypothesis: Hypothesis) -> str:
    """What a model has beside the URDF's masses by a reading; empty for nothing."""
    if hypothesis.parameters is not None:
        return "guessed masses"
    phrases = []
    if hypothesis.mass_factor != 1.0:
        phrases.append(f"all masses times a guessed {hypothesis.mass_factor:.3g}")
    if hypothesis.body is not None:
        phrases.append(f"a guessed body of {hypothesis.body[0]:.3g} kg")
    return join_words(phrases)
