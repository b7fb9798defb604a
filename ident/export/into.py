"""What was identified, written into the user's own URDF or MJCF; every other byte stays as it is.

Friction and rotor inertia of each joint are set. Links are changed by what was identified of them,
so far as the file's links are the URDF's: same frames, same inertias. What is not written is told,
with the reason. Meshes, actuators, sensors, keyframes and comments are not touched.
"""

from __future__ import annotations

from pathlib import Path

from ident.errors import InputError, RobotError, first_line
from ident.export.identified import IdentifiedArm
from ident.export.into_mjcf import compile_file, edit_mjcf
from ident.export.into_urdf import edit_urdf
from ident.export.own_file import REMEDY
from ident.export.written_into import WrittenInto, lend_beside
from ident.export.xml_places import EditedXml
from ident.files import atomic_write
from ident.robot.arm import ArmModel
from ident.safe_read import AGAIN, CHANGED, read_bytes


def write_into(path: Path, data: bytes, identified: IdentifiedArm) -> tuple[bytes, WrittenInto]:
    """A user's file with what was identified: its bytes, and what is in them.

    Args:
        path: The user's URDF or MJCF; it is not opened again.
        data: Its bytes, as `read_own_file` looked them through.
        identified: The arm, with losses that stand in for what the format has no words for.

    Raises:
        InputError: It is neither, or lacks a joint of the arm.
    """
    edited = EditedXml(data, str(path))
    forms = {"robot": ("urdf", edit_urdf), "mujoco": ("mjcf", edit_mjcf)}
    if edited.root.tag not in forms:
        raise InputError(path, f"its root is <{edited.root.tag}>, not <robot> or <mujoco>", REMEDY)
    form, edit = forms[edited.root.tag]
    written = WrittenInto(path, form, identified.nominal.tip)
    edit(edited, identified, written)
    if not identified.is_level:
        written.left.append("gravity and the base's mount: set them where your scene has them")
    for change in identified.changes:
        if change.joint >= 0 and change.part(form) not in ("", "inertial"):
            what = f"{change.effect} of {identified.nominal.joint_names[change.joint]}"
            written.left.append(f"{what}: its part of robot.{'urdf' if form == 'urdf' else 'xml'}")
    return edited.edited(), written


def is_mjcf(path: Path, data: bytes) -> bool:
    """Whether a user's file, of which these are the bytes, is an MJCF, by its root.

    Raises:
        InputError: It is no XML.
    """
    return EditedXml(data, str(path)).root.tag == "mujoco"


def require_loadable(path: Path, text: bytes, written: WrittenInto) -> None:
    """Passes if the edited text can take the place of the user's file: its simulator loads it.

    It is tried beside the file, where its meshes are found; nothing of that stays.

    Raises:
        InputError: It does not load, or nothing can be written there.
    """
    try:
        with lend_beside(path, text) as temporary:
            if written.form == "mjcf":
                compile_file(temporary)
            else:
                ArmModel.from_whole_urdf(text.decode(), path, written.tip)
    except (RobotError, ValueError) as error:
        what = f"with what was identified it does not load ({first_line(error)})"
        raise InputError(path, what, "take robot.urdf and robot.xml of --out") from None


def require_as_read(path: Path, data: bytes) -> None:
    """Passes if a user's file still is what was read.

    What somebody wrote into it since must not be lost.

    Raises:
        InputError: It is not.
    """
    if read_bytes(path, REMEDY) != data:
        raise InputError(path, f"{CHANGED}: nothing is written into it", AGAIN)


def save_into(path: Path, data: bytes, text: bytes) -> None:
    """Puts the edited text in the place of the user's file, whole or not at all.

    Args:
        path: The file.
        data, text: Its bytes as they were read, and as they are edited.

    Raises:
        InputError: It is no longer what was read.
    """
    with atomic_write(path) as temporary:
        temporary.write_bytes(text)
        require_as_read(path, data)
