"""What compiling takes is known, and counted once."""

import numba

from ident.compiled import compile_seconds


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
