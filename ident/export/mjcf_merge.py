"""What was identified, put into a user's own MJCF: joints and inertias change, all the rest stays as it is.

Files of one arm differ in names, in where the base stands and in where a body's frame lies. The joints' axes do not: as
lines in space they must be the same at every pose, up to one motion of the whole arm. That motion is found from the
lines, and what does not fit then is another arm, another zero or another sign, which is refused.

Geoms, meshes, defaults, actuators, sites, keyframes and comments are the user's. What hangs on a link in the file and
moves with it (a hand, its fingers) keeps its own inertia, and the link takes the rest of what was identified.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, first_line
from ident.export.bodies import moved, numbers
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import child, inertial_attributes, joint_elements
from ident.files import atomic_write
from ident.laws.acting import payload_parameters
from ident.laws.motion import Losses
from ident.model.inertia import is_consistent
from ident.robot.arm import ArmModel
from ident.robot.chain import compute_joint_poses
from ident.robot.names import require_bounded
from ident.safe_read import read_text, read_xml

# Poses at which the axes are compared; a handful fixes a rigid motion many times over.
POSES = 12
# Files of one arm round their lengths to a tenth of a millimetre, and their angles likewise [m], [rad].
LARGEST_MISS_M, LARGEST_MISS_RAD = 2e-3, 2e-3


@dataclass(frozen=True, eq=False)
class Match:
    """How a file and an arm belong together."""

    joints: tuple[str, ...]  # the file's name of each joint of the arm
    bodies: tuple[str, ...]  # the file's name of the body that each joint moves
    turns: Float[Array, "n 3 3"]  # placement of each link's frame in that body [m]
    shifts: Float[Array, "n 3"]
    base_turn: Float[Array, "3 3"]  # rotation of the arm's base in the file's world


def match_joints(wanted: Sequence[str], there: Sequence[str], where: Path) -> tuple[str, ...]:
    """The file's name of each joint: the same, else the only one that ends like it (`panda_joint1`, `joint1`).

    Raises:
        InputError: A joint has none, or several.
    """
    found = []
    for name in wanted:
        likely = [name] if name in there else [o for o in there if o and (name.endswith(o) or o.endswith(name))]
        if len(likely) != 1:
            what = f"it has no joint {name!r}" if not likely else f"{name!r} may be any of {', '.join(likely)}"
            raise InputError(where, what, f"rename its joints after the URDF's; it has {', '.join(there)}")
        found.append(likely[0])
    if len(set(found)) < len(found):
        raise InputError(where, "two joints of the arm would be one of its joints", "rename them after the URDF's")
    return tuple(found)


def match_file(arm: ArmModel, model: mujoco.MjModel, where: Path) -> Match:
    """Finds the arm in a compiled file; `where` is its place, for messages.

    Raises:
        InputError: A joint is missing, or the file is of another arm.
    """
    names = [model.joint(i).name for i in range(model.njnt)]
    joints = match_joints(arm.joint_names, names, where)
    ids = [names.index(name) for name in joints]
    rng = np.random.default_rng(0)
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    poses = np.concatenate([np.zeros((1, arm.n)), rng.uniform(low, high, (POSES - 1, arm.n))])
    bodies = [model.body(model.jnt_bodyid[i]).name for i in ids]
    frames = compute_joint_poses(arm.chain, poses, range(1, arm.n + 1))
    turns, places = (np.stack([frames[j + 1][k] for j in range(arm.n)], axis=1) for k in range(2))
    data, seen = mujoco.MjData(model), []
    for q in poses:
        data.qpos[model.jnt_qposadr[ids]] = q
        mujoco.mj_kinematics(model, data)
        at = model.jnt_bodyid[ids]
        seen.append((data.xaxis[ids], data.xanchor[ids], data.xmat[at].reshape(-1, 3, 3), data.xpos[at]))
    directions, points, theirs, theirs_at = (np.array(part) for part in zip(*seen, strict=True))
    ours = (turns @ arm.joint_axes[:, :, None]).reshape(places.shape)
    turn, shift = _rigid_motion(_lines(ours, places), _lines(directions, points), arm, where)
    if any(not name for name in bodies):
        raise InputError(where, "a body that a joint moves has no name", "name its bodies")
    placed = np.einsum("pjba,bc,pjcd->pjad", theirs, turn, turns)
    apart = np.einsum("pjba,pjb->pja", theirs, places @ turn.T + shift - theirs_at)
    off, askew = np.abs(apart - apart[0]).max(axis=(0, 2)), np.abs(placed - placed[0]).max(axis=(0, 2, 3))
    _refuse_worst(np.maximum(off / LARGEST_MISS_M, askew / LARGEST_MISS_RAD), arm, where)
    return Match(joints, tuple(bodies), placed[0], apart[0], turn)


def _lines(directions: Float[Array, "P n 3"], points: Float[Array, "P n 3"]) -> Float[Array, "P n 6"]:
    """Axes as lines: direction, and moment about the origin."""
    return np.concatenate([directions, np.cross(points, directions)], axis=2)


def _rigid_motion(
    ours: Float[Array, "P n 6"], theirs: Float[Array, "P n 6"], arm: ArmModel, where: Path
) -> tuple[Float[Array, "3 3"], Float[Array, " 3"]]:
    """The motion that lays our lines on theirs: rotation from the directions, then the shift from the moments.

    Source: Kabsch 1976 for the rotation; m' = R m + p × R d for the moments of a moved line.
    """
    a, b = ours.reshape(-1, 6), theirs.reshape(-1, 6)
    u, _, vt = np.linalg.svd(b[:, :3].T @ a[:, :3])
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    directions = a[:, :3] @ turn.T
    askew = np.abs(directions - b[:, :3]).max(axis=1).reshape(len(ours), -1).max(axis=0)
    _refuse_worst(askew / LARGEST_MISS_RAD, arm, where)
    # p × d = −[d]× p: three equations a line.
    crosses = np.concatenate([np.cross(np.eye(3), d).T for d in directions])
    left = (b[:, 3:] - a[:, 3:] @ turn.T).reshape(-1)
    shift = np.linalg.lstsq(crosses, left, rcond=None)[0]
    off = np.abs(left - crosses @ shift).reshape(len(ours), arm.n, 3).max(axis=(0, 2))
    _refuse_worst(np.where(arm.sliding_joints, 0.0, off / LARGEST_MISS_M), arm, where)
    return turn, shift


def _refuse_worst(miss: Float[Array, " n"], arm: ArmModel, where: Path) -> None:
    """Refuses a file where a joint misses by more than once what rounding may."""
    if (miss > 1.0).any():
        name = arm.joint_names[int(np.argmax(miss))]
        what = f"at {name} it moves otherwise than {arm.name}: another arm, another zero, or another sign"
        raise InputError(where, what, "give a file of the same arm, its joints turning as the URDF's do")


# Attributes of a joint that identification knows; its range, limits and what else it has are the user's.
WRITTEN = frozenset(
    {"armature", "damping", "frictionloss", "solreffriction", "solimpfriction", "springref", "stiffness"}
)
# Parts of which such an edit says nothing, and why.
LEFT_OUT = {
    "second joint": "an elastic gear needs a second joint",
    "zero": "a shifted zero would move the ranges, keyframes and actuators of the file",
    **dict.fromkeys(("gain", "bias"), "the file's actuators are left as they are"),
    **dict.fromkeys(("delay", "cutoff"), "the file's sensors are left as they are"),
}
STATES = 50


def merge_mjcf(source: Path, out: Path, identified: IdentifiedArm, placed: Path | None = None) -> dict[str, Any]:
    """Writes a copy of an MJCF with what was identified.

    Args:
        source: The user's file; it is left as it is.
        out: The copy; paths of its meshes point to where they are from `placed`, where it will lie in the end.
        identified: The arm.
        placed: That place, if `out` is only where it is put together.

    Returns:
        Which joint of the file is which of the arm, what the copy does not say and why, and the largest difference of
        its torque from the identified arm's at random states [N m].

    Raises:
        InputError: The file can't be read, is of another arm, or what hangs on a link weighs more than was identified.
    """
    root, model = open_mjcf(source)
    arm, changes = identified.whole, identified.changes
    match = match_file(identified.nominal, model, source)
    links = np.array(arm.inertial_parameters).reshape(-1, 10)
    links[-1] += sum(payload_parameters(one.values) for one in changes if one.part("mjcf") == "load")
    elements = {one.get("name"): one for one in root.iter("joint")}
    for name, own in zip(match.joints, joint_elements(identified), strict=True):
        for key in WRITTEN & own["joint"].keys():
            elements[name].set(key, own["joint"][key])
    _write_links(root, match, model, links, arm, source)
    if not identified.is_level:
        child(root, "option").set("gravity", numbers(match.base_turn @ identified.gravity))
    compiler, here = child(root, "compiler"), Path(source).parent
    folders = {key: compiler.get(key, compiler.get("assetdir", "")) for key in ("meshdir", "texturedir")}
    _point_to_meshes(compiler, folders, here, (placed or out).parent)
    with atomic_write(out) as part:
        part.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    left_out = [f"{one.effect}: {LEFT_OUT[left]}" for one in changes if (left := one.part("mjcf")) in LEFT_OUT]
    whole = arm.with_inertial_parameters(links.ravel()).with_gravity(identified.gravity)
    _point_to_meshes(compiler, folders, here, None)
    far = _difference(ET.tostring(root, encoding="unicode"), match, whole, identified.losses, bool(changes))
    joints = dict(zip(arm.joint_names, match.joints, strict=True))
    return {"joints": joints, "left_out": left_out, "torque_difference_Nm": far}


def open_mjcf(source: Path) -> tuple[ET.Element, mujoco.MjModel]:
    """The elements of a file, and what MuJoCo makes of it; InputError for none that it loads by itself."""
    parser, remedy = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)), "give a file that MuJoCo loads"
    try:
        text = read_text(source, remedy)
        require_bounded(read_xml(text, source, remedy, InputError), source)
        return ET.fromstring(text, parser), mujoco.MjModel.from_xml_path(str(source))
    except (OSError, ET.ParseError, ValueError) as error:
        raise InputError(source, f"can't be read as MJCF ({first_line(error)})", remedy) from None


def _write_links(
    root: ET.Element, match: Match, model: mujoco.MjModel, links: Float[Array, "n 10"], arm: ArmModel, source: Path
) -> None:
    """Gives each body its link's inertia, less what hangs on it in the file."""
    elements = {one.get("name"): one for one in root.iter("body")}
    own = {model.body(name).id for name in match.bodies}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for j, name in enumerate(match.bodies):
        left = moved(links[j], match.turns[j], match.shifts[j]) - _hanging(model, data, model.body(name).id, own)
        if not is_consistent(left):
            what = f"{arm.links[j]}: what hangs on body {name!r} leaves no body of what was identified"
            raise InputError(source, what, "give a file without the tool, or a URDF with it")
        body = elements[name]
        for old in body.findall("inertial"):
            body.remove(old)
        body.insert(0, ET.Element("inertial", inertial_attributes(left)))


def _hanging(model: mujoco.MjModel, data: mujoco.MjData, body: int, own: set[int]) -> Float[Array, " 10"]:
    """Inertia in a body's frame of all below it that is no link of the arm, in the file's own pose."""
    total = np.zeros(10)
    turn, place = data.xmat[body].reshape(3, 3), data.xpos[body]
    for other in range(body + 1, model.nbody):
        above = int(model.body_parentid[other])
        while above > body and above not in own:
            above = int(model.body_parentid[above])
        if above != body or other in own:
            continue
        frame = data.ximat[other].reshape(3, 3)
        moments = model.body_inertia[other]
        alone = np.array([model.body_mass[other], 0, 0, 0, moments[0], 0, moments[1], 0, 0, moments[2]], dtype=float)
        total += moved(alone, turn.T @ frame, turn.T @ (data.xipos[other] - place))
    return total


def _point_to_meshes(compiler: ET.Element, folders: Mapping[str, str], here: Path, there: Path | None) -> None:
    """Makes a copy of the file find meshes and textures: from another folder, or from anywhere."""
    for key, folder in folders.items():
        place = here.resolve() / folder
        compiler.set(key, str(place) if there is None else os.path.relpath(place, there.resolve()))
    compiler.attrib.pop("assetdir", None)
    if compiler.get("inertiafromgeom") == "true":  # would overrule what is written
        compiler.set("inertiafromgeom", "auto")


def _difference(text: str, match: Match, arm: ArmModel, losses: Losses, effects: bool) -> float:
    """Largest difference of torque between the merged file and the identified arm, without contacts [N m]."""
    model = mujoco.MjModel.from_xml_string(text)
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT | off.mjDSBL_SPRING | off.mjDSBL_DAMPER)
    if not effects:  # a base that stands askew in the file is the user's
        model.opt.gravity[:] = match.base_turn @ np.array(arm.model.gravity.linear)
    data = mujoco.MjData(model)
    ids = [model.joint(name).id for name in match.joints]
    places, rates = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
    rng = np.random.default_rng(0)
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    q = rng.uniform(low, high, (STATES, arm.n))
    dq, ddq = rng.uniform(-1.5, 1.5, q.shape), rng.uniform(-3.0, 3.0, q.shape)
    wanted = arm.inverse_dynamics(q, dq, ddq) + losses.motor_inertia * ddq
    found = np.empty_like(q)
    for k in range(STATES):
        mujoco.mj_resetData(model, data)
        data.qpos[places], data.qvel[rates], data.qacc[rates] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse[rates]
    return float(np.abs(found - wanted).max())
