"""Which changes of the likeliest set are names: their probability by a calibration that was fitted
to pairs with truth.

`calibration_changes.toml` is written by `python -m ident.benchmark.change_calibration fit`; no
number of it is set by hand. Names, classes and intervals are those of a diagnosis
(`ident.inference`). A body's size is as uncertain as the gains of the torque readings beside that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arrays import Float
from ident.diagnosis.change.change_features import describe_changes, later_scorers
from ident.diagnosis.change.change_sets import ChangeSet
from ident.diagnosis.change.gain_uncertainty import BODIES, GainUncertainty, solve_body
from ident.effects.base import Interval
from ident.inference.calibration import NameCalibration, load_names
from ident.inference.conclusion import Named, tell
from ident.inference.estimate import CLASS_ODDS, Estimate, estimate
from ident.inference.features import Described
from ident.regression.cross_validation import HeldOutScore
from ident.regression.least_squares import project

# Gains as good as known.
CERTAIN = GainUncertainty(single=1e-4)
FILE = Path(__file__).with_name("calibration_changes.toml")


@dataclass(frozen=True, eq=False)
class ToldChanges:
    """The changes of a set by whether they are likelier than not.

    Attributes:
        likely: The likeliest set.
        names: Its changes that are likelier than not, in the order of the torque that they explain.
        unlikely: Its other changes.
        ladder: Held-out scores of the later set without changes, and after each name.
        calibration: The fitted numbers.
    """

    likely: ChangeSet
    names: tuple[Named, ...]
    unlikely: tuple[Named, ...]
    ladder: tuple[HeldOutScore, ...]
    calibration: NameCalibration


def tell_changes(likely: ChangeSet, calibration: NameCalibration | None = None) -> ToldChanges:
    """The likeliest set of changes, each with its probability.

    Args:
        likely: The set.
        calibration: The fitted numbers; what the package ships if None.
    """
    calibration = load_names(FILE) if calibration is None else calibration
    scorers = later_scorers(likely)
    described = describe_changes(likely, scorers)
    session = likely.design.later_session
    estimates = estimate(described, session, calibration)
    uncertain = [_with_gains_uncertain(told, likely) for told in estimates]
    told = tell(described, uncertain, scorers)
    return ToldChanges(likely, told.names, told.unlikely, told.ladder, calibration)


def _with_gains_uncertain(told: Estimate, likely: ChangeSet) -> Estimate:
    """The estimate of a body with each joint's gain uncertain; other estimates as they are.

    What gains leave open is known beforehand: fitted widths are of what is left open beside it.
    """
    if told.refined.effect.id not in BODIES:
        return told
    known, _, _ = _body(told, likely, CERTAIN)
    free, coefficients, covariance = _body(told, likely, likely.design.gain_uncertainty)
    parameters = {
        name: _wider_by_gains(interval, known[name], free[name])
        for name, interval in told.parameters.items()
    }
    return replace(told, parameters=parameters, coefficients=coefficients, covariance=covariance)


def _body(
    told: Estimate, likely: ChangeSet, uncertainty: GainUncertainty
) -> tuple[dict[str, Interval], Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Parameters of a body, its coefficients and their covariance, gains uncertain as is said."""
    group = told.refined
    evidence = likely.evidence
    design = likely.design
    model = project(evidence.gram(), evidence, design.prior, likely.chosen)
    scale = evidence.scale[group.columns]
    scaled, cells = solve_body(evidence, model, group, told.coefficients * scale, uncertainty)
    coefficients = scaled / scale
    covariance = cells / np.outer(scale, scale)
    numbers = (group.variant, coefficients, covariance)
    parameters = group.effect.parameters(design.later_session, group.joint, *numbers)
    return parameters, coefficients, covariance


def _wider_by_gains(told: Interval, known: Interval, free: Interval) -> Interval:
    """An interval with what uncertain gains add to its square; one that is open stays."""
    if told.open or free.open or not np.isfinite(free.value):
        return told
    below = (free.value - free.low) ** 2 - (known.value - known.low) ** 2
    below = max(below, 0.0)
    above = (free.high - free.value) ** 2 - (known.high - known.value) ** 2
    above = max(above, 0.0)
    down = np.sqrt((told.value - told.low) ** 2 + below)
    low = free.value - float(down)
    up = np.sqrt((told.high - told.value) ** 2 + above)
    high = free.value + float(up)
    return Interval(free.value, low, high, low_with_urdf=low, high_with_urdf=high)


def other_places(described: Described, temper: float) -> list[tuple[str, int]]:
    """Effects elsewhere that explain a change as well, the likeliest first: their ids and joints,
    -1 the whole arm.

    Args:
        described: The change with its rivals.
        temper: Exponent of the evidence between rivals.
    """
    group = described.group
    here = {group.joint} if group.effect.scope == "joint" else {-1}
    near = []
    for (effect, joint, _), deficit in sorted(described.rivals.items(), key=lambda pair: pair[1]):
        if joint not in here and temper * deficit <= np.log(CLASS_ODDS):
            near.append((effect, joint))
    return list(dict.fromkeys(near))
