"""What compiling takes is known, and counted once."""

import numba

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
