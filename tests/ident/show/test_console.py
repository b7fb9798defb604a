"""What is printed fits the terminal."""

from io import StringIO

import numpy as np
from rich.console import Console

from ident.model.evaluation import SessionScore
from ident.show.console import ladder_table
from ident.show.terminal import group_silent, silent_groups


def test_a_ladder_of_seven_joints_shows_every_number_at_eighty_columns() -> None:
    joints = tuple(f"panda_joint{k}" for k in range(1, 8))
    shape = (2, 3, 7)
    score = SessionScore(
        name="session",
        joints=joints,
        runs=("a", "b", "c"),
        rungs=("rigid", "net"),
        payload_kg=0.0,
        energy_error=np.full(shape, -12.34),
        squares=np.full(shape, 4.0),
        rest_squares=np.full(shape, 4.0),
        r2=np.ones((2, 7)),
    )
    stream = StringIO()
    Console(file=stream, width=80, color_system=None).print(ladder_table(score))
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert "…" not in stream.getvalue()
    assert stream.getvalue().count("−12.34 ± 0.00") == 14
    assert stream.getvalue().count("2.00") >= 14


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
