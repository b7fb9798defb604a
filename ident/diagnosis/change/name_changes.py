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

from ident.diagnosis.change.change_features import describe_changes, later_scorers
from ident.diagnosis.change.change_sets import ChangeSet
from ident.diagnosis.change.gain_uncertainty import BODIES, solve_body
from ident.inference.calibration import NameCalibration, load_names
from ident.inference.conclusion import Named, tell
from ident.inference.estimate import CLASS_ODDS, Estimate, estimate, widened
from ident.inference.features import Described
from ident.regression.cross_validation import HeldOutScore
from ident.regression.least_squares import project

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
    uncertain = [_with_gains_uncertain(one, likely, calibration) for one in estimates]
    told = tell(described, uncertain, scorers)
    return ToldChanges(likely, told.names, told.unlikely, told.ladder, calibration)


def _with_gains_uncertain(told: Estimate, likely: ChangeSet, calibration: NameCalibration) -> Estimate:
    """The estimate of a body with each joint's gain uncertain; other estimates as they are."""
    group, design = told.refined, likely.design
    if group.effect.id not in BODIES:
        return told
    model = project(likely.evidence.gram(), likely.evidence, design.prior, likely.chosen)
    scale = likely.evidence.scale[group.columns]
    scaled, covariance = solve_body(likely.evidence, model, group, told.coefficients * scale, design.gain_uncertainty)
    coefficients = scaled / scale
    certain = covariance / np.outer(scale, scale)
    parameters = group.effect.parameters(design.later_session, group.joint, group.variant, coefficients, certain)
    wide = widened(group.effect.id, parameters, parameters, calibration.widths)
    return replace(told, parameters=wide, coefficients=coefficients, covariance=certain)


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
