"""The file of a calibration: `calibration.toml`, as a fit writes it and the diagnosis reads it.

    log odds = intercept + sum over features of weight (x - centre) / scale

where a feature that is no number counts as its centre.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ident.benchmark.logistic import Logistic, Scaling
from ident.errors import InputError
from ident.files import atomic_write
from ident.records import JsonTable
from ident.safe_read import read_toml

SCHEMA = "ident.calibration/1"


def write_calibration(path: Path, record: JsonTable) -> None:
    """Writes the file that the diagnosis reads, whole or not at all."""
    with atomic_write(path) as temporary:
        text = "# Written by `python -m ident.benchmark.calibrate fit`; no figure is set by hand.\n"
        temporary.write_text(text + tomli_w.dumps(_without_none(record)), encoding="utf-8")


def _without_none(value: Any) -> Any:
    """What TOML can hold."""
    if isinstance(value, Mapping):
        return {str(key): _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, (list, tuple)):
        return [_without_none(item) for item in value]
    return value


def read_calibration(path: Path) -> Logistic:
    """The regression of a calibration's file.

    Raises:
        InputError: Another file.
    """
    record = read_toml(path, "fit one: python -m ident.benchmark.calibrate fit")
    if record.get("schema") != SCHEMA:
        raise InputError(
            path, f"its schema is {record.get('schema')!r}", f"give a file of {SCHEMA}"
        )
    features: dict[str, dict[str, float]] = record["feature"]
    centre = np.array([values["centre"] for values in features.values()])
    scale = np.array([values["scale"] for values in features.values()])
    weights = np.array([values["weight"] for values in features.values()])
    return Logistic(tuple(features), Scaling(centre, scale), weights, float(record["intercept"]))


def summary_lines(record: JsonTable) -> list[str]:
    """A calibration in words."""
    origin = record["origin"]
    lines = [
        f"{origin['sessions']} sessions of {len(origin['units'])} units; "
        f"candidates right {origin['right']}, "
        f"wrong {origin['wrong']}, unknown {origin['unknown']}; ridge {record['ridge']:.1e}",
        f"intercept {record['intercept']:+.3f}",
    ]
    ordered = sorted(record["feature"].items(), key=lambda pair: -abs(pair[1]["weight"]))
    lines += [f"  {values['weight']:+8.3f}  {name}" for name, values in ordered]
    lines.append(
        "held out, by group: log score, area under the curve, names right and wrong; "
        "what was said: share right (rows)"
    )
    for group, score in record["held_out"].items():
        bins = ", ".join(
            f"{row['said']:.2f}: {row['right']:.2f} ({row['count']})" for row in score["bins"]
        )
        names = f"{score['names_right']} and {score['names_wrong']}"
        head = f"  {group}: {score['log_score']}, {score['auc']}, {names}"
        lines.append(f"{head}; {bins}")
    if "gap" in record:
        gap = record["gap"]["held_out"]
        lines.append(
            f"joints with a cause without a name told so: {gap['told']:.3f} of {gap['open']}, "
            f"others: {gap['false']:.3f} of {gap['closed']} (units left out); "
            f"temper {record['temper']:.3f}; even odds at {record['even_nats']:.1f} nats"
        )
    if "unlike_any_arm" in record:
        unlike = record["unlike_any_arm"]
        lines.append(
            f"beside a parameter that no arm has {unlike['share']:.3f} of the probability stays, "
            f"by {unlike['right']} right and {unlike['wrong']} wrong candidates; gains "
            f"{unlike['held_out_nats']:.1f} nats on units left out"
        )
    if "widths" in record:
        widths = record["widths"]
        lines.append(
            f"intervals of {widths['count']} parameters: factor {widths['factor']:.2f}, "
            f"law's share {widths['share']:.3f}, of what is left {widths['of_left']:.3f}; "
            f"they hold {widths['coverage_held_out']:.3f} on units left out"
        )
    return lines
