"""The numbers of the regression: how time is cut, what counts as seen, how much friction varies from run to run."""

from __future__ import annotations

from ident.records import Settings


class RegressionSettings(Settings, table="regression"):
    """What the sums are made of, and what is known beforehand."""


USUAL_REGRESSION = RegressionSettings()
