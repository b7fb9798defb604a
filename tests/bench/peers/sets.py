"""Recordings on which armgap and its peers are measured side by side: real arms, the shipped arm, a known truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ident.arrays import Array
from ident.recordings.joint_names import match_joints
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from ident.robot.names import data_path, find_urdf
from tests.bench.peers.ur10_fixture import JOINTS, Fixture
from tests.ident.conftest import UR10E_TEST, UR10E_TRAINING, halves, load_sapienza, load_ur10e

Run = tuple[Array, Array, Array]  # time, position, torque


@dataclass(frozen=True)
class Recorded:
    """One set."""

    name: str  # in the table
    urdf: Path  # the arm's description
    joints: tuple[str, ...]  # those that were recorded
    # Runs.
    train: list[Run]
    test: list[Run]
    truth: list[Array] | None = None  # torque of the test runs without noise, where it is known
    friction: bool = True  # whether friction may be sought: an arm without is told so to peers that can't find out
    corner: float = 10.0  # of the peers' filter [Hz]


def real_sets(folder: Path) -> Iterator[Recorded]:
    """Sets of real arms, as far as they are there."""
    if (folder / "ur10e").is_dir():
        yield _ur10e(folder)
    for name, path, robot in (
        ("UR10 CB", "ur10_cb/ur10_exciting_trajectory.db3", "ur10"),
        ("Panda 30 Hz", "panda/unisa_fer/panda_exciting_trajectory.db3", "panda"),
    ):
        if (folder / path).is_file():
            arm = ArmModel.load(robot)
            run = match_joints(load_session(folder / path), arm.joint_names)[0].runs[0]
            yield _halves(name, find_urdf(robot), run)
    if (folder / "panda/sapienza_inria_2019").is_dir():
        yield _halves("Panda 1 kHz", find_urdf("panda"), load_sapienza(folder).runs[0])


def shipped_set() -> Recorded:
    """The shipped recordings of the TM5-900 as the paper uses them."""
    folders = {name: load_session(data_path(f"logs/tm5_900/{name}")) for name in ("T1", "T2", "E1", "E2")}
    train = [_plain(run) for name in ("T1", "T2") for run in folders[name].runs]
    test = [_plain(run) for name in ("E1", "E2") for run in folders[name].runs]
    return Recorded("TM5-900 shipped", find_urdf("tm5-900"), folders["T1"].joints, train, test)


def fixture_sets(place: Path, seeds: int) -> Iterator[Recorded]:
    """The UR10 with a known truth at both levels of noise."""
    made = Fixture()
    made.check()
    urdf = made.write_urdf(place / "ur10_nominal.urdf")
    for level, corner in (("low", 5.0), ("high", 5.0)):  # of 5 and 10 Hz the better one for figaroh
        for number in range(seeds):
            train, test = (made.split(name, level, number) for name in ("training", "validation"))
            runs = [[(one.time, one.q, one.tau)] for one in (train, test)]
            name = f"UR10 truth, {level} {number + 1}"
            yield Recorded(name, urdf, JOINTS, *runs, truth=[test.true_tau], friction=False, corner=corner)


def _ur10e(folder: Path) -> Recorded:
    train, test = (load_ur10e(folder, names).runs for names in (UR10E_TRAINING, UR10E_TEST))
    runs = ([_plain(run) for run in part] for part in (train, test))
    return Recorded("UR10e", folder / "ur10e/ur10e.urdf", train[0].joints, *runs)


def _halves(name: str, urdf: Path, run: Recording) -> Recorded:
    return Recorded(name, urdf, run.joints, *([_plain(half.runs[0])] for half in halves(run)))


def _plain(run: Recording) -> Run:
    assert run.effort is not None
    return run.time, run.position, run.effort
