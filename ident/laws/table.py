"""The table of what is known of each effect beside its law, and the laws of one joint's states that it tells of."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from ident.laws.friction import JointStates

# Torque of a joint for coefficients of one, by its states and what bends the law [N m].
Columns = Callable[[JointStates, Mapping[str, float]], list[Any]]

TABLE: Mapping[str, Any] = tomllib.loads(Path(__file__).with_name("effects.toml").read_text(encoding="utf-8"))
# Rows that have `states` name the file of this package in which the function of the effect's name is its law.
STATES: Mapping[str, Any] = {effect: row["states"] for effect, row in TABLE["effects"].items() if "states" in row}
COLUMNS: Mapping[str, Columns] = {
    effect: getattr(import_module(f"ident.laws.{row['file']}"), effect) for effect, row in STATES.items()
}
