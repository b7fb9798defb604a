"""A rigid chain in compiled loops: torque of many states, where frames and bodies are, and how
points move.

Pinocchio stays the reference (the certificate uses it); these loops exist because a planner asks
for 10⁷ states and needs them fused with the reading of trajectories. Vectors are tuples of three:
the compiler keeps them in registers. Another order of the same steps changes the last bits of what
comes out, and with them plans.
"""

from __future__ import annotations

import math

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.robot.arm import ArmModel
from ident.robot.chain import Chain, compute_joint_poses

# What loops read of a joint, as `Chain` names it; gravity is the same for all. Rows of one array
# are one argument: that halves what a loop takes to compile, and what a call costs.
JOINT = np.dtype(
    [
        ("rotations", np.float64, (3, 3, 3)),
        ("offsets", np.float64, (3,)),
        ("axes", np.float64, (3,)),
        ("sliding", np.bool_),
        ("gravity", np.float64, (3,)),
        ("masses", np.float64),
        ("centres", np.float64, (3,)),
        ("inertias", np.float64, (9,)),  # row by row
    ],
    align=True,
)


def joint_rows(chain: Chain) -> Array:
    """A chain as a row of `JOINT` for each joint."""
    rows = np.zeros(len(chain.masses), JOINT)
    for name, values in chain._asdict().items():
        rows[name] = np.reshape(values, (-1, 9)) if name == "inertias" else values
    return rows


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def place_joint(chain, i, q, r):  # type: ignore[no-untyped-def]
    """Axes of joint frame i in its parent's at a position, row by row into `r`.

    Returns:
        The frame's origin in the parent's axes [m].

    Args:
        chain: The arm's, see `joint_rows`.
        i: Number of the joint, 0 at the base.
        q: Its position [rad, of a slider m], one number.
        r: Written: nine numbers, the axes' matrix row by row.
    """
    off = chain.offsets
    rot = chain.rotations
    slides = chain.sliding[i]
    s = 0.0 if slides else math.sin(q)
    c = 0.0 if slides else 1.0 - math.cos(q)
    for k in range(3):
        for m in range(3):
            r[3 * k + m] = rot[i, 0, k, m] + s * rot[i, 1, k, m] + c * rot[i, 2, k, m]
    d = q if slides else 0.0
    x, y, z = turn(r, (chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2]))
    return off[i, 0] + d * x, off[i, 1] + d * y, off[i, 2] + d * z


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def turn(r, a):  # type: ignore[no-untyped-def]
    """A vector in a frame's axes, in those of its parent.

    Args:
        r: The frame's axes in its parent's, nine numbers row by row.
        a: The vector, three numbers.

    Returns:
        Three numbers, a tuple.
    """
    return (
        r[0] * a[0] + r[1] * a[1] + r[2] * a[2],
        r[3] * a[0] + r[4] * a[1] + r[5] * a[2],
        r[6] * a[0] + r[7] * a[1] + r[8] * a[2],
    )


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def _turn_back(r, a):  # type: ignore[no-untyped-def]
    """A vector in the parent's axes, in the frame's own."""
    return (
        r[0] * a[0] + r[3] * a[1] + r[6] * a[2],
        r[1] * a[0] + r[4] * a[1] + r[7] * a[2],
        r[2] * a[0] + r[5] * a[1] + r[8] * a[2],
    )


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def cross(a, b):  # type: ignore[no-untyped-def]
    """Cross product a × b of two vectors of three numbers, as a tuple of three."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def _add(a, b, share=1.0):  # type: ignore[no-untyped-def]
    """a + share · b."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@compiled(fastmath=True, nogil=True, inline="always", error_model="numpy")
def _carried(a, alpha, omega, p):  # type: ignore[no-untyped-def]
    """Acceleration of a point p of a body: a + α × p + ω × (ω × p), a being its origin's."""
    return _add(_add(a, cross(alpha, p)), cross(omega, cross(omega, p)))


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def rnea(chain, q, dq, ddq, work, tau):  # type: ignore[no-untyped-def]
    """Newton-Euler of one state: M ddq + C dq + G.

    Source: paper, eq. 2 (with the erratum: C(θ, dθ) dθ).

    Args:
        chain: The arm's, see `joint_rows`.
        q, dq, ddq: Its state, shape (n,).
        work: Scratch, shape (n, 18): rotation 9, force 3, moment 3, lever 3.
        tau: Torque, shape (n,).
    """
    n = q.shape[0]
    omega = (0.0, 0.0, 0.0)
    alpha = (0.0, 0.0, 0.0)
    acc = (-chain.gravity[0, 0], -chain.gravity[0, 1], -chain.gravity[0, 2])
    for i in range(n):
        r = work[i]
        p = place_joint(chain, i, q[i], r)
        acc = _turn_back(r, _carried(acc, alpha, omega, p))
        omega = _turn_back(r, omega)
        alpha = _turn_back(r, alpha)
        axis = (chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2])
        gyration = cross(omega, axis)
        if chain.sliding[i]:
            acc = _add(_add(acc, axis, ddq[i]), gyration, 2.0 * dq[i])
        else:
            alpha = _add(_add(alpha, axis, ddq[i]), gyration, dq[i])
            omega = _add(omega, axis, dq[i])
        # Force and moment that move this link, about its origin.
        c = (chain.centres[i, 0], chain.centres[i, 1], chain.centres[i, 2])
        force = _add((0.0, 0.0, 0.0), _carried(acc, alpha, omega, c), chain.masses[i])
        moment = cross(c, force)
        inertia = chain.inertias[i]
        moment = _add(_add(moment, turn(inertia, alpha)), cross(omega, turn(inertia, omega)))
        for k in range(3):
            r[9 + k] = force[k]
            r[12 + k] = moment[k]
            r[15 + k] = p[k]
    for i in range(n - 1, -1, -1):
        r = work[i]
        first = 9 if chain.sliding[i] else 12
        tau[i] = (
            chain.axes[i, 0] * r[first]
            + chain.axes[i, 1] * r[first + 1]
            + chain.axes[i, 2] * r[first + 2]
        )
        if i > 0:
            force = turn(r, (r[9], r[10], r[11]))
            moment = turn(r, (r[12], r[13], r[14]))
            moment = _add(moment, cross((r[15], r[16], r[17]), force))
            for k in range(3):
                work[i - 1, 9 + k] += force[k]
                work[i - 1, 12 + k] += moment[k]


def random_positions(arm: ArmModel, count: int) -> Float[Array, "{count} n"]:
    """Positions all over the joints' range [rad], always the same.

    What is asked of them is a property of the arm.
    """
    low = np.maximum(arm.lower, -np.pi)
    high = np.minimum(arm.upper, np.pi)
    rng = np.random.default_rng(0)
    return rng.uniform(low, high, (count, arm.n))


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def place_frames(chain, q, frame_rot, frame_at):  # type: ignore[no-untyped-def]
    """World placement of every joint frame for one position; frame 0 is the world.

    Args:
        chain: The arm's, see `joint_rows`.
        q: Joint positions (n,) [rad, of a slider m].
        frame_rot: Written: axes (n + 1, 3, 3) in the world's.
        frame_at: Written: origins (n + 1, 3) in the world [m].
    """
    for k in range(3):
        frame_at[0, k] = 0.0
        for m in range(3):
            frame_rot[0, k, m] = 1.0 if k == m else 0.0
    r = np.empty(9)
    for i in range(q.shape[0]):
        p = place_joint(chain, i, q[i], r)
        for k in range(3):
            frame_at[i + 1, k] = frame_at[i, k]
            for m in range(3):
                frame_at[i + 1, k] += frame_rot[i, k, m] * p[m]
                frame_rot[i + 1, k, m] = (
                    frame_rot[i, k, 0] * r[m]
                    + frame_rot[i, k, 1] * r[3 + m]
                    + frame_rot[i, k, 2] * r[6 + m]
                )


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def place_bodies(bodies, start, stop, frame_rot, frame_at):  # type: ignore[no-untyped-def]
    """World placement of the bodies from `start` up to `stop`, and of their parts.

    Args:
        bodies: All bodies; `placed_rot` and `placed_at` of these are written.
        start: Number of the first.
        stop: Number after the last.
        frame_rot: Axes of all frames (n + 1, 3, 3), as `place_frames` writes them.
        frame_at: Their origins (n + 1, 3) [m].
    """
    for i in range(start, stop):
        _place(i, bodies, frame_rot, frame_at)
        first = bodies.each.part[i]
        for body in range(first, first + bodies.each.parts[i]):
            _place(body, bodies, frame_rot, frame_at)


@compiled(fastmath=True, nogil=True, inline="always", error_model="numpy")
def _place(b, bodies, frame_rot, frame_at):  # type: ignore[no-untyped-def]
    """World placement of one body."""
    f = bodies.each.carrier[b]
    for k in range(3):
        bodies.each.placed_at[b, k] = frame_at[f, k]
        for m in range(3):
            bodies.each.placed_at[b, k] += frame_rot[f, k, m] * bodies.each.at[b, m]
            bodies.each.placed_rot[b, k, m] = (
                frame_rot[f, k, 0] * bodies.each.rot[b, 0, m]
                + frame_rot[f, k, 1] * bodies.each.rot[b, 1, m]
                + frame_rot[f, k, 2] * bodies.each.rot[b, 2, m]
            )


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def joint_axis(chain, frame_rot, j):  # type: ignore[no-untyped-def]
    """Axis of joint j in the base frame.

    Args:
        chain: The arm's, see `joint_rows`.
        frame_rot: Axes of all frames (n + 1, 3, 3), as `place_frames` writes them.
        j: Number of the joint, 0 at the base.

    Returns:
        Three numbers, a tuple; of unit length.
    """
    r = frame_rot[j + 1]
    a = chain.axes[j]
    return (
        r[0, 0] * a[0] + r[0, 1] * a[1] + r[0, 2] * a[2],
        r[1, 0] * a[0] + r[1, 1] * a[1] + r[1, 2] * a[2],
        r[2, 0] * a[0] + r[2, 1] * a[1] + r[2, 2] * a[2],
    )


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def _moves(chain, frame_rot, frame_at, j, point):  # type: ignore[no-untyped-def]
    """How a point of the base frame that joint j carries moves for a unit of that joint."""
    axis = joint_axis(chain, frame_rot, j)
    if chain.sliding[j]:
        return axis
    return cross(
        axis,
        (
            point[0] - frame_at[j + 1, 0],
            point[1] - frame_at[j + 1, 1],
            point[2] - frame_at[j + 1, 2],
        ),
    )


@compiled(fastmath=True, nogil=True, error_model="numpy")
def slopes_of_points(chain, q, joints, points, normals):  # type: ignore[no-untyped-def]
    """Derivatives by the joints of the distance of two points along a normal [m/rad].

    Each row stands at its own position.

    Args:
        chain: The arm's, see `joint_rows`.
        q: Positions, shape (m, n).
        joints: Joint frames that carry the points, 0 for the world, shape (m, 2).
        points: The points in the base frame, shape (m, 2, 3) [m]; the normal leads away from the
            first.
        normals: Unit vectors, shape (m, 3).
    """
    n = q.shape[1]
    out = np.zeros(q.shape)
    rot = np.empty((n + 1, 3, 3))
    origins = np.empty((n + 1, 3))
    position = np.empty(n)  # not q[row] itself, which may not be written: that is compiled apart
    for row in range(q.shape[0]):
        moved = row == 0
        for j in range(n):
            moved = moved or q[row, j] != q[row - 1, j]
        if moved:
            for j in range(n):
                position[j] = q[row, j]
            place_frames(chain, position, rot, origins)
        for side in range(2):
            for j in range(joints[row, side]):
                x, y, z = _moves(chain, rot, origins, j, points[row, side])
                out[row, j] += (2.0 * side - 1.0) * (
                    normals[row, 0] * x + normals[row, 1] * y + normals[row, 2] * z
                )
    return out


def frame_states(
    chain: Chain,
    q: Float[Array, "T n"],
    joint: int,
    turn: Float[Array, "3 3"],
    place: Float[Array, " 3"],
) -> tuple[
    Float[Array, "T 3"], Float[Array, "T 3 3"], Float[Array, "T n 3"], Float[Array, "T n 3"]
]:
    """Where a frame is along T positions, and how it moves with each joint.

    Args:
        chain: The arm.
        q: Positions [rad].
        joint: The joint that carries the frame, 0 for the world.
        turn, place: The frame in that joint's.

    Returns:
        Place and axes in the base frame; change of place and turn by the joints.
    """
    poses = compute_joint_poses(chain, q, range(joint + 1))
    carrying, origin = poses[joint]
    point = origin + carrying @ place
    linear = np.zeros((*q.shape, 3))
    angular = np.zeros((*q.shape, 3))
    for j in range(joint):
        rotation, origin = poses[j + 1]
        axis = rotation @ chain.axes[j]
        if chain.sliding[j]:
            linear[:, j] = axis
        else:
            linear[:, j] = np.cross(axis, point - origin)
            angular[:, j] = axis
    return point, carrying @ turn, linear, angular
