"""Friction of an identified arm for controllers: tanh and sigmoid tables, and a UR's shares.

    f(v) = coulomb tanh(v / width) + viscous v          (feed-forward)
    f(v) = fp1 / (1 + exp(-fp2 (v + fp3))) - fp1 / (1 + exp(-fp2 fp3))     (crisp_controllers)

The sigmoid with fp1 = 2 coulomb, fp2 = 2 / width, fp3 = 0 is the tanh; it has no place for viscous
friction. A UR controller compensates by a friction model of its own, which it does not tell, and
takes shares of it from 0 to 1. Newton metres become shares where the URDF's `<dynamics>` state it.

Source: Gaz et al. 2019 (sigmoid); crisp_controllers, `friction.fp1` to `fp3` of its Cartesian
controller; ur_msgs 2.5, FrictionModelParameters and SetFrictionModelParameters.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.command_options import FULL_ARM
from ident.errors import InputError
from ident.export.bodies import random_states
from ident.export.identified import IdentifiedArm

FEED_FORWARD = "feed_forward.yaml"
UR = "ur_friction.yaml"
HEAD = """\
# Friction torque to be added to the rigid body's, joint by joint:
#   coulomb_Nm * tanh(v / width_rad_s) + viscous_Nms_rad * v
# `crisp_controllers` has the dry part as the parameters of its Cartesian controller (use_friction:
# true); its sigmoid has no place for viscous friction. Sliding joints: N, m/s and N s/m.
"""
UR_HEAD = """\
# Shares of the friction that the URDF's <dynamics> state, which has to be the controller's own.
# ros2 service call SERVICE ur_msgs/srv/SetFrictionModelParameters "$(cat this_file)"
# with the driver's service of that type for SERVICE; 1 is full compensation. Never loaded back.
"""


def write_feed_forward(identified: IdentifiedArm) -> str:
    """The YAML of feed-forward friction."""
    names = identified.nominal.joint_names
    losses = identified.losses
    lines = ["joints:"]
    for j, name in enumerate(names):
        # A JSON string is a YAML string, whatever a joint is called.
        lines += [
            f"  {json.dumps(name, ensure_ascii=False)}:",
            f"    coulomb_Nm: {_number(losses.coulomb[j])}",
            f"    width_rad_s: {_number(losses.transition[j])}",
            f"    viscous_Nms_rad: {_number(losses.viscous[j])}",
        ]
    lines += [
        "crisp_controllers:",
        f"  joints: {json.dumps(names, ensure_ascii=False)}",
        "  use_friction: true",
        "  friction:",
        f"    fp1: {_numbers(2.0 * losses.coulomb)}",
        f"    fp2: {_numbers(2.0 / losses.transition)}",
        f"    fp3: {_numbers(np.zeros(len(names)))}",
    ]
    return HEAD + "\n".join([*lines, ""])


def check_feed_forward(path: Path, identified: IdentifiedArm) -> dict[str, object]:
    """How near a file, read by PyYAML, is to the losses; the sigmoid to their dry part [N m].

    Returns:
        "loads" (true), "torque_difference_Nm", and "crisp_difference_Nm" of the sigmoid.
    """
    import yaml

    record = yaml.safe_load(path.read_text(encoding="utf-8"))
    _, v, _ = random_states(identified.nominal, np.random.default_rng(0))
    losses = identified.losses
    dry = losses.coulomb * np.tanh(v / losses.transition)
    said = np.zeros_like(v)
    for j, name in enumerate(identified.nominal.joint_names):
        row = record["joints"][name]
        direction = np.tanh(v[:, j] / row["width_rad_s"])
        said[:, j] = row["coulomb_Nm"] * direction
        said[:, j] += row["viscous_Nms_rad"] * v[:, j]
    friction = record["crisp_controllers"]["friction"]
    fp1, fp2, fp3 = (np.array(friction[f"fp{k}"]) for k in (1, 2, 3))
    sigmoid = fp1 * (_logistic(fp2 * (v + fp3)) - _logistic(fp2 * fp3))
    off = np.abs(said - dry - losses.viscous * v)
    return {
        "loads": True,
        "torque_difference_Nm": float(off.max()),
        "crisp_difference_Nm": float(np.abs(sigmoid - dry).max()),
    }


def _logistic(x: Float[Array, "*n"]) -> Float[Array, "*n"]:
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x))


def write_ur(identified: IdentifiedArm) -> str:
    """The request of the driver's service.

    Raises:
        InputError: No arm of six joints, or a share that cannot be told or is none.
    """
    arm = identified.nominal
    where = "--format ur"
    if arm.n != FULL_ARM:
        what = f"{arm.name} has {arm.n} recorded joints, a UR six"
        raise InputError(where, what, "export another --format")
    shares = []
    parts = {
        "damping": (identified.losses.viscous, np.array(arm.model.damping)),
        "friction": (identified.losses.coulomb, np.array(arm.model.friction)),
    }
    for kind, (written, stated) in parts.items():
        named = dict(zip(arm.joint_names, zip(written, stated, strict=True), strict=True))
        unknown = [name for name, (_, value) in named.items() if value <= 0.0]
        if unknown:
            what = f"the URDF's <dynamics> state no {kind} of {', '.join(unknown)}"
            remedy = "put the friction there that the controller compensates in full, and fit again"
            raise InputError(where, what, remedy)
        beyond = [f"{name} {f / value:.2f}" for name, (f, value) in named.items() if f > value]
        if beyond:
            what = f"more {kind} than the controller's whole model: {', '.join(beyond)} of it"
            remedy = "no share beyond 1 is taken: look whether <dynamics> is the controller's model"
            raise InputError(where, what, remedy)
        shares.append(written / stated)
    lines = [
        "parameters:",
        f"  viscous_scale: {_numbers(shares[0])}",
        f"  coulomb_scale: {_numbers(shares[1])}",
    ]
    return UR_HEAD + "\n".join([*lines, ""])


def _number(value: float) -> str:
    """YAML 1.1 takes a number for a text if its mantissa has no point."""
    text = repr(float(value))
    return text if "e" not in text or "." in text else text.replace("e", ".0e")


def _numbers(values: Float[Array, " n"] | Sequence[float]) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"
