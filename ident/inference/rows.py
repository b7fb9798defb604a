"""A conclusion as rows of a corpus: one a chosen effect, one a joint, from which probabilities are
fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

from ident.effects.base import SessionContext
from ident.inference.calibration import NameCalibration
from ident.inference.conclusion import Conclusion, Named
from ident.inference.estimate import Estimate, estimate


class Concluded(Protocol):
    """Chosen effects, whatever they were chosen from."""

    @property
    def names(self) -> tuple[Named, ...]:
        """Chosen effects that are likelier than not."""

    @property
    def unlikely(self) -> tuple[Named, ...]:
        """Chosen effects that are not likelier than not."""

    @property
    def calibration(self) -> NameCalibration:
        """The fitted numbers by which they were told."""


def candidate_rows(
    conclusion: Concluded, session: SessionContext, joints: Sequence[str]
) -> list[dict[str, Any]]:
    """A row for each chosen effect: features, rivals, and intervals without the fitted factor.

    Args:
        conclusion, session, joints: The causes, the runs, and the joints' names.
    """
    chosen = [*conclusion.names, *conclusion.unlikely]
    described = [name.described for name in chosen]
    plain = replace(conclusion.calibration, widths=None)
    estimates = estimate(described, session, plain)
    rows = []
    for k, (name, plain_estimate) in enumerate(zip(chosen, estimates, strict=True)):
        rows.append(_row(name, plain_estimate, joints, k < len(conclusion.names)))
    return rows


def _row(name: Named, plain: Estimate, joints: Sequence[str], named: bool) -> dict[str, Any]:
    group = name.group
    of_joint = group.effect.scope == "joint"
    other = group.variant.other
    rivals = []
    for (effect, joint, partner), deficit in name.described.rivals.items():
        where = joints[joint] if joint >= 0 else None
        rivals.append({"effect": effect, "joint": where, "other": partner, "deficit": deficit})
    return {
        "effect": group.effect.id,
        "joint": joints[group.joint] if of_joint else None,
        "other": None if other is None else joints[other],
        "joints": [joints[j] for j in name.affected_joints],
        "class": [*plain.rivals, *(f"{group.effect.id}:{joints[j]}" for j in plain.places)],
        "features": dict(name.described.features),
        "rivals": rivals,
        "parameters": {key: value.to_dict() for key, value in plain.parameters.items()},
        "probability": plain.class_probability,
        "named": named,
    }


def joint_rows(conclusion: Conclusion, joints: Sequence[str]) -> list[dict[str, Any]]:
    """For each joint that has samples what is left there beside the names.

    Returns:
        Dicts of `joint` (its name) and `features` (values by name).
    """
    return [
        {"joint": joints[left.joint], "features": dict(left.features)}
        for left in conclusion.joints.values()
    ]
