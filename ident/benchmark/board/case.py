"""One session of the board with its truth, before the two are parted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ident.recordings.recording import Recording

# Tiers: drawn worlds; known effects on real recordings; real recordings of a measured cause.
DRAWN = "drawn"
PLANTED = "semi-real"
MEASURED = "real"
TIERS = (DRAWN, PLANTED, MEASURED)
# Answers beside the published effects: nothing is wrong; something that the list lacks.
NONE = "none"
OTHER = "other"


@dataclass(frozen=True, eq=False)
class BoardCase:
    """Recordings, the URDF that is given with them, and what is wrong."""

    tier: str
    kind: str  # single, pair, outside, healthy, untouched, measured
    arm: str  # name of the robot, or of the physical arm
    urdf: str  # text of the URDF, without shapes
    runs: tuple[Recording, ...]  # what is recorded
    effects: tuple[Mapping[str, Any], ...]  # what is wrong, as a semi-real answer says it
    before: tuple[Recording, ...] = ()  # the same arm as it was without that, in other motions
    unseen: Recording | None = None  # a motion of the arm without the effect, with its torque
    oracle: float | None = None  # probability that an oracle names the cause, if worked out
