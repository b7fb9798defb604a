"""Laws of kernels whose machine code is kept."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ident.compiled import user_cache

SOURCE = """
import numpy as np
from ident.compiled import compiled

def _twice(x):
    return 2.0 * x

def _four_times(x):
    return _twice(_twice(x))

@compiled("f2 f i f1", _twice, _four_times)
def scale(table, factor, first, out):
    for r in range(first, table.shape[0]):
        for c in range(table.shape[1]):
            out[c] += factor * _four_times(table[r, c])

@compiled("f1")
def allocate(values):
    values[0] = np.ones(int(values[0])).sum()
"""


def _module(folder: Path) -> ModuleType:
    path = folder / "made_up.py"
    if not path.exists():
        path.write_text(SOURCE)
    spec = importlib.util.spec_from_file_location("made_up", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _check(module: ModuleType) -> None:
    table, out, plain = np.arange(6.0).reshape(3, 2), np.zeros(2), np.zeros(2)
    module.scale(table, 0.5, 1, out)
    module.scale.python(table, 0.5, 1, plain)
    assert out.tolist() == plain.tolist() == [12.0, 16.0]


def test_a_kernel_does_what_its_function_does_and_is_kept(tmp_path: Path) -> None:
    """A process to come runs the kept code, and loads no compiler for it."""
    module = _module(tmp_path)
    _check(module)
    (kept,) = (tmp_path / "__pycache__").glob("made_up.scale-*.kernel")
    script = (
        "import sys, numpy as np, made_up\nout = np.zeros(2)\n"
        "made_up.scale(np.arange(6.0).reshape(3, 2), 0.5, 1, out)\n"
        "print(*out, 'numba' in sys.modules)"
    )
    paths = [str(tmp_path), str(Path(__file__).parents[2])]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {paths!r}\n{script}"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["12.0", "16.0", "False"]
    kept.write_bytes(kept.read_bytes()[:-1])  # damaged: compiled again
    _check(_module(tmp_path))


def test_no_code_is_kept_where_others_may_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: the cache is this user's alone: neither a folder of others, nor one open to them, nor a link."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache() == tmp_path / "armgap"
    assert (tmp_path / "armgap").stat().st_mode & 0o777 == 0o700
    (tmp_path / "armgap").chmod(0o777)
    assert user_cache() is None
    monkeypatch.setattr("os.geteuid", lambda: 54321)
    (tmp_path / "armgap").chmod(0o700)
    assert user_cache() is None
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "links"))
    (tmp_path / "links").mkdir()
    (tmp_path / "links/armgap").symlink_to(tmp_path / "armgap")
    assert user_cache() is None


def test_what_would_be_read_wrongly_is_refused(tmp_path: Path) -> None:
    """Other dtypes, other numbers of dimensions, slices with strides, and too few arguments never reach the code."""
    scale = _module(tmp_path).scale
    table = np.zeros((4, 4))
    for wrong in (table.astype(np.float32), table[0], table[:, ::2], table.T[1:], [[0.0]]):
        with pytest.raises(TypeError, match="C-contiguous array of doubles with 2 dimensions"):
            scale(wrong, 1.0, 0, np.zeros(4))
    with pytest.raises(TypeError, match="takes 4 arguments"):
        scale(table, 1.0, 0)


def test_a_kernel_that_allocates_is_no_kernel(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="may not allocate or raise"):
        _module(tmp_path).allocate(np.full(1, 3.0))
