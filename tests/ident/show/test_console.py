"""What is printed fits the terminal."""

from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from ident.model.evaluation import SessionScore
from ident.show.console import columns, ladder_table
from ident.show.untested_words import group_silent, silent_groups

LONG = "left_manipulator_shoulder_revolute_joint_with_a_long_name_"


def ladder(joints: tuple[str, ...]) -> SessionScore:
    """The score of a session of some joints, every number alike."""
    shape = (2, 3, len(joints))
    return SessionScore(
        name="session",
        joints=joints,
        runs=("a", "b", "c"),
        rungs=("rigid", "net"),
        payload_kg=0.0,
        energy_error=np.full(shape, -12.34),
        squares=np.full(shape, 4.0),
        rest_squares=np.full(shape, 4.0),
        r2=np.ones((2, len(joints))),
    )


def test_a_ladder_of_seven_joints_shows_every_number_at_eighty_columns() -> None:
    score = ladder(tuple(f"panda_joint{k}" for k in range(1, 8)))
    stream = StringIO()
    Console(file=stream, width=80, color_system=None).print(ladder_table(score))
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert "…" not in stream.getvalue()
    assert stream.getvalue().count("−12.34 ± 0.00") == 14
    assert stream.getvalue().count("2.00") >= 14


def test_long_names_of_joints_stay_whole_in_a_ladder() -> None:
    """Law: names that begin alike are told apart, and no line is wider than the terminal."""
    stream = StringIO()
    score = ladder((f"{LONG}1", f"{LONG}2"))
    Console(file=stream, width=80, color_system=None).print(ladder_table(score))
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert "…" not in stream.getvalue()
    names = "".join(line.split("│")[2].strip() for line in lines if line.count("│") == 5)
    assert names.count(f"{LONG}1") == names.count(f"{LONG}2") == 2


@pytest.mark.parametrize("longest", [40, 80])
def test_what_names_a_line_stands_above_it_where_both_are_too_long(longest: int) -> None:
    """Law: a table fits the terminal, cells stay aligned, and names are whole."""
    table = [("", "URDF", "tuned"), (f"{LONG}1", "11.8", "0.5"), (f"{LONG}2", "9.1", "10.25")]
    whole = columns(table, "lrr")
    assert len(whole) == len(table)
    lines = columns(table, "lrr", longest)
    if longest == 80:
        assert lines == whole
        return
    assert lines[1::2] == [f"  {LONG}1", f"  {LONG}2"]
    assert len({len(line) for line in lines[::2]}) == 1


def test_twenty_rows_are_three_reasons_at_most() -> None:
    reasons = ("gear ratio of joint_1 is not known", "one run a side: nobody knows", "joint_1 covers only 0.01 rad")
    rows = [
        {"effect": f"effect_{k}", "joints": [f"joint_{j}" for j in range(1, 5)], "reason": reasons[k % 3]}
        for k in range(20)
    ]
    groups = silent_groups(rows)
    assert len(groups) == len(group_silent(rows)) == 3
    assert sum(len(items) for _, items in groups) == 20
    assert all("4 joints" in item for _, items in groups for item in items)
