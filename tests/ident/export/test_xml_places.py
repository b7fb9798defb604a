"""Edits of XML leave every other byte as it is."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.errors import InputError
from ident.export.xml_places import EditedXml

TEXT = b"""<?xml version="1.0"?>
<!-- damping="7" of nobody -->
<robot name='a>b'>
  <joint   name="j1"
           damping = '1'  note="x damping='3' y"><axis/></joint>
\t<joint name="j2"/>
</robot>
"""


def test_only_the_value_changes() -> None:
    edited = EditedXml(TEXT, "a.xml")
    edited.set(edited.root.children[0], {"damping": "2.5"})
    assert edited.edited() == TEXT.replace(b"damping = '1'", b'damping = "2.5"')


def test_a_new_attribute_and_a_new_child_stand_in_the_tag() -> None:
    edited = EditedXml(TEXT, "a.xml")
    edited.set(edited.root.children[1], {"armature": "0.1"})
    edited.insert(edited.root.children[1], '<dynamics damping="1"/>')
    root = ET.fromstring(edited.edited())
    joint = root.findall("joint")[1]
    assert joint.get("armature") == "0.1"
    assert joint.find("dynamics") is not None
    assert edited.edited().startswith(TEXT[: TEXT.index(b"\t<joint")])


def test_an_element_is_replaced_as_a_whole() -> None:
    edited = EditedXml(TEXT, "a.xml")
    axis = edited.root.children[0].child("axis")
    assert axis is not None
    edited.replace(axis, "<axis xyz='0 0 1'/>")
    assert edited.edited() == TEXT.replace(b"<axis/>", b"<axis xyz='0 0 1'/>")


@given(st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=20))
def test_any_value_comes_back(value: str) -> None:
    edited = EditedXml(TEXT, "a.xml")
    edited.set(edited.root.children[0], {"note": value, "other": value})
    joint = ET.fromstring(edited.edited()).find("joint")
    assert joint is not None
    assert (joint.get("note"), joint.get("other"), joint.get("damping")) == (value, value, "1")


@pytest.mark.parametrize("text", [b"<robot>", b"no xml", b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'])
def test_what_is_no_plain_xml_is_refused(text: bytes) -> None:
    with pytest.raises(InputError):
        EditedXml(text, "a.xml")
