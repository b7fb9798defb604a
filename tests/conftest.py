"""What tests of files of strangers share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.guard import Guard


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
