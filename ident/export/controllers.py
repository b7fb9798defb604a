"""What trainers and controllers take of an identified arm, and the parameter file.

Isaac Lab, ros2_control, C++, ranges for domain randomisation; a Python module with the torque of
named effects, which needs NumPy alone: its first part is the text of `ident.laws` and of the
friction laws that models carry, its second the numbers of arm and effects, its third what a user
calls.

Source: Isaac Lab, isaaclab.actuators (ActuatorBaseCfg, ImplicitActuatorCfg, DelayedPDActuatorCfg)
and, of 2.3, isaaclab.assets.Articulation (`write_joint_friction_coefficient_to_sim`); MuJoCo
Playground's `randomization_fn`; ros2_control, joint_limits, `declare_parameters` and
`get_joint_limits`; Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import tomli_w

from ident import laws
from ident.arrays import Array, Float
from ident.diagnosis.baseline_record import LINK_KEYS, LOSS_KEYS
from ident.effects import base
from ident.errors import InputError
from ident.export.identified import Change, IdentifiedArm, in_module
from ident.export.templates import fill
from ident.files import atomic_folder
from ident.laws.acting import KNOWN
from ident.laws.carried import COLUMNS
from ident.laws.motion import Arm, Losses
from ident.model.carried import describe_arm
from ident.model.loss import LossFigure
from ident.records import JsonRecord, JsonTable
from ident.robot.arm import ArmModel

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
# Columns of losses in the parameter file, in the order of `_losses`.
OF_LOSSES = (*LOSS_KEYS, "transition_rad_s", "sliding_range_rad")
# Bytes of a name that a C++ string literal holds as they are.
PLAIN_BYTE = re.compile(rb"[A-Za-z0-9_\-./ ]")
LIMITS_HEAD = (
    "# Positions, speeds and efforts are the URDF's. The acceleration is what the identified arm's "
    "effort limit",
    "# leaves at its worst pose for this joint alone, from rest, after gravity and dry friction.",
    "# Start a node with --params-file; MoveIt and URDF macros take what lies below "
    "ros__parameters.",
    "/**:",
    "  ros__parameters:",
    "    joint_limits:",
)
STATIC_METHOD = "write it as a static method (m, j, p)"

Ranges = Mapping[str, Mapping[str, tuple[float, float]]]
"""By joint and parameter, the ends of its range."""

InFile = tuple[list[int], Losses, Array | None]
"""What a file beside the module holds, of which the module says what is missing: indices of the
effects that it has, its losses, and its links, ten numbers each, where they are others than the
module's own, else None."""


def write_parameters(
    identified: IdentifiedArm,
    alone: Losses | None = None,
    estimates: Sequence[LossFigure] = (),
    urdf: Losses | None = None,
    figures: JsonTable | None = None,
) -> str:
    """TOML text of what was identified.

    Args:
        identified: The arm.
        alone: Losses that fit best without the arm's effects.
        urdf: Losses that go with the URDF, where these are others.
        estimates: Loss parameters with their intervals.
        figures: The URDF's numbers beside those that were found (`identified` of a diagnosis).
    """
    joints = identified.nominal.joint_names
    numbers = identified.whole.inertial_parameters.reshape(-1, 10)
    record: JsonRecord = {
        "robot": identified.nominal.name,
        "joints": list(joints),
        "link_order": "m mx my mz Ixx Ixy Iyy Ixz Iyz Izz, about the joint frame, SI",
        "losses": _losses(joints, identified.losses),
    }
    if alone is not None:
        record["losses_without_effects"] = _losses(joints, alone)
    if urdf is not None:
        record["losses_of_urdf"] = _losses(joints, urdf)
    links = zip(identified.nominal.links, numbers, strict=True)
    record["links"] = {name: row.tolist() for name, row in links}
    tuned = identified.links.tuned
    record["link_change"] = {name: _by_key(LINK_KEYS, tuned[j]) for j, name in enumerate(joints)}
    record["effect"] = [_effect_record(change) for change in identified.changes]
    for figure in estimates:
        of_joint = record.setdefault("estimates", {}).setdefault(figure.joint, {})
        of_joint[figure.name] = {
            "value": figure.value,
            "low": figure.low,
            "high": figure.high,
            "unit": figure.unit,
        }
    if figures:
        record["identified"] = _without_nothing(figures)
    return fill("parameters_head.toml.txt", {}) + tomli_w.dumps(record)


def _effect_record(change: Change) -> JsonRecord:
    """An effect with its parameters, and the rest of its law."""
    record: JsonRecord = {"id": change.effect, "joints": list(change.joints)}
    for name, interval in change.parameters.items():
        record[name] = interval.to_dict()
    rest = {}
    for name, value in change.values.items():
        if name not in change.parameters:
            rest[name] = float(value)
    if change.law is not None and rest:
        record["law"] = rest
    return record


def _by_key(keys: Sequence[str], values: Iterable[float]) -> dict[str, float]:
    """Numbers by their keys."""
    return dict(zip(keys, map(float, values), strict=True))


def _without_nothing(record: JsonTable) -> JsonRecord:
    """A record without its nulls, for which TOML has no word."""
    stated = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            stated[key] = _without_nothing(value)
        elif value is not None:
            stated[key] = value
    return stated


def _losses(joints: Sequence[str], losses: Losses) -> dict[str, dict[str, float]]:
    """Losses of each joint by their keys."""
    columns = (
        losses.motor_inertia,
        losses.viscous,
        losses.coulomb,
        losses.transition,
        losses.range,
    )
    rows = np.stack(columns, axis=1)
    return {name: _by_key(OF_LOSSES, row) for name, row in zip(joints, rows, strict=True)}


def write_isaac(identified: IdentifiedArm) -> str:
    """Keyword arguments of Isaac Lab's actuators, as a module that does not need it; no recording
    shows a delay.
    """
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
    """Entries of a Python table: by key, a number for each joint's name."""
    lines = []
    for key, values in columns.items():
        pairs = zip(names, map(float, values), strict=True)
        row = ", ".join(f"{name!a}: {value!r}" for name, value in pairs)
        lines.append(f'    "{key}": {{{row}}},\n')
    return "".join(lines)


def write_limits(identified: IdentifiedArm) -> str:
    """Limits as ros2_control reads them: YAML parameters for any node, `joint_limits` with one
    table a joint.
    """
    arm = identified.whole
    losses = identified.losses
    acceleration = allowed_acceleration(arm, losses)
    known = arm.known_limits
    lines = [*LIMITS_HEAD]
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
            if stated:
                pairs = zip(keys, values, strict=True)
                lines += [f"        {key}: {value!r}" for key, value in pairs]
    return "\n".join(lines) + "\n"


def allowed_acceleration(arm: ArmModel, losses: Losses) -> Float[Array, " n"]:
    """Acceleration that every pose allows a joint that starts alone [rad/s²]; infinite without an
    effort limit.
    """
    rng = np.random.default_rng(0)
    limits = arm.known_limits
    lower = np.maximum(limits.lower, -np.pi)
    upper = np.minimum(limits.upper, np.pi)
    q = rng.uniform(lower, upper, (POSES, arm.n))
    gravity = np.abs(arm.gravity(q))
    left = np.maximum(limits.effort - gravity - losses.coulomb, 0.0)
    # Of the bodies about each joint's axis, the others held [kg m²].
    inertia = np.diagonal(arm.derivatives(q, 0.0 * q, 0.0 * q)[2], axis1=1, axis2=2)
    most = np.min(left / (inertia + losses.motor_inertia), axis=0)
    return np.asarray(most)


def write_cpp(identified: IdentifiedArm) -> str:
    """A C++ header with the feed-forward torque: no library, no memory from the heap, one call a
    cycle.

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
        of_joint = (losses.motor_inertia, losses.viscous, losses.coulomb, losses.transition)
        fields = [
            f"{{{{{_row(chain.rotations[j].ravel())}}}}}",
            f"{{{_row(chain.offsets[j])}}}",
            f"{{{_row(chain.axes[j])}}}",
            "true" if chain.sliding[j] else "false",
            _row([mass]),
            f"{{{_row(first)}}}",
            f"{{{{{_row(inertia)}}}}}",
            _row([values[j] for values in of_joint]),
        ]
        rows.append("      {" + ", ".join(fields) + "},")
    marks = {
        "NAME": re.sub(r"[^\w .-]", "?", arm.name, flags=re.ASCII),
        "SPACE": space,
        "N": str(arm.n),
        "LINKS": "\n".join(rows),
        "UP": _row(-chain.gravity),
        "JOINTS": ", ".join(map(_string_literal, arm.joint_names)),
    }
    return fill("torque_model.hpp", marks)


def _string_literal(name: str) -> str:
    """A name as a C++ string, whatever it holds: what is not plain becomes octal bytes."""
    characters = []
    for byte in name.encode():
        is_plain = PLAIN_BYTE.match(bytes([byte])) is not None
        characters.append(chr(byte) if is_plain else f"\\{byte:03o}")
    return f'"{"".join(characters)}"'


def _row(values: Array | list[float]) -> str:
    """Numbers with commas, to the last digit."""
    return ", ".join(repr(float(value)) for value in np.asarray(values))


def write_ranges(out: Path, robot: str, ranges: Ranges) -> list[str]:
    """Writes ranges from which Isaac Lab and MuJoCo Playground draw each joint; earlier ones there
    are replaced.

    Args:
        out: The folder.
        robot: Name of the arm.
        ranges: Of each joint.

    Returns:
        Joints that are in neither file, as one of their ranges is not known.
    """
    needed = set(DRAWN.values())
    known = [joint for joint, of_joint in ranges.items() if needed <= set(of_joint)]
    tables = {}
    for name, key in DRAWN.items():
        ends = [ranges[joint][key] for joint in known]
        tables[name] = [(max(0.0, low), max(0.0, high)) for low, high in ends]
    # Names come from files: as literals they stay text, whatever stands in them.
    table = f"ROBOT = {robot!a}\nJOINTS = {tuple(known)!a}\nRANGES = {tables!r}\n"
    with atomic_folder(out, RANGES_KIND) as folder:
        for name in RANGES_FILES:
            (folder / name).write_text(fill(f"{name}.txt", {"TABLE": table}), encoding="utf-8")
    return [joint for joint in ranges if joint not in known]


def write_module(identified: IdentifiedArm, files: Mapping[str, InFile]) -> str:
    """The module's text: the tuned arm without the effects, its losses, and the effects whose law
    is known.
    """
    arm = identified.tuned
    losses = identified.losses
    effects = in_module(identified.changes)
    users = {}
    for change in identified.changes:
        if change.has_law and change.kind is not None and change.kind.id not in KNOWN:
            users[change.kind.id] = change.kind
    texts = [*map(_body, PARTS[:-1]), *_columns(), _body(PARTS[-1])]
    texts += map(_users_law, users.values())
    shared = {}
    held = []
    links = []
    for name, (indices, of_file, links_of_file) in files.items():
        shared[name] = indices
        held.append(f"{name!r}: {_call('Losses', of_file)}")
        links.append(f"{name!r}: {_plain(links_of_file)}")
    numbers = [
        # Names come from files: as literals they stay text, whatever stands in them.
        f"ROBOT = {arm.name!a}",
        f"JOINTS = {tuple(arm.joint_names)!a}",
        f"ARM = {_call('Arm', describe_arm(arm))}",
        f"# Tuned together with the effects.\nLOSSES = {_call('Losses', losses)}",
        "EFFECTS = [\n" + "".join(f"    {effect!a},\n" for effect in effects) + "]",
        f"# Which of them the files express.\nIN_FILE = {shared!r}",
        f"FILE_LOSSES = {{{', '.join(held)}}}",
        "# Links of the files, where they are others than those of ARM.",
        f"FILE_LINKS = {{{', '.join(links)}}}",
    ]
    marks = {"LAWS": "\n\n\n".join(texts), "NUMBERS": "\n".join(numbers)}
    return fill("torque_model.py.txt", marks)


def _columns() -> list[str]:
    """The laws that no file of `PARTS` holds, and the table of all."""
    others = [law for law in COLUMNS.values() if law.__module__.split(".")[-1] not in PARTS]
    texts = [inspect.getsource(law).strip() for law in others]
    named = ", ".join(f"{name!r}: {name}" for name in COLUMNS)
    return [*texts, f"COLUMNS = {{{named}}}"]


def _body(name: str) -> str:
    """The text of a file of `ident.laws` after its docstring and imports."""
    text = (Path(laws.__file__).parent / f"{name}.py").read_text(encoding="utf-8")
    statements = ast.parse(text).body
    assert isinstance(statements[0], ast.Expr), "a file of laws begins with its docstring"
    imports = [node for node in statements if isinstance(node, ast.Import | ast.ImportFrom)]
    last = max(node.end_lineno or 0 for node in imports)
    return "\n".join(text.splitlines()[last:]).strip("\n")


def _users_law(kind: base.Effect) -> str:
    """The text of a law that an effect's class gives, under its id.

    Raises:
        InputError: It is no function whose text can be had.
    """
    where = f"law of {type(kind).__name__}"
    try:
        assert kind.law is not None
        law = ast.parse(textwrap.dedent(inspect.getsource(kind.law))).body[0]
    except (OSError, TypeError, SyntaxError) as error:
        raise InputError(where, f"its text can't be read ({error})", STATIC_METHOD) from error
    if not isinstance(law, ast.FunctionDef):
        raise InputError(where, "it is no function", STATIC_METHOD)
    law.name = f"law_of_{kind.id}"
    law.decorator_list = []
    return f"{ast.unparse(law)}\n\n\nLAWS[{kind.id!r}] = {law.name}"


def _call(name: str, value: Arm | Losses) -> str:
    """A constructor's call with plain lists."""
    fields = [f"{key}={_plain(item)}" for key, item in vars(value).items()]
    return f"{name}(\n    " + ",\n    ".join(fields) + ",\n)"


def _plain(item: Array | None) -> str:
    return "None" if item is None else repr(np.asarray(item).tolist())
