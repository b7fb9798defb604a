"""Recordings that several test folders share: real ones, and one of a made-up two-joint arm."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel

UR_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
# Drive gains of the UR10e from the literature [N m/A].
UR10E_GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)


@pytest.fixture(scope="session")
def arm() -> ArmModel:
    return ArmModel.load("tm5-900")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the recordings of real arms."""
    folder = Path(os.environ.get("IDENT_REAL_DATA", Path(__file__).parents[3] / "shared/real"))
    if not folder.is_dir():
        pytest.skip(f"no recordings of real arms at {folder} (set IDENT_REAL_DATA)")
    return folder


# Runs of the UR10e by parts of their file names, as fits and tests take them.
UR10E_TRAINING = ("12-50sec_12harm", "19_14harm50sec", "10-20sec_7harm", "unload")
UR10E_TEST = ("10-30sec_12harm", "19_15harm50sec")


def load_ur10e(real_data: Path, names: Iterable[str]) -> Session:
    """Runs whose file names hold the given parts; their clocks know nothing of each other."""
    paths = [path for name in names for path in real_data.glob("ur10e/*/*.csv") if name in path.name]
    with tempfile.TemporaryDirectory() as place:
        settings = Path(place) / "session.toml"
        settings.write_text(ur10e_settings())
        runs = [run for path in paths for run in load_session(path, session_file=settings).runs]
    return Session("ur10e", tuple(runs), common_clock=False)


def halves(run: Recording) -> tuple[Session, Session]:
    middle = len(run) // 2
    first, second = (run.at(part, name) for part, name in ((slice(0, middle), "a"), (slice(middle, None), "b")))
    return Session("a", (first,)), Session("b", (second,))


def ur10e_settings(torque: str = "current", first: int = 14) -> str:
    """A session.toml for the UR10e's tables: no header, columns by number."""
    lines = ["[columns]", '1 = "time"']
    for start, channel in ((2, "position"), (8, "velocity"), (first, torque)):
        lines += [f'{start + i} = "{joint}_joint/{channel}"' for i, joint in enumerate(UR_JOINTS)]
    if torque == "current":
        gains = zip(UR_JOINTS, UR10E_GAINS, strict=True)
        lines += ["[drive_gain_Nm_per_A]", *(f"{joint}_joint = {gain}" for joint, gain in gains)]
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="session")
def ur10e_toml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Settings by which the UR10e's currents are read as torque."""
    path = tmp_path_factory.mktemp("ur10e") / "session.toml"
    path.write_text(ur10e_settings())
    return path


@pytest.fixture(scope="session")
def sapienza(real_data: Path) -> Session:
    return load_sapienza(real_data)


def load_sapienza(real_data: Path) -> Session:
    """The 1 kHz Panda, whose four files hold one number a line, row by row."""
    folder = real_data / "panda/sapienza_inria_2019"

    def table(name: str) -> np.ndarray:
        return np.loadtxt(folder / f"exciting_traj_{name}.txt").reshape(-1, 7)

    time = np.loadtxt(folder / "exciting_traj_time.txt")
    joints = tuple(f"panda_joint{i}" for i in range(1, 8))
    run = Recording("sapienza", joints, time, table("positions"), table("torques"), velocity=table("velocity"))
    return Session("sapienza", (run,))
