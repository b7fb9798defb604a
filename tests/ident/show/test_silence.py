"""What could not be tested, told by its reason."""

from __future__ import annotations

from ident.show.terminal import group_silent, silent_groups


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


def test_joints_of_one_effect_stand_together() -> None:
    rows = [{"effect": "torque_ripple", "joints": [f"joint_{j}"], "reason": "too slow"} for j in (1, 2)]
    (line,) = group_silent(rows)
    assert "torque ripple (joint_1 and joint_2)" in line
