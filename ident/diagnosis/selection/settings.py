"""The numbers by which effects are selected."""

from __future__ import annotations

from ident.records import Settings


class SelectionSettings(Settings, table="selection"):
    """Thresholds of the selection; each field's metadata hold `unit`, `meaning` and `source`."""


USUAL_SELECTION = SelectionSettings()
