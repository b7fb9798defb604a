"""What tests of files of strangers share."""

from pathlib import Path

import pytest
from hypothesis import settings

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
