"""Files of a servo that rolls out: MuJoCo's position actuator, BAM's model m4, mjlab's actuator.

    MuJoCo, mjlab: torque = clip(kp (u - q), limit) - (viscous + back-EMF) v - dry friction

MuJoCo and mjlab hold no dead band, no friction that grows with the load and none that is larger
before motion sets in; a servo that is let go is braked there as by its own back-EMF. BAM's m4 holds
these, but no delay and no dead band, and its stiffness is the controller's gain times what its
table says of the motor. What a file leaves out stands in it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

from ident.files import atomic_folder
from ident.records import as_json
from ident.servos.roll_out import STEP_S, ServoModel

if TYPE_CHECKING:
    from ident.servos.rolled_out import RolledOut

SCHEMA = "ident.servo_model/1"
KIND = "servo"
# Supply for which a file that asks for a motor's own numbers is written [V].
VOLTS = 7.4


def write_servos(folder: Path, servos: Sequence[RolledOut], sessions: Sequence[str]) -> Path:
    """Writes servo.json, servo.xml (MuJoCo), bam_JOINT.json and mjlab.py, whole or not at all.

    Args:
        folder: Where to.
        servos: The joints.
        sessions: Names of the sessions, each with its own stiffness; simulators get the last one's.
    """
    joints = {servo.joint: servo.to_dict() for servo in servos}
    record = {"schema": SCHEMA, "sessions": list(sessions), "joints": joints}
    models = {servo.joint: servo.model for servo in servos}
    with atomic_folder(folder, KIND) as scratch:
        (scratch / "servo.json").write_text(as_json(record), encoding="utf-8")
        (scratch / "servo.xml").write_text(as_mujoco(models), encoding="utf-8")
        (scratch / "mjlab.py").write_text(as_mjlab(models), encoding="utf-8")
        for joint, model in models.items():
            text = as_json(as_bam(joint, model))
            (scratch / f"bam_{joint}.json").write_text(text, encoding="utf-8")
    return folder


def as_mujoco(models: Mapping[str, ServoModel]) -> str:
    """Classes of joints and of their position actuators, as an MJCF to be included.

    A joint takes `class="servo_JOINT"`; the actuators stand in the file.
    """
    lines = [
        "<mujoco>",
        "  <!-- Include this file, and give each joint its class. What MJCF has no word for: -->",
    ]
    for joint, model in models.items():
        lines.append(f"  <!-- {_comment(joint)}: {left_out(model)} -->")
    lines.append("  <default>")
    for joint, model in models.items():
        shared = model.shared
        name = quoteattr(f"servo_{joint}")
        damping = shared["viscous_Nms_rad"] + shared["back_emf_Nms_rad"]
        lines += [
            f"    <default class={name}>",
            f'      <joint armature="{shared["inertia_kgm2"]:.9g}" damping="{damping:.9g}" '
            f'frictionloss="{shared["friction_Nm"]:.9g}"/>',
            f'      <position kp="{model.stiffness[-1]:.9g}" kv="0" forcelimited="true" '
            f'forcerange="{-shared["limit_Nm"]:.9g} {shared["limit_Nm"]:.9g}"{_delay(shared)}/>',
            "    </default>",
        ]
    lines += ["  </default>", "  <actuator>"]
    for joint in models:
        name = quoteattr(joint)
        servo = quoteattr(f"servo_{joint}")
        lines.append(f"    <position name={name} joint={name} class={servo}/>")
    return "\n".join([*lines, "  </actuator>", "</mujoco>", ""])


def _comment(text: str) -> str:
    """A text that ends no comment of XML."""
    return re.sub("-(?=-)", "- ", text)


def _delay(shared: Mapping[str, float]) -> str:
    """MuJoCo's attributes of a late command; its memory suffices for steps of a millisecond."""
    delay = shared["delay_s"]
    samples = ceil(delay / STEP_S) + 2
    return f' delay="{delay:.9g}" nsample="{samples}"' if delay > 0.0 else ""


def left_out(model: ServoModel) -> str:
    """What MuJoCo's and mjlab's actuators do not hold."""
    shared = model.shared
    return (
        f"half the dead band {shared['dead_band_rad']:.6g} rad; zero off by {model.offset:.6g} rad "
        "(add it to goals); friction that grows by "
        f"{shared['load_friction']:.6g} of what the gears pass, "
        f"and by {shared['static_share']:.6g} of itself below {shared['stribeck_rad_s']:.6g} rad/s"
    )


def as_mjlab(models: Mapping[str, ServoModel]) -> str:
    """Keywords of mjlab's `BuiltinPositionActuatorCfg`, by joint, and the command's delay."""
    lines = [
        '"""BuiltinPositionActuatorCfg(**ACTUATORS[joint], **lags(joint, timestep)) of mjlab."""',
        "",
        "# Not held by it:",
        *(f"# {joint!a}: {left_out(model)}" for joint, model in models.items()),
        "ACTUATORS = {",
    ]
    for joint, model in models.items():
        shared = model.shared
        pattern = re.escape(joint)
        damping = shared["viscous_Nms_rad"] + shared["back_emf_Nms_rad"]
        lines.append(
            f"    {joint!a}: dict(target_names_expr=({pattern!a},), "
            f"stiffness={model.stiffness[-1]:.9g}, damping=0.0, "
            f"effort_limit={shared['limit_Nm']:.9g}, armature={shared['inertia_kgm2']:.9g}, "
            f"frictionloss={shared['friction_Nm']:.9g}, viscous_damping={damping:.9g}),"
        )
    delays = {joint: model.shared["delay_s"] for joint, model in models.items()}
    return "\n".join(
        [
            *lines,
            "}",
            f"DELAY_S = {delays!a}",
            "",
            "",
            "def lags(joint, timestep):",
            '    """Delay of a joint\'s command in whole steps."""',
            "    steps = round(DELAY_S[joint] / timestep)",
            "    return dict(delay_min_lag=steps, delay_max_lag=steps)",
            "",
        ]
    )


def as_bam(joint: str, model: ServoModel) -> dict[str, Any]:
    """The file of BAM's model m4, for a supply of `VOLTS`.

    kt² / R is the back-EMF, kt V / R the limit. Its friction grows with the motor's and the load's
    torque together; where a load is held each of them is what the gears pass, so that it gets half
    our share. BAM looks `actuator` up in its own table of motors, which has supply and gain: the
    motor's name there is to take the joint's place, and its supply times its largest duty that of
    `volts`, kt and R with it.
    """
    shared = model.shared
    constant = shared["back_emf_Nms_rad"] * VOLTS / shared["limit_Nm"]
    by_load = 0.5 * shared["load_friction"]
    return {
        "model": "m4",
        "actuator": joint,
        "volts": VOLTS,
        "kt": constant,
        "R": constant * VOLTS / shared["limit_Nm"],
        "armature": shared["inertia_kgm2"],
        "q_offset": model.offset,
        "friction_base": shared["friction_Nm"],
        "friction_stribeck": shared["static_share"] * shared["friction_Nm"],
        "load_friction_base": by_load,
        "load_friction_stribeck": shared["static_share"] * by_load,
        "dtheta_stribeck": shared["stribeck_rad_s"],
        "alpha": 2.0,
        "friction_viscous": shared["viscous_Nms_rad"],
        "left_out": {
            "stiffness_Nm_rad": model.stiffness[-1],
            "delay_s": shared["delay_s"],
            "half_dead_band_rad": shared["dead_band_rad"],
        },
    }
