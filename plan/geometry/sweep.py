"""Gaps of whole scenes, compiled: for positions, and swept along trajectories.

What stands still is searched by a tree: for a link of the arm, only the bodies are looked at whose
boxes come nearer than what was found so far. So a scene of a hundred obstacles costs little more
than one.
"""

from __future__ import annotations

import math

import numpy as np

from ident.compiled import compiled
from plan.dynamics.rigid import joint_axis, place_bodies, place_frames
from plan.geometry.compiled import DEEPEST
from plan.geometry.separation import BAND, ball_gap, shape_gap

# Steps through a collision: a section's share at most, so that its depth is felt.
STEPS = 24
# Where a gap is at its margin, a step changes it by this at most [m].
FINE = 2e-3
# Inside the margin no step is shorter than this share of the longest: there only the mean shortfall
# counts.
SHORTEST = 0.3
# Of the pairs that may be left out, none.
ALL = np.ones((0, 0), dtype=np.bool_)
# Gaps beyond this are all the same: there is nothing to hit [m].
FAR = 1.0
# Parts of a section of which each has its own top speeds.
PARTS = 8
# Bodies of the world of which each link remembers the direction in which it last saw them; more of
# them share places.
REMEMBERED = 256


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def _world_gap(  # type: ignore[no-untyped-def]
    tree, bodies, link, root, most, hint, seen, band
):
    """Smallest gap between a link and the bodies below a node, or `most` if none is nearer [m].

    The body that was nearest last time, `hint`, is looked at first, and each from the direction in
    which it was seen then, `seen`: that spares most of the others all but one look. Without places
    in `seen` every look begins anew. Beyond `band` a gap is a lower bound, and another body than
    `hint` may be nearer.
    """
    if root < 0:
        return most
    known = hint[0]
    places = seen.shape[0]
    low = np.empty(3)
    high = np.empty(3)
    anew = np.empty(3)
    anew[:] = 0.0
    _extent(bodies, link, low, high)
    stack = np.empty(DEEPEST, dtype=np.int64)
    bounds = np.empty(DEEPEST)
    stack[0] = root
    bounds[0] = -1e300
    top = 1
    best = most
    if known >= 0:
        warm = seen[known % places] if places > 0 else anew
        best = min(best, shape_gap(known, link, bodies, warm, best, band))
    while top > 0:
        top -= 1
        if bounds[top] >= best:
            continue
        node = stack[top]
        if tree.nodes.left[node] < 0:
            body = tree.nodes.body[node]
            if body == known:
                continue
            anew[:] = 0.0
            gap = shape_gap(
                body, link, bodies, seen[body % places] if places > 0 else anew, best, band
            )
            if gap < best:
                best = gap
                hint[0] = body
            continue
        a = tree.nodes.left[node]
        b = tree.nodes.right[node]
        near_a = _node_gap(tree, bodies, a, link, (low, high), best)
        near_b = _node_gap(tree, bodies, b, link, (low, high), best)
        if near_a < near_b:  # the nearer child is put on top
            a, b, near_a, near_b = b, a, near_b, near_a
        if near_a < best:
            stack[top] = a
            bounds[top] = near_a
            top += 1
        if near_b < best:
            stack[top] = b
            bounds[top] = near_b
            top += 1
    return best


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def _node_gap(tree, bodies, node, link, box, enough):  # type: ignore[no-untyped-def]
    """Lower bound of a link's signed separation from whatever a node holds [m].

    The boxes along the base's axes are looked at first; where these are nearer than `enough`, the
    node's box against the link's own, along the link's axes: a long link that lies askew fills
    little of its box along the base's axes.
    """
    low, high = box
    deep = -1e300
    square = 0.0
    for k in range(3):
        apart = max(tree.nodes.low[node, k] - high[k], low[k] - tree.nodes.high[node, k])
        deep = max(deep, apart)
        square += max(apart, 0.0) ** 2
    bound = math.sqrt(square) if square > 0.0 else deep
    if bound >= enough:
        return bound
    deep = -1e300
    square = 0.0
    for m in range(3):
        middle = 0.0
        reach = bodies.each.half[link, m]
        for k in range(3):
            r = bodies.each.placed_rot[link, k, m]
            middle += r * (
                0.5 * (tree.nodes.low[node, k] + tree.nodes.high[node, k])
                - bodies.each.placed_at[link, k]
            )
            reach += abs(r) * 0.5 * (tree.nodes.high[node, k] - tree.nodes.low[node, k])
        apart = abs(middle) - reach
        deep = max(deep, apart)
        square += max(apart, 0.0) ** 2
    return max(bound, math.sqrt(square) if square > 0.0 else deep)


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def _extent(bodies, body, low, high):  # type: ignore[no-untyped-def]
    """Box along the base frame's axes round a body [m]."""
    for k in range(3):
        extent = 0.0
        for m in range(3):
            extent += abs(bodies.each.placed_rot[body, k, m]) * bodies.each.half[body, m]
        low[k] = bodies.each.placed_at[body, k] - extent
        high[k] = bodies.each.placed_at[body, k] + extent


@compiled(fastmath=True, nogil=True, inline="always", error_model="numpy")
def _top_speeds(points, slopes, duration, out):  # type: ignore[no-untyped-def]
    """Top speed of every joint in each part of a section, exact, shape (PARTS, n) [rad/s]."""
    for j in range(points.shape[1]):
        v0 = slopes[0, j] * duration
        v1 = slopes[1, j] * duration
        d = points[1, j] - points[0, j]
        c2 = 3.0 * d - 2.0 * v0 - v1
        c3 = v0 + v1 - 2.0 * d
        bottom = -c2 / (3.0 * c3) if abs(c3) > 1e-14 else -1.0
        before = abs(v0)
        for i in range(PARTS):
            s = (i + 1.0) / PARTS
            after = abs(v0 + s * (2.0 * c2 + 3.0 * c3 * s))
            out[i, j] = max(before, after) / duration
            if i < bottom * PARTS < i + 1.0:
                out[i, j] = max(out[i, j], abs(v0 + c2 * bottom) / duration)
            before = after


@compiled(fastmath=True, nogil=True, inline="always", error_model="numpy")
def _ahead(chain, bodies, room, link, spare, levers, section):  # type: ignore[no-untyped-def]
    """Time in which no point of a link moves farther than `spare` against a frame [s].

    To the section's end at the most. A point of the link is as far from a joint's axis as it is
    now, and farther by no more than it moves.

    Args:
        chain, bodies, room: Parts of a world, which would cost more to take apart here.
        link, spare: Whose motion, and how far.
        levers: Most that a gap can change for a unit of each joint, nought for those below the
            frame.
        section: Top speeds of the joints in each of its parts, the time in it, and its duration.
    """
    frame_rot, frame_at, reach = room
    peaks, t, duration = section
    top = bodies.each.carrier[link]
    for j in range(top):
        if chain.sliding[j] or levers[j] == 0.0:
            reach[j] = levers[j]
            continue
        axis = joint_axis(chain, frame_rot, j)
        along = 0.0
        square = 0.0
        for k in range(3):
            away = bodies.each.placed_at[link, k] - frame_at[j + 1, k]
            along += axis[k] * away
            square += away * away
        reach[j] = min(
            levers[j], math.sqrt(max(square - along * along, 0.0)) + bodies.each.ball[link] + spare
        )
    now = t
    current = min(int(t / duration * PARTS), PARTS - 1)
    for i in range(current, PARTS):
        rate = 1e-9
        for j in range(top):
            rate += peaks[i, j] * reach[j]
        end = duration * (i + 1.0) / PARTS
        if rate * (end - now) >= spare:
            return now + spare / rate - t
        spare -= rate * max(end - now, 0.0)
        now = max(now, end)
    return 2.0 * duration


@compiled(fastmath=True, nogil=True, error_model="numpy")
def gaps_of_states(world, pairs, q, beyond, wanted):  # type: ignore[no-untyped-def]
    """Signed separation of every pair at every position, shape (T, P) [m].

    Pairs whose balls or boxes show them to be farther apart than `beyond` are not looked at: that
    itself stands for them. So of a hundred obstacles only those near the arm cost something.

    Args:
        world: See `compiled.CompiledScene`.
        pairs: Pairs of shapes; the first of a pair with the world is the world's.
        q: Positions, shape (T, n) [rad].
        beyond: Gap from which on it does not matter how large it is [m].
        wanted: Which pairs are looked at, position by position, shape (T, P); all if it is empty.
    """
    chain, links, bodies, tree, frame_rot, frame_at, _ = world
    root = tree.root[-1]
    out = np.empty((q.shape[0], pairs.shape[0]))
    low = np.empty(3)
    high = np.empty(3)
    position = np.empty(q.shape[1])  # not q[t] itself, which may not be written: compiled apart
    anew = np.empty((0, 3))
    warm = np.empty(3)
    hints = np.empty((pairs.shape[0], 1), dtype=np.int64)
    column = np.empty((links, tree.root.shape[0]), dtype=np.int64)
    done = np.empty(pairs.shape[0], dtype=np.int64)
    near_world = np.empty(links, dtype=np.int64)  # how many pairs each link has with the world
    stack = np.empty(DEEPEST, dtype=np.int64)
    out[:] = beyond
    hints[:] = -1
    column[:] = -1
    done[:] = -1
    near_world[:] = 0
    for p in range(pairs.shape[0]):
        if pairs[p, 0] >= links:
            column[pairs[p, 1], pairs[p, 0] - links] = p
            near_world[pairs[p, 1]] += 1
    for t in range(q.shape[0]):
        for j in range(q.shape[1]):
            position[j] = q[t, j]
        place_frames(chain, position, frame_rot, frame_at)
        place_bodies(bodies, 0, links, frame_rot, frame_at)
        for p in range(pairs.shape[0]):
            a = pairs[p, 0]
            b = pairs[p, 1]
            if a < links and (len(wanted) == 0 or wanted[t, p]):
                warm[:] = 0.0  # so that a gap depends on nothing that was looked at before
                gap = ball_gap(a, b, bodies)
                out[t, p] = gap if gap > beyond else shape_gap(a, b, bodies, warm, FAR, BAND)
        for b in range(links):
            if root < 0 or near_world[b] == 0:
                continue
            _extent(bodies, b, low, high)
            stack[0] = root
            top = 1
            while top > 0:
                top -= 1
                node = stack[top]
                if _node_gap(tree, bodies, node, b, (low, high), beyond) > beyond:
                    continue
                if tree.nodes.left[node] >= 0:
                    stack[top] = tree.nodes.left[node]
                    stack[top + 1] = tree.nodes.right[node]
                    top += 2
                    continue
                shape = bodies.each.owner[tree.nodes.body[node]] - links
                p = column[b, shape]
                if p >= 0 and done[p] != t and (len(wanted) == 0 or wanted[t, p]):
                    done[p] = t
                    below = tree.root[shape]
                    out[t, p] = _world_gap(tree, bodies, b, below, 1e9, hints[p], anew, BAND)
    return out


@compiled(fastmath=True, nogil=True, error_model="numpy")
def nearest_of_states(world, pairs, q):  # type: ignore[no-untyped-def]
    """The body of the world's shape that is nearest to the link, shape (m,).

    Each pair stands at a position of its own.

    Args:
        world: See `compiled.CompiledScene`.
        pairs: Shape of the world and link of each, shape (m, 2).
        q: Positions, shape (m, n) [rad].
    """
    chain = world.chain
    bodies = world.bodies
    out = np.empty(q.shape[0], dtype=np.int64)
    hint = np.empty(1, dtype=np.int64)
    anew = np.empty((0, 3))
    position = np.empty(q.shape[1])
    hint[0] = -1
    for t in range(q.shape[0]):
        a = pairs[t, 0]
        b = pairs[t, 1]
        for j in range(q.shape[1]):
            position[j] = q[t, j]
        place_frames(chain, position, world.frame_rot, world.frame_at)
        place_bodies(bodies, b, b + 1, world.frame_rot, world.frame_at)
        if t > 0 and a != pairs[t - 1, 0]:
            hint[0] = -1  # a body of another shape
        _world_gap(world.tree, bodies, b, world.tree.root[a - world.links], 1e9, hint, anew, 1e9)
        out[t] = hint[0]
    return out


@compiled(fastmath=True, nogil=True, error_model="numpy")
def sweep(world, pairs, moving, levers, splines, margins):  # type: ignore[no-untyped-def]
    """Smallest gap beyond its margin along each trajectory.

    Skips as far as gap and top speed allow.

    Args:
        world: See `compiled.CompiledScene`.
        pairs: Pairs of links.
        moving: Links that are checked against the world, each as a whole.
        levers: Most that a gap can change for a unit of each joint, of the pairs and then of the
            moving links [m/rad].
        splines: Knots, velocities there, and section durations.
        margins: Gap below which it counts as violated, of the pairs and then of the moving links
            [m].

    Returns:
        Smallest gap − margin seen [m] and the mean over time of the worst max(margin − gap, 0) [m],
        shape (B, 2).
    """
    points, slopes, h = splines
    chain, links, bodies, tree, frame_rot, frame_at, reach = world
    root = tree.root[-1]
    batch = points.shape[0]
    sections = points.shape[1] - 1
    n = points.shape[2]
    between = pairs.shape[0]
    count = pairs.shape[0] + moving.shape[0]
    room = frame_rot, frame_at, reach
    q = np.empty(n)
    clear = np.empty(count)
    hints = np.empty((links + 1, 1), dtype=np.int64)
    hints[:] = -1
    peaks = np.empty((PARTS, n))
    seen = np.zeros((links, min(bodies.each.carrier.shape[0] - links + 1, REMEMBERED), 3))
    warm = np.zeros((between, 3))
    out = np.empty((batch, 2))
    for b in range(batch):
        least = 1e9
        violation = 0.0
        total = 0.0
        for k in range(sections):
            duration = h[b, k]
            total += duration
            for p in range(count):
                clear[p] = 0.0
            _top_speeds(points[b, k : k + 2], slopes[b, k : k + 2], duration, peaks)
            coarse = duration / STEPS
            t = 0.0
            while True:
                s = t / duration
                for j in range(n):
                    q0 = points[b, k, j]
                    q1 = points[b, k + 1, j]
                    v0 = slopes[b, k, j] * duration
                    v1 = slopes[b, k + 1, j] * duration
                    d = q1 - q0
                    q[j] = q0 + s * (v0 + s * (3.0 * d - 2.0 * v0 - v1 + s * (v0 + v1 - 2.0 * d)))
                place_frames(chain, q, frame_rot, frame_at)
                place_bodies(bodies, 0, links, frame_rot, frame_at)
                worst = 1e9
                ahead = duration
                for p in range(count):
                    if clear[p] <= t:
                        if p < between:
                            link = pairs[p, 1]
                            gap = shape_gap(pairs[p, 0], link, bodies, warm[p], FAR, BAND)
                        else:
                            link = moving[p - between]
                            gap = _world_gap(
                                tree, bodies, link, root, FAR, hints[link], seen[link], BAND
                            )
                        gap -= margins[p]
                        worst = min(worst, gap)
                        # The gap reaches its margin no sooner than this, from either side.
                        spare = max(abs(gap), FINE)
                        safe = _ahead(
                            chain, bodies, room, link, spare, levers[p], (peaks, t, duration)
                        )
                        clear[p] = t + (
                            safe if gap > 0.0 else min(max(safe, SHORTEST * coarse), coarse)
                        )
                    ahead = min(ahead, clear[p])
                least = min(least, worst)
                violation += max(-worst, 0.0) * (ahead - t)
                if t >= duration:
                    break
                t = min(ahead, duration)
        out[b, 0] = least
        out[b, 1] = violation / total
    return out
