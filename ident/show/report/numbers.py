"""Numbers as people read them: rounded, with a true minus, a dash where there is none."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

import numpy as np

MINUS, DASH = "−", "–"
UNITS = re.compile(r"(?<=\d) (N m|J|kg|g|s|%|Hz)\b|(?<=\d) %")


def fixed(value: float | None, places: int = 2) -> str:
    """A number with so many decimals."""
    if value is None or not math.isfinite(value):
        return DASH
    text = f"{value:.{places}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def significant(value: float | None, digits: int = 2) -> str:
    """A number with so many significant digits, never in powers of ten between 0.0001 and 100,000."""
    if value is None or not math.isfinite(value):
        return DASH
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if not -5 < size < 5:
        return f"{value:.{digits - 1}e}".replace("-", MINUS)
    return fixed(value, max(0, digits - 1 - size))


def pair(value: float | None, spread: float | None, places: int = 2) -> str:
    """Mean and standard deviation in one cell; the mean alone where there is no spread, as of a single run."""
    if spread is None:
        return fixed(value, places)
    return f"{fixed(value, places)} ± {fixed(spread, places)}"


def places_for(values: Iterable[float]) -> int:
    """Decimals that suit a whole table: about three digits of its largest number."""
    sizes = np.abs(np.asarray(list(values), dtype=float))
    largest = float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
    return 0 if largest >= 1000 else 1 if largest >= 100 else 2 if largest >= 0.5 else 3


def row_places(values: Iterable[float]) -> int:
    """Decimals of a row of torques: two, three where its smallest would else have no digit."""
    sizes = np.abs(np.asarray(list(values), dtype=float))
    smallest = float(np.min(sizes[np.isfinite(sizes) & (sizes > 0.0)], initial=np.inf))
    return 3 if smallest < 0.05 else 2


def glue(text: str) -> str:
    """Units kept on the line of their numbers."""
    return UNITS.sub(lambda found: found[0].replace(" ", "\u00a0"), text)


def table_places(values: Iterable[float]) -> int:
    """Decimals of a table's row: two, fewer where its numbers are large."""
    return min(2, places_for(values))


def percent(share: float | None) -> str:
    """A share as a whole percentage; one decimal near 0 and 100."""
    if share is None or not math.isfinite(share):
        return DASH
    number = 100.0 * share
    near = 0.0 < abs(number) < 9.5 or 99.0 < abs(number) < 99.95
    return f"{fixed(number, 1 if near else 0)} %"
