"""Gaps of whole scenes, compiled: for positions, and swept along trajectories.

What stands still is searched by a tree: for a link of the arm, only the bodies are looked at whose boxes come nearer
than what was found so far. So a scene of a hundred obstacles costs little more than one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from plan.geometry.compiled import DEEPEST
from plan.geometry.separation import BAND, body_gap

# Steps through a collision: a section's share at most, so that its depth is felt.
STEPS = 24
# Where a gap is at its margin, a step changes it by this at most [m].
FINE = 2e-3
# Inside the margin no step is shorter than this share of the longest: there only the mean shortfall counts.
SHORTEST = 0.3
# Gaps beyond this are all the same: there is nothing to hit [m].
FAR = 1.0


@njit(cache=True, fastmath=True, nogil=True)
def place_frames(chain, q, frame_rot, frame_at):  # type: ignore[no-untyped-def]
    """World placement of every joint frame for one position; frame 0 is the world."""
    rot, off, axes, sliding = chain
    for k in range(3):
        frame_at[0, k] = 0.0
        for m in range(3):
            frame_rot[0, k, m] = 1.0 if k == m else 0.0
    r = np.empty((3, 3))
    p = np.empty(3)
    for i in range(q.shape[0]):
        slides = sliding[i] > 0.5
        s = 0.0 if slides else math.sin(q[i])
        c = 0.0 if slides else 1.0 - math.cos(q[i])
        for k in range(3):
            p[k] = off[i, k]
            for m in range(3):
                r[k, m] = rot[i, 0, k, m] + s * rot[i, 1, k, m] + c * rot[i, 2, k, m]
                if slides:
                    p[k] += rot[i, 0, k, m] * axes[i, m] * q[i]
        for k in range(3):
            frame_at[i + 1, k] = frame_at[i, k]
            for m in range(3):
                frame_at[i + 1, k] += frame_rot[i, k, m] * p[m]
                frame_rot[i + 1, k, m] = (
                    frame_rot[i, k, 0] * r[0, m] + frame_rot[i, k, 1] * r[1, m] + frame_rot[i, k, 2] * r[2, m]
                )


@njit(cache=True, fastmath=True, nogil=True)
def place_bodies(bodies, start, stop, frame_rot, frame_at, out_rot, out_at):  # type: ignore[no-untyped-def]
    """World placement of the bodies from `start` up to `stop`."""
    for b in range(start, stop):
        f = bodies.carrier[b]
        for k in range(3):
            out_at[b, k] = frame_at[f, k]
            for m in range(3):
                out_at[b, k] += frame_rot[f, k, m] * bodies.at[b, m]
                out_rot[b, k, m] = (
                    frame_rot[f, k, 0] * bodies.rot[b, 0, m]
                    + frame_rot[f, k, 1] * bodies.rot[b, 1, m]
                    + frame_rot[f, k, 2] * bodies.rot[b, 2, m]
                )


@njit(cache=True, fastmath=True, nogil=True)
def slopes_of_points(chain, q, joints, points, normals):  # type: ignore[no-untyped-def]
    """Derivatives by the joints of the distance of two points along a normal, each row at its own position [m/rad].

    Args:
        chain: The arm's kinematics.
        q: Positions, shape (m, n).
        joints: Joint frames that carry the points, 0 for the world, shape (m, 2).
        points: The points in the base frame, the one that the normal leads away from first, shape (m, 2, 3) [m].
        normals: Unit vectors, shape (m, 3).
    """
    n, out = q.shape[1], np.zeros(q.shape)
    rot, at = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    lever, axis, axes, sliding = np.empty(3), np.empty(3), chain[2], chain[3]
    for row in range(q.shape[0]):
        if row == 0 or np.any(q[row] != q[row - 1]):
            place_frames(chain, q[row], rot, at)
        x, y, z = normals[row]
        for side in range(2):
            sign = 2.0 * side - 1.0
            for j in range(joints[row, side]):
                for k in range(3):
                    axis[k] = (
                        rot[j + 1, k, 0] * axes[j, 0] + rot[j + 1, k, 1] * axes[j, 1] + rot[j + 1, k, 2] * axes[j, 2]
                    )
                    lever[k] = points[row, side, k] - at[j + 1, k]
                if sliding[j] > 0.5:
                    out[row, j] += sign * (x * axis[0] + y * axis[1] + z * axis[2])
                    continue
                out[row, j] += sign * (
                    x * (axis[1] * lever[2] - axis[2] * lever[1])
                    + y * (axis[2] * lever[0] - axis[0] * lever[2])
                    + z * (axis[0] * lever[1] - axis[1] * lever[0])
                )
    return out


@njit(cache=True, fastmath=True, nogil=True)
def world_gap(link, root, tree, rot, at, bodies, most, hint, warm, band=BAND):  # type: ignore[no-untyped-def]
    """Smallest gap between a link and the bodies below a node of the tree, or `most` if none is nearer [m].

    The body that was nearest last time, `hint`, is looked at first, from its direction then, `warm`: that spares most
    of the others. Beyond `band` a gap is a lower bound, and another body than `hint` may be nearer.
    """
    if root < 0:
        return most
    known = hint[0]
    low, high = np.empty(3), np.empty(3)
    _extent(link, rot, at, bodies, low, high)
    stack, bounds = np.empty(DEEPEST, dtype=np.int64), np.empty(DEEPEST)
    stack[0], bounds[0], top, best = root, -1e300, 1, most
    if known >= 0:
        best = min(best, body_gap(known, link, rot, at, bodies, warm, best, band))
    while top > 0:
        top -= 1
        if bounds[top] >= best:
            continue
        node = stack[top]
        if tree.left[node] < 0:
            body = tree.body[node]
            gap = best if body == known else body_gap(body, link, rot, at, bodies, np.zeros(3), best, band)
            if gap < best:
                best, hint[0] = gap, body
            continue
        a, b = tree.left[node], tree.right[node]
        near_a = _node_gap(a, tree, low, high, link, rot, at, bodies, best)
        near_b = _node_gap(b, tree, low, high, link, rot, at, bodies, best)
        if near_a < near_b:  # the nearer child is put on top
            a, b, near_a, near_b = b, a, near_b, near_a
        if near_a < best:
            stack[top], bounds[top] = a, near_a
            top += 1
        if near_b < best:
            stack[top], bounds[top] = b, near_b
            top += 1
    return best


@njit(cache=True, fastmath=True, nogil=True)
def _node_gap(node, tree, low, high, link, rot, at, bodies, enough):  # type: ignore[no-untyped-def]
    """Lower bound of a link's signed separation from whatever a node holds [m].

    The boxes along the base's axes are looked at first; where these are nearer than `enough`, the node's box against
    the link's own, along the link's axes: a long link that lies askew fills little of its box along the base's axes.
    """
    deep, square = -1e300, 0.0
    for k in range(3):
        apart = max(tree.low[node, k] - high[k], low[k] - tree.high[node, k])
        deep = max(deep, apart)
        square += max(apart, 0.0) ** 2
    bound = math.sqrt(square) if square > 0.0 else deep
    if bound >= enough:
        return bound
    deep, square = -1e300, 0.0
    for m in range(3):
        middle, reach = 0.0, bodies.half[link, m]
        for k in range(3):
            r = rot[link, k, m]
            middle += r * (0.5 * (tree.low[node, k] + tree.high[node, k]) - at[link, k])
            reach += abs(r) * 0.5 * (tree.high[node, k] - tree.low[node, k])
        apart = abs(middle) - reach
        deep = max(deep, apart)
        square += max(apart, 0.0) ** 2
    return max(bound, math.sqrt(square) if square > 0.0 else deep)


@njit(cache=True, fastmath=True, nogil=True)
def _rate(link, low, spare, levers, peaks, axes, sliding, frame_rot, at, frame_at, bodies):  # type: ignore[no-untyped-def]
    """Most that a link's points can move in a second against a frame, until they have moved by `spare` [m/s].

    A point of the link is as far from a joint's axis as it is now, and farther by no more than it moves.
    """
    rate = 1e-9
    for j in range(low, bodies.carrier[link]):
        if sliding[j] > 0.5:
            rate += peaks[j]
            continue
        along, square = 0.0, 0.0
        for k in range(3):
            axis = (
                frame_rot[j + 1, k, 0] * axes[j, 0]
                + frame_rot[j + 1, k, 1] * axes[j, 1]
                + frame_rot[j + 1, k, 2] * axes[j, 2]
            )
            away = at[link, k] - frame_at[j + 1, k]
            along += axis * away
            square += away * away
        arm = math.sqrt(max(square - along * along, 0.0)) + bodies.ball[link] + spare
        rate += peaks[j] * min(levers[j], arm)
    return rate


@njit(cache=True, fastmath=True, nogil=True)
def gaps_of_states(chain, bodies, links, room, pairs, tree, q, beyond):  # type: ignore[no-untyped-def]
    """Signed separation of every pair at every position, shape (T, P) [m].

    Pairs whose balls or boxes show them to be farther apart than `beyond` are not looked at: any gap beyond it stands
    for them. So of a hundred obstacles only those near the arm cost something.

    Args:
        chain: The arm's kinematics.
        bodies: Links first, then what stands in the world.
        links: Number of links' bodies.
        room: Axes and places of all bodies in the base frame; those of the links are overwritten.
        pairs: Pairs of shapes; the first of a pair with the world is the world's, its number counted from the links.
        tree: Of the world.
        q: Positions, shape (T, n) [rad].
        beyond: Gap from which on it does not matter how large it is [m].
    """
    n, rot, at = q.shape[1], room[0], room[1]
    frame_rot, frame_at = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    out = np.empty((q.shape[0], pairs.shape[0]))
    low, high = np.empty((links, 3)), np.empty((links, 3))
    hints, warm = np.full((pairs.shape[0], 1), -1), np.zeros(3)
    for t in range(q.shape[0]):
        place_frames(chain, q[t], frame_rot, frame_at)
        place_bodies(bodies, 0, links, frame_rot, frame_at, rot, at)
        for b in range(links):
            _extent(b, rot, at, bodies, low[b], high[b])
        for p in range(pairs.shape[0]):
            a, b = pairs[p, 0], pairs[p, 1]
            warm[:] = 0.0  # so that a gap depends on nothing that was looked at before
            if a < links:
                gap = _ball_gap(a, b, at, bodies)
                out[t, p] = gap if gap > beyond else body_gap(a, b, rot, at, bodies, warm, FAR)
                continue
            root = tree.root[a - links]
            gap = _node_gap(root, tree, low[b], high[b], b, rot, at, bodies, beyond)
            if gap <= beyond:
                gap = world_gap(b, root, tree, rot, at, bodies, 1e9, hints[p], warm)
            out[t, p] = gap
    return out


@njit(cache=True, fastmath=True, nogil=True)
def nearest_of_states(chain, bodies, links, room, pairs, tree, q):  # type: ignore[no-untyped-def]
    """The body of the world's shape that is nearest to the link, each pair at a position of its own, shape (m,).

    Args:
        chain, bodies, links, room, tree: As in `gaps_of_states`.
        pairs: Shape of the world and link of each, shape (m, 2).
        q: Positions, shape (m, n) [rad].
    """
    n, rot, at = q.shape[1], room[0], room[1]
    frame_rot, frame_at = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    out, hint, warm = np.empty(q.shape[0], dtype=np.int64), np.full(1, -1), np.zeros(3)
    for t in range(q.shape[0]):
        a, b = pairs[t, 0], pairs[t, 1]
        place_frames(chain, q[t], frame_rot, frame_at)
        place_bodies(bodies, b, b + 1, frame_rot, frame_at, rot, at)
        if t > 0 and a != pairs[t - 1, 0]:
            hint[0] = -1  # a body of another shape
        world_gap(b, tree.root[a - links], tree, rot, at, bodies, 1e9, hint, warm, 1e9)
        out[t] = hint[0]
    return out


@njit(cache=True, fastmath=True, nogil=True)
def _ball_gap(a, b, at, bodies):  # type: ignore[no-untyped-def]
    """Gap of the balls round two bodies [m]."""
    apart = 0.0
    for k in range(3):
        apart += (at[a, k] - at[b, k]) ** 2
    return math.sqrt(apart) - bodies.ball[a] - bodies.ball[b]


@njit(cache=True, fastmath=True, nogil=True)
def _extent(body, rot, at, bodies, low, high):  # type: ignore[no-untyped-def]
    """Box along the base frame's axes round a body [m]."""
    for k in range(3):
        extent = 0.0
        for m in range(3):
            extent += abs(rot[body, k, m]) * bodies.half[body, m]
        low[k], high[k] = at[body, k] - extent, at[body, k] + extent


@njit(cache=True, fastmath=True, nogil=True)
def least_of_states(chain, bodies, links, room, pairs, moving, tree, q):  # type: ignore[no-untyped-def]
    """Smallest gap at every position, a metre at most, shape (T,) [m].

    Args:
        chain, bodies, links, room, tree, q: As in `gaps_of_states`.
        pairs: Pairs of links.
        moving: Links that are checked against the world.
    """
    n, rot, at = q.shape[1], room[0], room[1]
    frame_rot, frame_at = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    out, root, hints = np.empty(q.shape[0]), tree.root[-1], np.full((links + 1, 1), -1)
    warm = np.zeros((pairs.shape[0] + links + 1, 3))
    for t in range(q.shape[0]):
        place_frames(chain, q[t], frame_rot, frame_at)
        place_bodies(bodies, 0, links, frame_rot, frame_at, rot, at)
        least = FAR
        for p in range(pairs.shape[0]):
            least = min(least, body_gap(pairs[p, 0], pairs[p, 1], rot, at, bodies, warm[p], FAR))
        for m in moving:
            least = world_gap(m, root, tree, rot, at, bodies, least, hints[m], warm[pairs.shape[0] + m])
        out[t] = least
    return out


@njit(cache=True, fastmath=True, nogil=True)
def sweep(chain, bodies, links, room, pairs, moving, tree, levers, splines, margin):  # type: ignore[no-untyped-def]
    """Smallest gap along each trajectory, skipping ahead as far as the gap and the top speed allow.

    Args:
        chain, bodies, links, room, tree: As in `gaps_of_states`.
        pairs: Pairs of links.
        moving: Links that are checked against the world, each as a whole.
        levers: Most that a gap can change for a unit of each joint, of the pairs and then of the moving links [m/rad].
        splines: Knots, velocities there, section durations, and top speed in each section.
        margin: Gap that counts as violated below [m].

    Returns:
        Smallest gap seen [m] and the mean of max(margin − gap, 0) over time [m], shape (B, 2).
    """
    points, slopes, h, peaks = splines
    batch, sections, n = peaks.shape
    rot, at, frame_rot, frame_at = room[0], room[1], np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    between, count, root = pairs.shape[0], pairs.shape[0] + moving.shape[0], tree.root[-1]
    q, clear, hints = np.empty(n), np.empty(count), np.full((links + 1, 1), -1)
    warm, out = np.zeros((count, 3)), np.empty((batch, 2))
    for b in range(batch):
        least, violation, total = 1e9, 0.0, 0.0
        for k in range(sections):
            duration = h[b, k]
            total += duration
            for p in range(count):
                clear[p] = 0.0
            coarse, t = duration / STEPS, 0.0
            while True:
                s = t / duration
                for j in range(n):
                    q0, q1 = points[b, k, j], points[b, k + 1, j]
                    v0, v1 = slopes[b, k, j] * duration, slopes[b, k + 1, j] * duration
                    d = q1 - q0
                    q[j] = q0 + s * (v0 + s * (3.0 * d - 2.0 * v0 - v1 + s * (v0 + v1 - 2.0 * d)))
                place_frames(chain, q, frame_rot, frame_at)
                place_bodies(bodies, 0, links, frame_rot, frame_at, rot, at)
                worst, ahead = 1e9, duration
                for p in range(count):
                    if clear[p] <= t:
                        if p < between:
                            low, link = bodies.carrier[pairs[p, 0]], pairs[p, 1]
                            gap = body_gap(pairs[p, 0], link, rot, at, bodies, warm[p], FAR)
                        else:
                            low, link = 0, moving[p - between]
                            gap = world_gap(link, root, tree, rot, at, bodies, FAR, hints[link], warm[p])
                        worst = min(worst, gap)
                        # The gap reaches its margin no sooner than this, from either side.
                        spare = max(abs(gap - margin), FINE)
                        rate = _rate(
                            link,
                            low,
                            spare,
                            levers[p],
                            peaks[b, k],
                            chain[2],
                            chain[3],
                            frame_rot,
                            at,
                            frame_at,
                            bodies,
                        )
                        ahead_p = spare / rate
                        clear[p] = t + (ahead_p if gap > margin else min(max(ahead_p, SHORTEST * coarse), coarse))
                    ahead = min(ahead, clear[p])
                least = min(least, worst)
                step = ahead - t
                violation += max(margin - worst, 0.0) * step
                if t >= duration:
                    break
                t = min(t + step, duration)
        out[b, 0], out[b, 1] = least, violation / total
    return out
