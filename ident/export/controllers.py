"""What trainers and controllers take of an identified arm, and the parameter file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ident.arrays import Array, Float
from ident.diagnosis.baseline_record import LINK_KEYS, LOSS_KEYS
from ident.export.identified import IdentifiedArm
from ident.export.python import describe_arm
from ident.export.templates import fill
from ident.files import atomic_folder
from ident.laws.motion import Losses
from ident.model.loss import LossFigure
from ident.robot.arm import ArmModel

_HEAD = """\
# Units stand in the names; `low` and `high` bound the 95 % interval. `losses` go with the effects, and
# `losses_without_effects` are what fits best where none of them is modelled. `links` are a link's ten inertial numbers
# about the frame of the joint that moves it, and `link_change` is what tuning added to the URDF's. Dry friction turns
# round over the displacement `sliding_range_rad`, as a spring in series with a slider does; where that is zero, over
# the speed `transition_rad_s`. `law` has what the law of an effect needs beside its reported parameters. Where
# robot.urdf has other losses, as the best of its candidates, `losses_of_urdf` has its rotor inertia and widths too.

"""


def write_parameters(
    identified: IdentifiedArm,
    alone: Losses | None = None,
    estimates: Sequence[LossFigure] = (),
    urdf: Losses | None = None,
) -> str:
    """TOML text; also of losses that fit best without the arm's effects, or go with the URDF, and of estimates."""
    joints = identified.nominal.joint_names
    numbers = identified.whole.inertial_parameters.reshape(-1, 10)
    record: dict[str, Any] = {
        "robot": identified.nominal.name,
        "joints": list(joints),
        "link_order": "m mx my mz Ixx Ixy Iyy Ixz Iyz Izz, about the joint frame, SI",
        "losses": _losses(joints, identified.losses),
        **({} if alone is None else {"losses_without_effects": _losses(joints, alone)}),
        **({} if urdf is None else {"losses_of_urdf": _losses(joints, urdf)}),
        "links": {name: row.tolist() for name, row in zip(identified.nominal.links, numbers, strict=True)},
        "link_change": {
            name: dict(zip(LINK_KEYS, map(float, identified.links.tuned[j]), strict=True))
            for j, name in enumerate(joints)
        },
        "effect": [],
    }
    for change in identified.changes:  # with its parameters, and the rest of its law
        reported = {name: figure.to_dict() for name, figure in change.figures.items()}
        rest = {name: float(value) for name, value in change.values.items() if name not in change.figures}
        law = {"law": rest} if change.law is not None and rest else {}
        record["effect"].append({"id": change.effect, "joints": list(change.joints), **reported, **law})
    for one in estimates:
        told = {"value": one.value, "low": one.low, "high": one.high, "unit": one.unit}
        record.setdefault("estimates", {}).setdefault(one.joint, {})[one.name] = told
    return _HEAD + tomli_w.dumps(record)


def _losses(joints: Sequence[str], losses: Losses) -> dict[str, dict[str, float]]:
    keys = (*LOSS_KEYS, "transition_rad_s", "sliding_range_rad")
    columns = losses.motor_inertia, losses.viscous, losses.coulomb, losses.transition, losses.range
    return {name: dict(zip(keys, map(float, row), strict=True)) for name, *row in zip(joints, *columns, strict=True)}


# What trainers and controllers take of an identified arm, effects aside: Isaac Lab, ros2_control, C++, and ranges.
# Source: Isaac Lab, isaaclab.actuators (ActuatorBaseCfg, ImplicitActuatorCfg, DelayedPDActuatorCfg) and, of 2.3,
# isaaclab.assets.Articulation (`write_joint_friction_coefficient_to_sim`); MuJoCo Playground's `randomization_fn`;
# ros2_control, joint_limits, `declare_parameters` and `get_joint_limits`; Featherstone, Rigid Body Dynamics
# Algorithms (2008), section 5.3.


# Poses over which the least acceleration is sought, at which a joint alone starts from rest.
POSES = 400
# A joint with less or more than this has no limit in its URDF [rad], [rad/s], [N m].
UNLIMITED = 1e6
RANGES_KIND = "ranges"
# What a trainer draws, and the range of `ident ranges` that it is drawn from.
DRAWN = {"armature": "rotor", "friction": "coulomb", "damping": "viscous"}
RANGES_FILES = ("isaaclab_ranges.py", "playground_ranges.py")


def write_isaac(identified: IdentifiedArm) -> str:
    """Keyword arguments of Isaac Lab's actuators, as a module that does not need it; no recording shows a delay."""
    arm, losses = identified.whole, identified.losses
    names = arm.joint_names
    keys = ("armature", "friction", "dynamic_friction", "viscous_friction")
    values = (losses.motor_inertia, losses.coulomb, losses.coulomb, losses.viscous)
    actuator = dict(zip(keys, values, strict=True))
    known = {"effort_limit": np.array(arm.effort_limit), "velocity_limit": np.array(arm.velocity_limit)}
    # A limit that a URDF does not state is zero or beyond all measure there.
    limits = {key: values for key, values in known.items() if ((values > 0.0) & (values < 1e6)).all()}
    renamed = {f"actuator_{key}": values for key, values in limits.items()}
    marks = {
        "ROBOT": ascii(arm.name),
        "JOINTS": ascii(list(names)),
        "ACTUATOR": _tables(names, actuator),
        "LIMITS": _tables(names, limits),
        "LIMITS_3": _tables(names, renamed),
    }
    return fill("isaaclab.py.txt", marks)


def _tables(names: tuple[str, ...], figures: Mapping[str, Float[Array, " n"]]) -> str:
    lines = []
    for key, values in figures.items():
        table = ", ".join(f"{name!a}: {float(value)!r}" for name, value in zip(names, values, strict=True))
        lines.append(f'    "{key}": {{{table}}},\n')
    return "".join(lines)


def write_limits(identified: IdentifiedArm) -> str:
    """Limits as ros2_control reads them: YAML parameters for any node, `joint_limits` with one table a joint."""
    arm, losses = identified.whole, identified.losses
    acceleration = allowed_acceleration(arm, losses)
    lines = [
        "# Positions, speeds and efforts are the URDF's. The acceleration is what the identified arm's effort limit",
        "# leaves at its worst pose for this joint alone, from rest, after gravity and dry friction.",
        "# Start a node with --params-file; MoveIt and URDF macros take what lies below ros__parameters.",
        "/**:",
        "  ros__parameters:",
        "    joint_limits:",
    ]
    for j, name in enumerate(arm.joint_names):
        low, high = float(arm.lower[j]), float(arm.upper[j])
        figures: list[tuple[str, tuple[str, ...], tuple[float, ...]]] = [
            ("position", ("min_position", "max_position"), (low, high)),
            ("velocity", ("max_velocity",), (float(arm.velocity_limit[j]),)),
            ("acceleration", ("max_acceleration",), (float(acceleration[j]),)),
            ("effort", ("max_effort",), (float(arm.effort_limit[j]),)),
        ]
        # A JSON string is a YAML string, whatever a joint is called.
        lines.append(f"      {json.dumps(name)}:")
        for what, keys, values in figures:
            stated = all(abs(value) < UNLIMITED for value in values) and (what == "position" or values[0] > 0.0)
            lines.append(f"        has_{what}_limits: {str(stated).lower()}")
            lines += [f"        {key}: {value!r}" for key, value in zip(keys, values, strict=True) if stated]
    return "\n".join(lines) + "\n"


def allowed_acceleration(arm: ArmModel, losses: Losses) -> Float[Array, " n"]:
    """Acceleration that every pose allows a joint that starts alone [rad/s²]; infinite without an effort limit."""
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (POSES, arm.n))
    gravity, rest = arm.gravity(q), np.zeros_like(q)
    found = np.empty(arm.n)
    for j in range(arm.n):
        unit = np.zeros_like(q)
        unit[:, j] = 1.0
        inertia = (arm.inverse_dynamics(q, rest, unit) - gravity)[:, j] + losses.motor_inertia[j]
        left = float(arm.effort_limit[j]) - np.abs(gravity[:, j]) - losses.coulomb[j]
        found[j] = np.min(np.maximum(left, 0.0) / inertia) if 0.0 < arm.effort_limit[j] < UNLIMITED else np.inf
    return found


def write_cpp(identified: IdentifiedArm) -> str:
    """A C++ header with the feed-forward torque: no library, no memory from the heap, one call a cycle.

    Newton and Euler's recursion in the joints' own frames, as in `ident.laws.motion`.
    """
    arm, losses = identified.whole, identified.losses
    chain, space = describe_arm(arm), "arm_" + re.sub(r"\W", "_", arm.name, flags=re.ASCII)
    rows = []
    for j in range(arm.n):
        mass, first, six = chain.links[j][0], chain.links[j][1:4], chain.links[j][4:]
        inertia = six[[0, 1, 3, 1, 2, 4, 3, 4, 5]]
        parts = [
            f"{{{{{_row(chain.rotations[j].ravel())}}}}}",
            *(f"{{{_row(vector)}}}" for vector in (chain.offsets[j], chain.axes[j])),
            "true" if chain.sliding[j] else "false",
            _row([mass]),
            f"{{{_row(first)}}}",
            f"{{{{{_row(inertia)}}}}}",
            _row([losses.motor_inertia[j], losses.viscous[j], losses.coulomb[j], losses.transition[j]]),
        ]
        rows.append("      {" + ", ".join(parts) + "},")
    named = re.sub(r"[^\w .-]", "?", arm.name, flags=re.ASCII)
    marks = {"NAME": named, "SPACE": space, "N": str(arm.n), "LINKS": "\n".join(rows), "UP": _row(-chain.gravity)}
    # String literals of any names: what is not plain becomes octal bytes.
    plain = re.compile(rb"[A-Za-z0-9_\-./ ]")
    kept = (
        "".join(chr(byte) if plain.match(bytes([byte])) else f"\\{byte:03o}" for byte in name.encode())
        for name in arm.joint_names
    )
    return fill("torque_model.hpp", {**marks, "JOINTS": ", ".join(f'"{name}"' for name in kept)})


def _row(values: Array | list[float]) -> str:
    return ", ".join(repr(float(value)) for value in np.asarray(values))


def write_ranges(out: Path, robot: str, ranges: Mapping[str, Mapping[str, tuple[float, float]]]) -> list[str]:
    """Writes ranges from which Isaac Lab and MuJoCo Playground draw each joint; earlier ones there are replaced.

    Args:
        out: Folder.
        robot: The arm's name.
        ranges: By joint and figure (`rotor`, `viscous`, `coulomb`) the ends of its range.

    Returns:
        Joints that are in neither file, as one of their ranges is not known.
    """
    known = [joint for joint, found in ranges.items() if set(DRAWN.values()) <= set(found)]
    tables = {name: [tuple(max(0.0, end) for end in ranges[j][key]) for j in known] for name, key in DRAWN.items()}
    # Names come from files: as literals they stay text, whatever stands in them.
    table = f"ROBOT = {robot!a}\nJOINTS = {tuple(known)!a}\nRANGES = {tables!r}\n"
    with atomic_folder(out, RANGES_KIND) as folder:
        for name in RANGES_FILES:
            (folder / name).write_text(fill(f"{name}.txt", {"TABLE": table}), encoding="utf-8")
    return [joint for joint in ranges if joint not in known]
