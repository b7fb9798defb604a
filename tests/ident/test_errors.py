"""Laws of the error tree and of read-only arrays."""

import pickle

import numpy as np
import pytest

from ident.arrays import freeze
from ident.errors import ArmgapError, InputError, ModelError, RecordingError, RobotError


@pytest.mark.parametrize("kind", [InputError, RecordingError, RobotError, ModelError])
def test_message_is_one_line_with_place_fault_and_remedy(kind: type[InputError]) -> None:
    """The message names where, what and remedy in this order, in one line, and keeps them as data."""
    error = kind("log.csv, column 3", "text in a number: 'x'", "correct the cell")
    assert str(error) == "log.csv, column 3: text in a number: 'x'; correct the cell"
    assert (error.where, error.what, error.remedy) == (
        "log.csv, column 3",
        "text in a number: 'x'",
        "correct the cell",
    )
    assert isinstance(error, ArmgapError)


def test_an_error_survives_the_way_from_a_worker_process() -> None:
    """Copied through a process boundary an error keeps its class and its data."""
    error = pickle.loads(pickle.dumps(RobotError("a", "b", "c")))
    assert type(error) is RobotError
    assert (error.where, error.what, error.remedy) == ("a", "b", "c")


def test_freeze_copies_and_forbids_writing() -> None:
    """Changing the source does not change the copy, and the copy can't be written."""
    source = np.arange(3)
    copy = freeze(source)
    source[0] = 7
    assert copy[0] == 0.0
    assert copy.dtype == float
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 1.0
