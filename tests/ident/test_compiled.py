"""What compiling takes is known, and counted once."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from ident.compiled import WORDS, compile_seconds, working_clock
from ident.progress import listening, stage, step


def test_compiling_is_counted_once() -> None:
    """Law: the first call of a loop compiles, with those that it calls; the next adds nothing."""
    before = compile_seconds()

    @numba.njit
    def inner(x):  # type: ignore[no-untyped-def]
        return x + 1.0

    @numba.njit
    def outer(x):  # type: ignore[no-untyped-def]
        return inner(x) * 2.0

    assert outer(1.0) == 4.0
    first = compile_seconds()
    assert first > before
    assert outer(2.0) == 6.0
    assert compile_seconds() == first


def test_compiling_is_told_and_foretells_nothing() -> None:
    """Law: the clock of work stands still while a loop is compiled, and whoever waits hears why."""

    @numba.njit
    def loop(x):  # type: ignore[no-untyped-def]
        return x * 3.0

    heard: list[tuple[str, float, float | None]] = []
    before = working_clock()
    spent = compile_seconds()
    with listening(lambda *seen: heard.append(seen), working_clock):
        stage("work", 0.1)
        assert loop(1.0) == 3.0
        step(1, 2)
    compiling = compile_seconds() - spent
    assert compiling > 0.0
    assert working_clock() - before < compiling
    assert [words for words, _, _ in heard] == ["work", WORDS, "work"]
    assert heard[1][1:] == (0.1, None)
    left = heard[-1][2]
    assert left is not None
    assert left < compiling


CALLED = """
from ident.compiled import compiled
STEP = {step}
@compiled()
def inner(x):
    return x + {added}
"""
CALLING = """
from ident.compiled import compiled
from called import STEP, inner
@compiled()
def outer(x):
    return inner(x) * STEP
print(outer(1.0), sum(outer.stats.cache_hits.values()))
"""


@pytest.mark.parametrize(("step", "added", "value"), [(2.0, 5.0, "12.0"), (3.0, 1.0, "6.0")])
def test_code_is_made_anew_where_what_it_calls_has_changed(
    step: float, added: float, value: str, tmp_path: Path
) -> None:
    """Law: kept code is used again, and not where a file that it calls, or takes a number from, is another."""

    def run() -> list[str]:
        words = [sys.executable, str(tmp_path / "calling.py")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
        return subprocess.run(words, env=environment, capture_output=True, text=True, check=True).stdout.split()

    (tmp_path / "calling.py").write_text(CALLING)
    (tmp_path / "called.py").write_text(CALLED.format(step=2.0, added=1.0))
    assert run() == ["4.0", "0"]
    assert run() == ["4.0", "1"]
    (tmp_path / "called.py").write_text(CALLED.format(step=step, added=added))
    assert run()[0] == value
    kept = [path.name for path in (tmp_path / "__pycache__").iterdir() if path.name.startswith("called-")]
    assert len(kept) == 1
