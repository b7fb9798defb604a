"""Every option of every command refuses what it can't use in one line, whatever it is given."""

import zlib
from pathlib import Path

import pytest

from tests.fuzz.corpus import write_files
from tests.fuzz.options import GOOD, attempt, load_all, trials

# One in so many trials, chosen by their text; `make fuzz` draws from all of them.
ONE_IN = 61


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("corpus")
    write_files(folder, net=False)
    load_all()
    return folder


def test_every_command_is_tried(corpus: Path) -> None:
    """Law: what is tried comes from the commands themselves."""
    found = {(trial.command, trial.option) for trial in trials(corpus)}
    assert {
        ("ident fit", "seed"),
        ("ident simulate", "rate"),
        ("plan excite", "minutes"),
        ("plan solve", "out"),
    } <= found
    assert len(found) > 100


def test_seeds_and_minutes_beyond_reason_are_refused(corpus: Path) -> None:
    """Law: a negative seed and an endless motion end in one line, whatever the command."""
    beyond = {"seed": ("-1", "nan"), "seeds": ("-1", "nan"), "minutes": ("-1", "nan", "inf", "1e9")}
    chosen = [one for one in trials(corpus) if one.value in beyond.get(one.option, ())]
    assert len({one.command for one in chosen}) >= 6
    outcomes = {f"{one.command} --{one.option}={one.value}": attempt(one) for one in chosen}
    assert {name: found for name, found in outcomes.items() if found[0] != "refused"} == {}


@pytest.mark.slow
def test_hostile_values_are_refused_or_taken(corpus: Path) -> None:
    """Law: exit 0, 2 or 3, one line, no traceback, nothing of the user's touched."""
    chosen = [t for t in trials(corpus) if zlib.crc32(f"{t.command} {t.option} {t.value}".encode()) % ONE_IN == 0]
    outcomes = {f"{one.command} --{one.option}={one.value[:20]!r}": attempt(one) for one in chosen}
    assert {name: found for name, found in outcomes.items() if found[0] not in GOOD} == {}
