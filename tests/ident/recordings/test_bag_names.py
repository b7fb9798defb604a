"""Names of files in a bag are literal: no way out of its folder, whatever its metadata say."""

import json
import os
import sqlite3
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from ident.errors import InputError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from tests.fuzz.guard import Guard
from tests.ident.foreign import write_bag
from tests.ident.recordings.test_bags import rows_of

# Names that mean something to a URI, a shell or a pattern, and nothing to a file system.
ODD_NAMES = ("100%.db3", "%2e%2e%2fx.db3", "a?b.db3", "a#b.db3", "a b.db3", "a?mode=rwc&cache=shared.db3", "[x]*.db3")


def rename(bag: Path, name: str) -> None:
    """Gives a bag's database another name."""
    (data,) = bag.glob("*.db3")
    data.rename(bag / name)
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(data.name, json.dumps(name)))


@pytest.mark.parametrize("name", ODD_NAMES)
def test_any_name_is_the_name_of_a_file(name: str, run: Recording, tmp_path: Path) -> None:
    written = write_bag(tmp_path / "bag", rows_of(run), StoragePlugin.SQLITE3)
    rename(written, name)
    bag = written.rename(tmp_path / "bag of 50%?")
    np.testing.assert_array_equal(load_session(bag).runs[0].position, run.position)
    np.testing.assert_array_equal(load_session(bag / name).runs[0].position, run.position)


@pytest.mark.parametrize("folder", ["..", "../secret", "/secret"])
def test_no_name_leads_out_of_the_folder(folder: str, run: Recording, tmp_path: Path, guard: Guard) -> None:
    """Law: a database elsewhere is not opened, whether its path is quoted, half quoted or plain, in file and name."""
    secret = write_bag(tmp_path / "secret", rows_of(run), StoragePlugin.SQLITE3)
    rename(secret, "x.db3")
    bag = write_bag(tmp_path / "bag", rows_of(run), StoragePlugin.SQLITE3)
    (data,) = bag.glob("*.db3")
    target = str(secret / "x.db3") if folder.startswith("/") else os.path.relpath(secret / "x.db3", bag)
    data.unlink()
    metadata = (bag / "metadata.yaml").read_text()
    quoted = (target, target.replace("/", "%2f"), target.replace(".", "%2e").replace("/", "%2f"), quote(target))
    for name in quoted:
        literal = bag / os.path.basename(name)
        literal.write_bytes(b"")  # what a check of names finds
        (bag / "metadata.yaml").write_text(metadata.replace(data.name, json.dumps(name)))
        with guard.watching(), pytest.raises(InputError):
            load_session(bag)
        assert guard.done == []
        literal.unlink()


def test_a_database_by_any_name_holds_tables_only(run: Recording, tmp_path: Path) -> None:
    """Law: what makes rows without end is refused, also in a file that does not end in .db3."""
    bag = write_bag(tmp_path / "bag", rows_of(run), StoragePlugin.SQLITE3)
    rename(bag, "x.data")
    with sqlite3.connect(bag / "x.data") as database:
        database.execute("CREATE VIEW endless AS SELECT 1")
    database.close()
    with pytest.raises(InputError, match="more than tables"):
        load_session(bag)
