"""Identifiers of the contract and numbers as people read them."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.effects.effect_info import STATE
from ident.units import OF_KEYS, split_key

MINUS = "−"
DASH = "–"
# A number below this is what sums leave of nothing, in any unit.
ROUNDING = 1e-12
POWER = re.compile(r"\d[\d.]*e[+-]?\d+")
AT_REST = ("stiffness_Nm_rad", "rest_rad")
# A value that is less, as a share of its interval's width, is what a solver left of zero.
NOTHING = 1e-3
UNITS = re.compile(r"(?<=\d) (N m|J|kg|g|s|%|Hz)\b|(?<=\d) %")
# Parameters that are counted, not measured.
COUNTED = frozenset({"order", "link", "other_joint"})
TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def fixed(value: float | None, places: int = 2) -> str:
    """A number with so many decimals."""
    if value is None or not math.isfinite(value):
        return DASH
    text = f"{value:.{places}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def significant(value: float | None, digits: int = 2) -> str:
    """A number with so many significant digits; rounding is 0.

    Between 0.0001 and 10 millions never in powers of ten, from five digits on with thousands apart.
    """
    if value is None or not math.isfinite(value):
        return DASH
    if abs(value) < ROUNDING:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if not -5 < size < 7:
        return f"{value:.{digits - 1}e}".replace("-", MINUS)
    if size > 3:
        return f"{round(value, digits - 1 - size):,.0f}".replace("-", MINUS)
    return fixed(value, max(0, digits - 1 - size))


def pair(value: float | None, spread: float | None, places: int | None = None) -> str:
    """Mean and standard deviation in one cell; the mean alone where there is no spread, as of a
    single run.

    With two decimals where no other number is given, and as many more as the larger of both needs
    for two digits.
    """
    if places is None:
        size = max(abs(value or 0.0), abs(spread or 0.0))
        places = 2
        if ROUNDING < size < math.inf:
            places = max(2, 1 - math.floor(math.log10(size)))
    if spread is None:
        return fixed(value, places)
    return f"{fixed(value, places)} ± {fixed(spread, places)}"


def places_for(values: Iterable[float]) -> int:
    """Decimals that suit a whole table: about three digits of its largest number."""
    sizes = np.abs(np.asarray(list(values), dtype=float))
    largest = float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
    if largest >= 1000:
        return 0
    if largest >= 100:
        return 1
    return 2 if largest >= 0.5 else 3


def row_places(values: Iterable[float]) -> int:
    """Decimals of a row of torques: two, three where its smallest would else have no digit."""
    sizes = np.abs(np.asarray(list(values), dtype=float))
    known = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    smallest = float(np.min(known, initial=np.inf))
    return 3 if smallest < 0.05 else 2


def glue(text: str) -> str:
    """Units kept on the line of their numbers."""
    return UNITS.sub(lambda unit: unit[0].replace(" ", "\u00a0"), text)


def table_places(values: Iterable[float]) -> int:
    """Decimals of a table's row: two, fewer where its numbers are large."""
    return min(2, places_for(values))


def pairs(means: Sequence[float], spreads: Sequence[float], several: bool) -> list[str]:
    """A table's row of means, each with its standard deviation where there are several runs."""
    places = table_places(means)
    return [pair(a, b if several else None, places) for a, b in zip(means, spreads, strict=True)]


def bar(value: float, of: Iterable[float]) -> float:
    """Length of a bar in per cent of the longest."""
    sizes = np.abs(np.ravel(list(of)))
    top = float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
    if not top > 0 or not np.isfinite(value):
        return 0.0
    return round(100.0 * abs(float(value)) / top, 1)


def percent(share: float | None) -> str:
    """A share as a whole percentage; one decimal near 0 and 100."""
    if share is None or not math.isfinite(share):
        return DASH
    number = 100.0 * share
    near = 0.0 < abs(number) < 9.5 or 99.0 < abs(number) < 99.95
    return f"{fixed(number, 1 if near else 0)} %"


def effect_name(effect: str) -> str:
    """An effect's identifier as words."""
    return (
        effect.replace("_dependent", "-dependent")
        .replace("_", " ")
        .replace("stribeck", "Stribeck")
        .replace("presliding", "pre-sliding")
        .replace("coulomb", "Coulomb")
    )


def parameter_name(name: str) -> tuple[str, str]:
    """A parameter's name as words, and its unit."""
    if name in TABLES["parameters"]:
        words, unit = TABLES["parameters"][name]
        return words, unit
    stem, unit = split_key(name)
    return effect_name(stem), unit


def parameter_cells(name: str, value: Any) -> dict[str, str]:
    """A parameter's name, value, 95 % interval and unit as text; counts and states have no
    interval.
    """
    words, unit = parameter_name(name)
    cells = {
        "name": words,
        "unit": unit,
        "value": str(value),
        "interval": "",
    }
    if not isinstance(value, Mapping):
        return cells
    cells["value"] = significant(value["value"], 3)
    if name in COUNTED:
        cells["value"] = f"{value['value']:.0f}"
    elif not name.startswith(STATE):
        low = significant(value.get("low"), 3)
        high = significant(value.get("high"), 3)
        width = (value.get("high") or 0.0) - (value.get("low") or 0.0)
        if abs(value["value"]) < NOTHING * width:
            cells["value"] = "0"
        known = {"high": f"{low} or more", "low": f"{high} or less", "both": "open"}
        cells["interval"] = known.get(value.get("open", ""), f"{low} to {high}")
    return cells


def parameter_rows(parameters: Mapping[str, Any]) -> list[dict[str, str]]:
    """The cells of all parameters of an effect's record; a spring that holds on has no rest."""
    slope = parameters.get("stiffness_Nm_rad")
    is_flat = isinstance(slope, Mapping) and abs(slope["value"]) < ROUNDING
    hidden = AT_REST if is_flat else ()
    shown = {name: value for name, value in parameters.items() if name not in hidden}
    return [parameter_cells(name, value) for name, value in shown.items()]


def parameters_in_words(parameters: Mapping[str, Any]) -> str:
    """All parameters of an effect's record in one line: `knee 0.2 rad/s [0.13 to 0.3], …`."""
    sentences = []
    for row in parameter_rows(parameters):
        interval = f"[{row['interval']}]" if row["interval"] else ""
        words = (row["name"], row["value"], row["unit"], interval)
        sentences.append(" ".join(filter(None, words)))
    return ", ".join(sentences)


def with_units(text: str) -> str:
    """A sentence whose figures go by their words and units instead of their keys: `stiffness −0.05
    N m/rad lies …`.
    """

    def worded(figure: re.Match[str]) -> str:
        words, unit = parameter_name(figure["key"])
        number = POWER.sub(lambda power: significant(float(power[0])), figure["number"] or "")
        return f"{words}{number} {unit}" if number else words

    keys = "|".join(sorted(OF_KEYS, key=len, reverse=True))
    number = r"(?P<number>(?: below| above)? -?\d[\d.e+-]*)?"
    words = re.sub(rf"\b(?P<key>mu|[a-z]\w*(?:{keys}))\b{number}", worded, text)
    return re.sub(r"(?<=[ (\[])-(?=\d)", MINUS, words)


def sentence(text: str) -> str:
    """The text with a capital at its beginning."""
    return text[:1].upper() + text[1:]


def lowered(text: str) -> str:
    """The text with a small letter at its beginning."""
    return text[:1].lower() + text[1:]


def axis_name(axis: str) -> str:
    """An axis of the map as words."""
    return str(TABLES["axes"].get(axis, (axis, ""))[0])


def axis_unit(axis: str) -> str:
    """Its unit."""
    return str(TABLES["axes"].get(axis, ("", ""))[1])


def interval_words(axis: str, low: float, high: float) -> str:
    """Where on an axis."""
    if axis != "direction":
        return f"{significant(low)} to {significant(high)} {axis_unit(axis)}".strip()
    if low < 0 < high:
        return "both ways"
    return "forwards" if low + high > 0 else "backwards"


def shade(share: float) -> str:
    """A cell's style: how much of the page's colour of dense cells lies on its paper, light or
    dark.
    """
    return f"--dense: {100.0 * min(1.0, max(0.0, share)):.0f}%"
