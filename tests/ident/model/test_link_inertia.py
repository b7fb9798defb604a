"""Inertial numbers in a URDF's text: what is not changed stays as it was written."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from ident.model.link_inertia import moved, read_inertial, set_inertial

# Numbers as exporters write them, with more digits than are needed, and fewer.
TEXT = (
    '<link name="a"><inertial><mass value="3.420"/><origin rpy="{}" xyz="0.0 -1e-3 0.121825000"/>'
    '<inertia ixx="0.0217284832211" ixy="0.0" ixz="1.0e-05" iyy="0.0317284832211" iyz="0" izz="0.00961875"/>'
    "</inertial></link>"
)
TURNS = ("0 0 0", "0.3 -1.2 2.5", "1.5707963 0 0")


@pytest.mark.parametrize("rpy", TURNS)
def test_numbers_that_are_as_stated_keep_their_text(rpy: str) -> None:
    link = ET.fromstring(TEXT.format(rpy))
    before = ET.tostring(link)
    set_inertial(link, read_inertial(link))
    assert ET.tostring(link) == before


@pytest.mark.parametrize("rpy", TURNS)
def test_a_mass_added_at_the_centre_changes_the_mass_alone(rpy: str) -> None:
    link = ET.fromstring(TEXT.format(rpy))
    point = moved(np.array([0.5, *np.zeros(9)]), np.eye(3), np.array([0.0, -1e-3, 0.121825]))
    set_inertial(link, read_inertial(link) + point)
    assert ET.tostring(link).decode() == ET.tostring(ET.fromstring(TEXT.format(rpy).replace("3.420", "3.92"))).decode()


@pytest.mark.parametrize("rpy", TURNS)
def test_numbers_that_are_set_are_read_back(rpy: str) -> None:
    """Law: to a tenth of a millionth of the body's size, whichever way its axes are turned."""
    link = ET.fromstring(TEXT.format(rpy))
    wanted = read_inertial(link) * 1.3
    wanted[5] += 1e-3
    set_inertial(link, wanted)
    assert read_inertial(link) == pytest.approx(wanted, rel=1e-6, abs=1e-8)
    assert link.find("inertial/origin").get("rpy") == rpy


def test_a_link_without_inertia_gets_one() -> None:
    link = ET.fromstring('<link name="a"/>')
    ball = moved(np.array([2.0, 0, 0, 0, 1e-3, 0, 1e-3, 0, 0, 1e-3]), np.eye(3), np.array([0.1, 0.0, 0.2]))
    set_inertial(link, ball)
    assert read_inertial(link) == pytest.approx(ball)
