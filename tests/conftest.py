"""What all tests share: the shipped arm, whole and in part; for files of strangers, a watch and good ones."""

from pathlib import Path

import pytest
from hypothesis import settings

from ident.robot.arm import ArmModel
from tests.fuzz.guard import Guard

# How long an example takes says more of the machine than of the code.
settings.register_profile("armgap", deadline=None)
settings.load_profile("armgap")


@pytest.fixture(scope="session")
def guard() -> Guard:
    return Guard()


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good file of every kind; nothing is written among them."""
    from tests.fuzz.corpus import write_files

    folder = tmp_path_factory.mktemp("corpus")
    write_files(folder, net=False)
    return folder


@pytest.fixture(scope="session")
def tm5() -> ArmModel:
    """All six joints of the TM5-900."""
    return ArmModel.load("tm5-900")


@pytest.fixture(scope="session")
def three_joints() -> ArmModel:
    """Its first three joints, the others locked at zero."""
    return ArmModel.load("tm5-900", joints=["joint_1", "joint_2", "joint_3"])


@pytest.fixture(scope="session")
def two_joints() -> ArmModel:
    """Its first two."""
    return ArmModel.load("tm5-900", joints=["joint_1", "joint_2"])
