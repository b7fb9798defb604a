"""Laws of compiled loops: where their machine code is kept."""

import os
from pathlib import Path

import numba
import numpy as np
import pytest

from ident.compiled import compiled


def total(values: np.ndarray) -> float:
    found = 0.0
    for value in values:
        found += value
    return found


@pytest.mark.parametrize("mode", [0o700, 0o777])
def test_code_is_kept_in_a_private_cache_or_nowhere(mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: of a read-only installation it is kept in a cache that is the user's alone; where others may write, or no
    folder can be made, it runs all the same and nothing is kept. numba's own setting is as it was."""
    (tmp_path / "armgap").mkdir()
    (tmp_path / "armgap").chmod(mode)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda *_: False)
    before = numba.config.CACHE_DIR
    assert compiled()(total)(np.arange(4.0)) == 6.0
    assert before == numba.config.CACHE_DIR
    assert bool(list((tmp_path / "armgap").rglob("*.nbi"))) == (mode == 0o700)
