"""A user's own file may be a stranger's: it is looked through before MuJoCo reads it."""

import os
from pathlib import Path

import pytest

from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.own_file import read_own_file
from ident.export.write import write_patch
from ident.export.written_into import match_joints
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from tests.fuzz.guard import Guard
from tests.ident.export.diagnoses import write_diagnosis

SECRET = "secret.xml"
COPIES = '<replicate count="9999"><replicate count="9999"><body/></replicate></replicate>'
REFUSED = {
    "another file": f'<include file="{SECRET}"/>',
    "another model": f'<asset><model name="a" file="{SECRET}"/></asset>',
    "a mesh that is a pipe": '<asset><mesh file="pipe.stl"/></asset>',
    "a mesh of a folder that is named": '<compiler meshdir="meshes"/><asset><mesh file="pipe.stl"/></asset>',
    "a device": '<asset><texture file="/dev/zero" type="2d"/></asset>',
    "a side of a cube that is a pipe": '<asset><texture type="cube" fileleft="pipe.stl"/></asset>',
    "a field of heights": '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>',
    "copies of copies": f"<worldbody>{COPIES}</worldbody>",
    "a long chain": '<worldbody><body><composite type="cable" count="999999 1 1"/></body></worldbody>',
    "memory": '<size memory="1T"/>',
    "memory by digits": f'<size memory="{10**15}"/>',
    "constraints": '<size njmax="999999999"/>',
    "a count that is none": '<worldbody><replicate count="nan"><body/></replicate></worldbody>',
    "a count beyond all": f'<worldbody><replicate count="{"9" * 400}"><body/></replicate></worldbody>',
    "levels without end": "<body>" * 5000 + "</body>" * 5000,
}
TEXTS = {
    "nothing": b"",
    "an entity": b'<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><mujoco>&x;</mujoco>',
    "another alphabet": '<mujoco model="é"/>'.encode("latin-1"),
    "sixteen bits": '<mujoco model="a"/>'.encode("utf-16"),
    "a half": b"<mujoco><worldbody>",
    "zeros": b"\x00" * 64,
}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with pipes and another file."""
    (tmp_path / "meshes").mkdir()
    for folder in (tmp_path, tmp_path / "meshes"):
        os.mkfifo(folder / "pipe.stl")
    (tmp_path / SECRET).write_text("<mujoco/>")
    return tmp_path


@pytest.mark.parametrize("kind", REFUSED)
def test_an_mjcf_waits_for_nothing_and_multiplies_nothing(kind: str, place: Path, guard: Guard) -> None:
    """Law: pipes, other files and parts beyond any scene are told in a line; no other file is opened."""
    (place / "arm.xml").write_text(f"<mujoco>{REFUSED[kind]}</mujoco>")
    with guard.watching(), pytest.raises(InputError) as told:
        read_own_file(place / "arm.xml")
    assert len(str(told.value).splitlines()) == 1
    assert not [name for name in guard.read if name.endswith((SECRET, "pipe.stl"))]
    assert guard.done == []


@pytest.mark.parametrize("kind", TEXTS)
def test_what_is_no_text_of_xml_is_told(kind: str, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_bytes(TEXTS[kind])
    with pytest.raises(InputError) as told:
        read_own_file(tmp_path / "arm.xml")
    assert len(str(told.value).splitlines()) == 1


@pytest.mark.parametrize("put", [os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")])
def test_what_is_no_plain_file_is_told(put: object, tmp_path: Path) -> None:
    assert callable(put)
    put(tmp_path / "arm.xml")
    with pytest.raises(InputError):
        read_own_file(tmp_path / "arm.xml")


def test_a_scene_as_they_are_is_read(tmp_path: Path) -> None:
    """Law: meshes, pictures, copies and memory of usual sizes are nobody's fault."""
    (tmp_path / "link.stl").write_bytes(b"\x00" * 84)
    asset = '<asset><mesh file="link.stl"/><texture builtin="checker" width="512" height="512"/></asset>'
    copies = '<worldbody><replicate count="20"><body/></replicate></worldbody>'
    text = f'<mujoco><size memory="100M" nkey="3"/>{asset}{copies}</mujoco>'
    (tmp_path / "arm.xml").write_text(text)
    assert read_own_file(tmp_path / "arm.xml") == text.encode()


def test_two_joints_of_the_arm_are_not_one_of_the_file() -> None:
    with pytest.raises(InputError, match="would be two joints of the arm"):
        match_joints(["left_joint", "joint"], ["joint"], Path("arm.xml"))


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A user's URDF with the line ends of another system."""
    path = tmp_path / "mine.urdf"
    path.write_bytes(Path(data_path("urdf/tm5_900.urdf")).read_bytes().replace(b"\n", b"\r\n"))
    return path


def patch_into(own: Path, arm: ArmModel) -> None:
    diagnosis = write_diagnosis(own.with_name("d.json"), arm, "stribeck_friction")
    write_patch(Diagnosed.load(diagnosis), arm, own.with_name("patch"), into=own)


def test_the_folder_keeps_the_file_byte_by_byte(own: Path, tm5: ArmModel) -> None:
    before = own.read_bytes()
    patch_into(own, tm5)
    assert own.with_name("patch").joinpath("before_mine.urdf").read_bytes() == before
    assert own.read_bytes() != before
    assert own.read_bytes().count(b"\r\n") >= before.count(b"\r\n")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'joint name="joint_2"', b'joint name="joint_1"'),
        (b"</robot>", b'<link name="base"/></robot>'),
        (b"</robot>", b'<joint name="lost" type="fixed"><parent link="x"/><child link="y"/></joint></robot>'),
    ],
)
def test_a_file_that_is_refused_leaves_nothing(own: Path, tm5: ArmModel, old: bytes, new: bytes) -> None:
    """Law: neither the file nor the patch's folder is there as if it had been written."""
    own.write_bytes(own.read_bytes().replace(old, new, 1))
    before = own.read_bytes()
    with pytest.raises(InputError):
        patch_into(own, tm5)
    assert own.read_bytes() == before
    assert sorted(path.name for path in own.parent.iterdir()) == ["d.json", "mine.urdf"]


def test_a_link_is_not_written_through(own: Path, tm5: ArmModel) -> None:
    real = own.rename(own.with_name("real.urdf"))
    own.symlink_to(real)
    before = real.read_bytes()
    with pytest.raises(InputError, match="link"):
        patch_into(own, tm5)
    assert real.read_bytes() == before
    assert not own.with_name("patch").exists()
