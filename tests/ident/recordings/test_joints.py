"""Recorded joints against the robot's."""

from __future__ import annotations

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.recordings.joint_names import map_by_ending, match_joints
from ident.recordings.recording import Recording, Session

PANDA = tuple(f"panda_joint{i}" for i in range(1, 8))


def session_of(*joints: str) -> Session:
    values = np.tile(np.arange(float(len(joints))), (5, 1))
    return Session("s", (Recording("r", joints, np.arange(5.0), values, values),))


def test_equal_names_come_in_the_robots_order() -> None:
    session, issues = match_joints(session_of("c", "a", "b"), ("a", "b", "c"))
    assert session.joints == ("a", "b", "c")
    np.testing.assert_array_equal(session.runs[0].position[0], [1.0, 2.0, 0.0])
    assert issues == ()


def test_names_that_differ_in_their_beginning_match_and_that_is_told() -> None:
    session, issues = match_joints(session_of(*(f"fer_joint{i}" for i in (3, 1, 2, 4, 5, 6, 7))), PANDA)
    assert session.joints == PANDA
    assert session.runs[0].position[0, 2] == 0.0
    assert [(issue.issue, issue.severity) for issue in issues] == [("joints_renamed", "note")]


def test_fingers_are_left_out_also_where_names_are_mapped() -> None:
    recorded = (*(f"fer_joint{i}" for i in range(1, 8)), "fer_finger_joint1", "fer_finger_joint2")
    session, issues = match_joints(session_of(*recorded), PANDA)
    assert session.joints == PANDA
    assert {issue.issue for issue in issues} == {"joints_renamed", "joints_left_out"}


def test_a_joint_that_is_not_recorded_is_told() -> None:
    session, issues = match_joints(session_of(*PANDA[:6]), PANDA)
    assert session.joints == PANDA[:6]
    assert [(issue.issue, issue.joints) for issue in issues] == [("joints_locked", PANDA[6:])]


def test_a_mapping_covers_the_whole_robot_or_is_none() -> None:
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2")) == {"j1": "arm_1", "j2": "arm_2"}
    assert map_by_ending(("j1", "j2"), ("arm_1", "arm_2", "arm_3")) == {}
    assert map_by_ending(("left_j1", "right_j1"), ("j1",)) == {}, "two recorded joints fit: neither is taken"


def test_other_joints_are_refused_with_the_line_to_write() -> None:
    with pytest.raises(RecordingError, match=r'"elbow/position" = "panda_joint1/position"'):
        match_joints(session_of("elbow", "wrist"), PANDA)
