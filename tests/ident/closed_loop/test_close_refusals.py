"""What `ident close` can't begin leaves nothing behind; what it fills is not also its result's file."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ident import InputError
from ident.api.simulating import close
from ident.export.choose import roll_run
from ident.outputs import check_outputs


@pytest.mark.parametrize(
    "options",
    [
        {"effects": ("payload::1e300",)},
        {"effects": ("payload::-5",)},
        {"effects": ("backlash:joint_99:1",)},
        {"effects": ("nothing:joint_1:1",)},
        {"recorder": "true"},
        {"recorder": '"{commands}'},
    ],
)
def test_what_can_not_begin_leaves_nothing(options: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        close("tm5-900", tmp_path / "closed", compared=False, **options)
    assert not (tmp_path / "closed").exists()


def test_a_folder_that_was_filled_stays(tmp_path: Path) -> None:
    """Law: what a user's program was given, or has recorded, is no leftover."""
    with pytest.raises(InputError, match="can't be run"):
        close("tm5-900", tmp_path / "closed", recorder="/nowhere/run {commands} {session}")
    assert list((tmp_path / "closed").rglob("*.parquet")) or list((tmp_path / "closed").rglob("*.csv"))


def test_a_folder_that_is_filled_is_no_file_of_the_same_command(tmp_path: Path) -> None:
    """Law: this is told before the work, for a folder that is not there yet, too."""
    place = tmp_path / "closed"
    with pytest.raises(InputError, match="is read by the same command"):
        check_outputs([place], {"--json": place})
    check_outputs([place], {"--json": place / "a.json"})


def test_a_window_longer_than_any_run_fits_none() -> None:
    motion: Any = SimpleNamespace(time=np.arange(9.0), interval=1e-3, n=2)
    model: Any = None
    assert not len(roll_run(model, motion, 3, horizon=1e308).ends)
