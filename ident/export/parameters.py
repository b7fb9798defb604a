"""The parameter file: all that was identified, units in the names, estimates with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import tomli_w

from ident.diagnosis.baseline_record import LINK_KEYS
from ident.export.identified import Change, IdentifiedArm
from ident.laws.motion import Losses
from ident.model.loss import LossFigure

_HEAD = """\
# Units stand in the names; `low` and `high` bound the 95 % interval. `losses` go with the effects, and
# `losses_without_effects` are what fits best where none of them is modelled. `links` are a link's ten inertial numbers
# about the frame of the joint that moves it, and `link_change` is what tuning added to the URDF's. Dry friction turns
# round over the displacement `sliding_range_rad`, as a spring in series with a slider does; where that is zero, over
# the speed `transition_rad_s`. `law` has what the law of an effect needs beside its reported parameters.

"""


def write_parameters(
    identified: IdentifiedArm, alone: Losses | None = None, estimates: Sequence[LossFigure] = ()
) -> str:
    """TOML text.

    Args:
        identified: The arm.
        alone: Losses that fit best without its effects, where they are known.
        estimates: Estimates of losses with their intervals, where they are known.
    """
    joints = identified.nominal.joint_names
    numbers = identified.whole.inertial_parameters.reshape(-1, 10)
    record: dict[str, Any] = {
        "robot": identified.nominal.name,
        "joints": list(joints),
        "link_order": "m mx my mz Ixx Ixy Iyy Ixz Iyz Izz, about the joint frame, SI",
        "losses": _losses(joints, identified.losses),
        **({} if alone is None else {"losses_without_effects": _losses(joints, alone)}),
        "links": {name: row.tolist() for name, row in zip(identified.nominal.links, numbers, strict=True)},
        "link_change": {
            name: dict(zip(LINK_KEYS, map(float, identified.links.tuned[j]), strict=True))
            for j, name in enumerate(joints)
        },
        "effect": [_effect(change) for change in identified.changes],
    }
    for one in estimates:
        told = {"value": one.value, "low": one.low, "high": one.high, "unit": one.unit}
        record.setdefault("estimates", {}).setdefault(one.joint, {})[one.name] = told
    return _HEAD + tomli_w.dumps(record)


def _effect(change: Change) -> dict[str, Any]:
    """An effect with its parameters, and the rest of its law."""
    reported = {name: figure.to_dict() for name, figure in change.figures.items()}
    rest = {name: float(value) for name, value in change.values.items() if name not in change.figures}
    law = {"law": rest} if change.law is not None and rest else {}
    return {"id": change.effect, "joints": list(change.joints), **reported, **law}


def _losses(joints: Sequence[str], losses: Losses) -> dict[str, dict[str, float]]:
    return {
        name: {
            "motor_inertia_kgm2": float(losses.motor_inertia[j]),
            "viscous_Nms_rad": float(losses.viscous[j]),
            "coulomb_Nm": float(losses.coulomb[j]),
            "transition_rad_s": float(losses.transition[j]),
            "sliding_range_rad": float(losses.range[j]),
        }
        for j, name in enumerate(joints)
    }
