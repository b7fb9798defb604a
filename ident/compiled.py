"""Compiled loops: numba's, kept beside their source or in a cache that is the user's alone."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from ident.user_cache import user_cache

NUMBAS: Any = numba.config  # which no type checker knows


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Makes a function machine code, which is kept for processes to come.

    Where the source's folder can't be written it is kept in the user's cache. Where others may write there, or there is
    none, every process compiles it: kept code is run as it lies there.

    Args:
        options: Those of `numba.njit`.
    """

    def kept(function: Callable[..., Any]) -> Callable[..., Any]:
        given = NUMBAS.CACHE_DIR
        beside = os.access(Path(function.__code__.co_filename).parent, os.W_OK)
        folder = given or ("" if beside else user_cache())
        NUMBAS.CACHE_DIR = str(folder or "")
        try:
            return numba.njit(cache=folder is not None, **options)(function)
        finally:
            NUMBAS.CACHE_DIR = given

    return kept
