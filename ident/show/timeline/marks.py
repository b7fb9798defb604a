"""Moments worth looking at, such as where a diagnosis finds the gap."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mark:
    """One stretch of one run.

    Attributes:
        run: Index of the run among the motions.
        start_s: Start, from the run's first sample [s].
        end_s: End [s].
        joint: The joint concerned.
        text: What is there.
    """

    run: int
    start_s: float
    end_s: float
    joint: str
    text: str
