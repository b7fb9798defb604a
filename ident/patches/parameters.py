"""The parameter file: every figure of the patch with its unit in its name, and its interval."""

from __future__ import annotations

from typing import Any

import tomli_w

from ident.diagnosis.baseline_record import LINK_KEYS
from ident.patches.bodies import Links
from ident.patches.change import Change, Diagnosed
from ident.patches.standalone.motion import Losses
from ident.robot.arm import ArmModel


def write_parameters(diagnosed: Diagnosed, arm: ArmModel, links: Links) -> str:
    """TOML text: the tuned losses, the change of each link's inertia, the named effects with 95 % intervals."""
    record: dict[str, Any] = {
        "robot": arm.name,
        "joints": list(arm.joint_names),
        "losses": _losses(arm, diagnosed.tuned.losses),
        "losses_without_effects": _losses(arm, diagnosed.alone.losses),
        "link_change": {
            name: dict(zip(LINK_KEYS, map(float, links.tuned[j]), strict=True))
            for j, name in enumerate(arm.joint_names)
        },
        "effect": [
            {
                "id": change.effect,
                "joints": list(change.joints),
                **{name: figure.to_dict() for name, figure in change.figures.items()},
                **({} if change.law is None else {"law": _plain(change)}),
            }
            for change in diagnosed.changes
        ],
    }
    return _HEAD + tomli_w.dumps(record)


def _plain(change: Change) -> dict[str, float]:
    """Figures of a law beside the reported ones."""
    return {name: value for name, value in change.values.items() if name not in change.figures}


_HEAD = """\
# Units stand in the names; `low` and `high` bound the 95 % interval. `losses` go with the effects, and
# `losses_without_effects` are what fits best where none of them is modelled. `link_change` is what tuning adds to the
# inertial numbers of the link that a joint moves, about the joint's frame. Dry friction turns round over the
# displacement `sliding_range_rad`, as a spring in series with a slider does; where that is zero, over the speed
# `transition_rad_s`. `law` has what the law of an effect needs beside its reported figures.

"""


def _losses(arm: ArmModel, losses: Losses) -> dict[str, dict[str, float]]:
    return {
        name: {
            "motor_inertia_kgm2": float(losses.motor_inertia[j]),
            "viscous_Nms_rad": float(losses.viscous[j]),
            "coulomb_Nm": float(losses.coulomb[j]),
            "transition_rad_s": float(losses.transition[j]),
            "sliding_range_rad": float(losses.range[j]),
        }
        for j, name in enumerate(arm.joint_names)
    }
