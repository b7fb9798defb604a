"""What trainers and controllers take of an identified arm, and the parameter file."""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ident import laws
from ident.arrays import Array, Float
from ident.diagnosis.baseline_record import LINK_KEYS, LOSS_KEYS
from ident.effects import base
from ident.errors import InputError
from ident.export.identified import IdentifiedArm, in_module
from ident.export.templates import fill
from ident.files import atomic_folder
from ident.laws.acting import KNOWN
from ident.laws.carried import COLUMNS
from ident.laws.motion import Arm, Losses
from ident.model.carried import describe_arm
from ident.model.loss import LossFigure
from ident.robot.arm import ArmModel

_HEAD = """\
# Units stand in the names; `low` and `high` bound the 95 % interval. `losses` go with the effects, and
# `losses_without_effects` are what fits best where none of them is modelled. `links` are a link's ten inertial numbers
# about the frame of the joint that moves it, and `link_change` is what tuning added to the URDF's. Dry friction turns
# round over the displacement `sliding_range_rad`, as a spring in series with a slider does; where that is zero, over
# the speed `transition_rad_s`. `law` has what the law of an effect needs beside its reported parameters. Where
# robot.urdf has other losses, as the best of its candidates, `losses_of_urdf` has its rotor inertia and widths too.
# `identified` has the URDF's number (`nominal`, missing where it says nothing) beside the one that was found.

"""

# Poses over which the least acceleration is sought, at which a joint alone starts from rest.
POSES = 400
# A joint with less or more than this has no limit in its URDF [rad], [rad/s], [N m].
UNLIMITED = 1e6
RANGES_KIND = "ranges"
# What a trainer draws, and the range of `ident ranges` that it is drawn from.
DRAWN = {"armature": "rotor", "friction": "coulomb", "damping": "viscous"}
RANGES_FILES = ("isaaclab_ranges.py", "playground_ranges.py")
# Files of `ident.laws` in their order.
PARTS = ("motion", "friction_laws", "elastic", "acting")


def write_parameters(
    identified: IdentifiedArm,
    alone: Losses | None = None,
    estimates: Sequence[LossFigure] = (),
    urdf: Losses | None = None,
    figures: Mapping[str, Any] | None = None,
) -> str:
    """TOML text; also of losses that fit best without the arm's effects, or go with the URDF, and of estimates.

    `figures` are the URDF's numbers beside those that were found (`identified` of a diagnosis).
    """
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
        reported = {name: one.to_dict() for name, one in change.parameters.items()}
        rest = {name: float(value) for name, value in change.values.items() if name not in change.parameters}
        law = {"law": rest} if change.law is not None and rest else {}
        record["effect"].append({"id": change.effect, "joints": list(change.joints), **reported, **law})
    for one in estimates:
        estimate = {"value": one.value, "low": one.low, "high": one.high, "unit": one.unit}
        record.setdefault("estimates", {}).setdefault(one.joint, {})[one.name] = estimate
    if figures:
        record["identified"] = _without_nothing(figures)
    return _HEAD + tomli_w.dumps(record)


def _without_nothing(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record without its nulls, for which TOML has no word."""
    found = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            found[key] = _without_nothing(value)
        elif value is not None:
            found[key] = value
    return found


def _losses(joints: Sequence[str], losses: Losses) -> dict[str, dict[str, float]]:
    keys = (*LOSS_KEYS, "transition_rad_s", "sliding_range_rad")
    columns = losses.motor_inertia, losses.viscous, losses.coulomb, losses.transition, losses.range
    return {name: dict(zip(keys, map(float, row), strict=True)) for name, *row in zip(joints, *columns, strict=True)}


# What trainers and controllers take of an identified arm, effects aside: Isaac Lab, ros2_control, C++, and ranges.
# Source: Isaac Lab, isaaclab.actuators (ActuatorBaseCfg, ImplicitActuatorCfg, DelayedPDActuatorCfg) and, of 2.3,
# isaaclab.assets.Articulation (`write_joint_friction_coefficient_to_sim`); MuJoCo Playground's `randomization_fn`;
# ros2_control, joint_limits, `declare_parameters` and `get_joint_limits`; Featherstone, Rigid Body Dynamics
# Algorithms (2008), section 5.3.


def write_isaac(identified: IdentifiedArm) -> str:
    """Keyword arguments of Isaac Lab's actuators, as a module that does not need it; no recording shows a delay."""
    arm = identified.whole
    losses = identified.losses
    names = arm.joint_names
    keys = ("armature", "friction", "dynamic_friction", "viscous_friction")
    values = (losses.motor_inertia, losses.coulomb, losses.coulomb, losses.viscous)
    actuator = dict(zip(keys, values, strict=True))
    known = {"effort_limit": arm.known_limits.effort, "velocity_limit": arm.known_limits.speed}
    limits = {key: values for key, values in known.items() if np.isfinite(values).all()}
    renamed = {f"actuator_{key}": values for key, values in limits.items()}
    marks = {
        "ROBOT": ascii(arm.name),
        "JOINTS": ascii(list(names)),
        "ACTUATOR": _tables(names, actuator),
        "LIMITS": _tables(names, limits),
        "LIMITS_3": _tables(names, renamed),
    }
    return fill("isaaclab.py.txt", marks)


def _tables(names: tuple[str, ...], columns: Mapping[str, Float[Array, " n"]]) -> str:
    pairs = {key: zip(names, map(float, values), strict=True) for key, values in columns.items()}
    rows = {key: ", ".join(f"{name!a}: {value!r}" for name, value in own) for key, own in pairs.items()}
    return "".join(f'    "{key}": {{{row}}},\n' for key, row in rows.items())


def write_limits(identified: IdentifiedArm) -> str:
    """Limits as ros2_control reads them: YAML parameters for any node, `joint_limits` with one table a joint."""
    arm = identified.whole
    losses = identified.losses
    acceleration = allowed_acceleration(arm, losses)
    known = arm.known_limits
    lines = [
        "# Positions, speeds and efforts are the URDF's. The acceleration is what the identified arm's effort limit",
        "# leaves at its worst pose for this joint alone, from rest, after gravity and dry friction.",
        "# Start a node with --params-file; MoveIt and URDF macros take what lies below ros__parameters.",
        "/**:",
        "  ros__parameters:",
        "    joint_limits:",
    ]
    for j, name in enumerate(arm.joint_names):
        low = float(known.lower[j])
        high = float(known.upper[j])
        limits: list[tuple[str, tuple[str, ...], tuple[float, ...]]] = [
            ("position", ("min_position", "max_position"), (low, high)),
            ("velocity", ("max_velocity",), (float(known.speed[j]),)),
            ("acceleration", ("max_acceleration",), (float(acceleration[j]),)),
            ("effort", ("max_effort",), (float(known.effort[j]),)),
        ]
        # A JSON string is a YAML string, whatever a joint is called.
        lines.append(f"      {json.dumps(name)}:")
        for what, keys, values in limits:
            stated = all(abs(value) < UNLIMITED for value in values)
            lines.append(f"        has_{what}_limits: {str(stated).lower()}")
            lines += [f"        {key}: {value!r}" for key, value in zip(keys, values, strict=True) if stated]
    return "\n".join(lines) + "\n"


def allowed_acceleration(arm: ArmModel, losses: Losses) -> Float[Array, " n"]:
    """Acceleration that every pose allows a joint that starts alone [rad/s²]; infinite without an effort limit."""
    rng = np.random.default_rng(0)
    limits = arm.known_limits
    q = rng.uniform(np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi), (POSES, arm.n))
    left = np.maximum(limits.effort - np.abs(arm.gravity(q)) - losses.coulomb, 0.0)
    # Of the bodies about each joint's axis, the others held [kg m²].
    inertia = np.diagonal(arm.derivatives(q, 0.0 * q, 0.0 * q)[2], axis1=1, axis2=2)
    most = np.min(left / (inertia + losses.motor_inertia), axis=0)
    return np.asarray(most)


def write_cpp(identified: IdentifiedArm) -> str:
    """A C++ header with the feed-forward torque: no library, no memory from the heap, one call a cycle.

    Newton and Euler's recursion in the joints' own frames, as in `ident.laws.motion`.
    """
    arm = identified.whole
    losses = identified.losses
    chain = describe_arm(arm)
    space = "arm_" + re.sub(r"\W", "_", arm.name, flags=re.ASCII)
    rows = []
    for j in range(arm.n):
        mass = chain.links[j][0]
        first = chain.links[j][1:4]
        six = chain.links[j][4:]
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


# A Python module with the named effects' torque that needs NumPy only.
# Its first part is the text of `ident.laws` and of the friction laws that models carry, its second the
# numbers of arm and effects, its third what a user calls.


# What a file beside the module holds, of which the module says what is missing: indices of the effects that it has, its
# losses, and its links, ten numbers each, where they are others than the module's own, else None.
InFile = tuple[list[int], Losses, Array | None]


def write_module(identified: IdentifiedArm, files: Mapping[str, InFile]) -> str:
    """The module's text: the tuned arm without the effects, its losses, and the effects whose law is known."""
    arm = identified.tuned
    losses = identified.losses
    effects = in_module(identified.changes)
    kinds = [change.kind for change in identified.changes if change.has_law and change.kind is not None]
    own = {kind.id: kind for kind in kinds if kind.id not in KNOWN}
    named = ", ".join(f"{name!r}: {name}" for name in COLUMNS)
    more = [inspect.getsource(one).strip() for one in COLUMNS.values() if one.__module__.split(".")[-1] not in PARTS]
    columns = [*more, f"COLUMNS = {{{named}}}"]
    parts = [*map(_body, PARTS[:-1]), *columns, _body(PARTS[-1]), *map(_own_law, own.values())]
    held = ", ".join(f"{name!r}: {_call('Losses', one[1])}" for name, one in files.items())
    shared = {name: one[0] for name, one in files.items()}
    links = ", ".join(f"{name!r}: {_plain(one[2])}" for name, one in files.items())
    numbers = [
        # Names come from files: as literals they stay text, whatever stands in them.
        f"ROBOT = {arm.name!a}",
        f"JOINTS = {tuple(arm.joint_names)!a}",
        f"ARM = {_call('Arm', describe_arm(arm))}",
        f"# Tuned together with the effects.\nLOSSES = {_call('Losses', losses)}",
        "EFFECTS = [\n" + "".join(f"    {effect!a},\n" for effect in effects) + "]",
        f"# Which of them the files express.\nIN_FILE = {shared!r}",
        f"FILE_LOSSES = {{{held}}}",
        f"# Links of the files, where they are others than those of ARM.\nFILE_LINKS = {{{links}}}",
    ]
    return fill("torque_model.py.txt", {"LAWS": "\n\n\n".join(parts), "NUMBERS": "\n".join(numbers)})


def _body(part: str) -> str:
    """A file's text after its docstring and imports."""
    text = (Path(laws.__file__).parent / f"{part}.py").read_text(encoding="utf-8")
    kept = [node for node in ast.parse(text).body if not isinstance(node, (ast.Import, ast.ImportFrom))]
    last = max(node.end_lineno or 0 for node in ast.parse(text).body if isinstance(node, (ast.Import, ast.ImportFrom)))
    assert isinstance(kept[0], ast.Expr), "a part begins with its docstring"
    return "\n".join(text.splitlines()[last:]).strip("\n")


def _own_law(kind: base.Effect) -> str:
    """The text of a law that an effect's class gives, under its id.

    Raises:
        InputError: It is no function whose text can be had.
    """
    where = f"law of {type(kind).__name__}"
    try:
        assert kind.law is not None
        found = ast.parse(textwrap.dedent(inspect.getsource(kind.law))).body[0]
    except (OSError, TypeError, SyntaxError) as error:
        raise InputError(where, f"its text can't be read ({error})", "write it as a static method (m, j, p)") from error
    if not isinstance(found, ast.FunctionDef):
        raise InputError(where, "it is no function", "write it as a static method (m, j, p)")
    found.name = f"law_of_{kind.id}"
    found.decorator_list = []
    return f"{ast.unparse(found)}\n\n\nLAWS[{kind.id!r}] = {found.name}"


def _call(name: str, value: Arm | Losses) -> str:
    """A constructor's call with plain lists."""
    fields = [f"{key}={_plain(item)}" for key, item in vars(value).items()]
    return f"{name}(\n    " + ",\n    ".join(fields) + ",\n)"


def _plain(item: Array | None) -> str:
    return "None" if item is None else repr(np.asarray(item).tolist())
