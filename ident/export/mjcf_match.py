"""Which joint of a foreign MJCF is which of the arm, and how its bodies stand to the arm's links.

Files of one arm differ in names, in where the base stands and in where a body's frame lies. The joints' axes do not: as
lines in space they must be the same at every pose, up to one motion of the whole arm. That motion is found from the
lines, and what does not fit then is another arm, another zero or another sign, which is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.robot.chain import compute_joint_poses

# Poses at which the axes are compared; a handful fixes a rigid motion many times over.
POSES = 12
# Files of one arm round their lengths to a tenth of a millimetre, and their angles likewise [m], [rad].
LARGEST_MISS_M, LARGEST_MISS_RAD = 2e-3, 2e-3


@dataclass(frozen=True, eq=False)
class Match:
    """How a file and an arm belong together.

    Attributes:
        joints: The file's name of each joint of the arm.
        bodies: The file's name of the body that each joint moves.
        turns, shifts: Placement of each link's frame in that body, shapes (n, 3, 3) and (n, 3) [m].
        base_turn: Rotation of the arm's base in the file's world, shape (3, 3).
    """

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    turns: Float[Array, "n 3 3"]
    shifts: Float[Array, "n 3"]
    base_turn: Float[Array, "3 3"]


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
    """Finds the arm in a file.

    Args:
        arm: The arm.
        model: The file, compiled.
        where: Its place, for messages.

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
    directions, points, theirs, theirs_at = _their_frames(model, ids, poses)
    ours = _lines(turns @ arm.joint_axes[:, :, None], places)
    turn, shift = _rigid_motion(ours, _lines(directions, points), arm, where)
    if any(not name for name in bodies):
        raise InputError(where, "a body that a joint moves has no name", "name its bodies")
    placed = np.einsum("pjba,bc,pjcd->pjad", theirs, turn, turns)
    apart = np.einsum("pjba,pjb->pja", theirs, places @ turn.T + shift - theirs_at)
    off, askew = np.abs(apart - apart[0]).max(axis=(0, 2)), np.abs(placed - placed[0]).max(axis=(0, 2, 3))
    _refuse_worst(np.maximum(off / LARGEST_MISS_M, askew / LARGEST_MISS_RAD), arm, where)
    return Match(joints, tuple(bodies), placed[0], apart[0], turn)


def _lines(directions: Array, points: Float[Array, "P n 3"]) -> Float[Array, "P n 6"]:
    """Axes as lines: direction, and moment about the origin."""
    directions = directions.reshape(points.shape)
    return np.concatenate([directions, np.cross(points, directions)], axis=2)


def _their_frames(
    model: mujoco.MjModel, ids: Sequence[int], poses: Float[Array, "P n"]
) -> tuple[Float[Array, "P n 3"], Float[Array, "P n 3"], Float[Array, "P n 3 3"], Float[Array, "P n 3"]]:
    """Direction and a point of each joint's axis, orientation and place of the body that it moves, at every pose."""
    data, bodies, found = mujoco.MjData(model), model.jnt_bodyid[ids], []
    for q in poses:
        mujoco.mj_resetData(model, data)
        data.qpos[model.jnt_qposadr[ids]] = q
        mujoco.mj_kinematics(model, data)
        placed = data.xmat[bodies].reshape(-1, 3, 3), data.xpos[bodies]
        found.append((data.xaxis[ids], data.xanchor[ids], *placed))
    directions, points, turns, places = (np.array(part) for part in zip(*found, strict=True))
    return directions, points, turns, places


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
