"""Recordings of real arms, and whose they are: folders and files of the data, or names of robots."""

from pathlib import Path

from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

REAL = {
    "rokae": ("rokae_ar5", "rokae_ar5/robot.urdf"),
    "airbot": ("airbot_play", "airbot_play/robot.urdf"),
    "dual arm": ("dual_arm_v2", "dual_arm_v2/robot.urdf"),
    "panda": ("panda/unisa_fer/panda_exciting_trajectory.db3", "panda"),
    "ur10": ("ur10_cb/ur10_exciting_trajectory.db3", "ur10"),
}


def load_real(name: str, folder: Path) -> tuple[Session, ArmModel]:
    """One of the recordings, and its arm."""
    recording, robot = REAL[name]
    arm = ArmModel.load(folder / robot if "/" in robot else robot)
    return load_session(folder / recording), arm
