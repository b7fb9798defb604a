"""Laws of a reading's words: every change is said in words of the field, by the joints' names."""

from dataclasses import replace

import pytest

from ident.checks.conventions.closely import Scored
from ident.checks.conventions.hypothesis import COMPENSATED, Hypothesis
from ident.checks.conventions.words import columns_in_words, in_words, reading_in_words

JOINTS = ("base", "lift", "wrist")
PLAIN = Hypothesis.as_it_is(3)
BODY = (-1.986, 0.0015, -0.0054, 0.1094)

SAID = {
    "nothing": (PLAIN, "as log and URDF say"),
    "two columns": (
        replace(PLAIN, order=(1, 0, 2), effort_order=(1, 0, 2)),
        "the columns of base and lift exchanged",
    ),
    "all columns": (
        replace(PLAIN, order=(1, 2, 0), effort_order=(1, 2, 0)),
        "the columns in the order wrist, base, lift",
    ),
    "efforts alone": (
        replace(PLAIN, effort_order=(0, 2, 1)),
        "the efforts of lift and wrist exchanged",
    ),
    "axis": (PLAIN.with_entry("direction", 1, -1), "lift turning the other way"),
    "axes": (
        replace(PLAIN, direction=(-1, 1, -1)),
        "base and wrist turning the other way",
    ),
    "zero": (PLAIN.with_entry("quarters", 2, 3), "the zero of wrist -90° off"),
    "half a turn": (PLAIN.with_entry("quarters", 2, 2), "the zero of wrist +180° off"),
    "turns": (replace(PLAIN, unit=("turns",) * 3), "all positions in turns"),
    "degrees of one": (
        PLAIN.with_entry("unit", 0, "deg"),
        "the positions of base in degrees",
    ),
    "radians": (
        replace(PLAIN, unit=("rad",) * 3),
        "all positions in radians, not in degrees",
    ),
    "all signs": (replace(PLAIN, effort_sign=(-1,) * 3), "all efforts of the other sign"),
    "one sign": (
        PLAIN.with_entry("effort_sign", 0, -1),
        "the effort of base of the other sign",
    ),
    "no gravity": (replace(PLAIN, gravity=COMPENSATED), "no gravity in the effort"),
    "mount": (
        replace(PLAIN, gravity=(0.0, 9.81, 0.0)),
        "gravity along [0.0, 9.8, 0.0] m/s² of the base",
    ),
    "grams": (replace(PLAIN, mass_factor=0.001), "all masses of the URDF times 0.001"),
    "counts": (
        replace(PLAIN, effort_scale=((2, 107.0),)),
        "the effort of wrist 107 times what it is in N m",
    ),
    "body": (
        replace(PLAIN, body=BODY),
        "1.99 kg less at the arm's end than in the URDF",
    ),
    "load": (
        replace(PLAIN, body=(0.4, 0.0, 0.0, 0.0)),
        "0.4 kg more at the arm's end than in the URDF",
    ),
    "two changes": (
        replace(PLAIN.with_entry("direction", 1, -1), gravity=COMPENSATED),
        "lift turning the other way and no gravity in the effort",
    ),
}


@pytest.mark.parametrize("case", SAID)
def test_a_change_is_said_in_words(case: str) -> None:
    """Law: a reading's words name what it changes and where, and hold no sign of a program."""
    hypothesis, words = SAID[case]
    assert reading_in_words(hypothesis, JOINTS) == words
    scored = Scored(hypothesis, 0.0, (-3.0, -3.0, -3.0), (1.0, 1.0, 1.0))
    line = in_words(scored, JOINTS)
    assert line == f"{words} (95.0 % of the torque)"
    assert not set('{}"_') & set(line)


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 1, 0), (1, 2, 0)])
def test_the_order_in_words_is_the_columns(order: tuple[int, ...]) -> None:
    """Law: a joint is told under whose name it stands, unless it is its own."""
    hypothesis = replace(PLAIN, order=order, effort_order=order)
    phrases = columns_in_words(hypothesis, JOINTS)
    expected = [f"{JOINTS[j]} stands under {JOINTS[k]}" for j, k in enumerate(order) if j != k]
    assert phrases == expected
