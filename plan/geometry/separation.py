"""Signed separation of two convex bodies, compiled.

By the separating axes of their boxes, near ones by simplexes (`plan.geometry.simplex`).

Overlapping boxes: the largest gap over the 15 axes is minus the exact penetration depth. Apart: it
is a lower bound of the distance, refined by simplexes where the boxes are close enough to matter.
Round bodies are boxes, rods or points with a radius; hulls are corners, with a radius where some of
them were left out. Coal checks every returned plan; this loop is what the planners look at 10⁵
times.

Source: S. Gottschalk, M. C. Lin, D. Manocha, 1996, "OBBTree" (separating axes of two boxes).
"""

from __future__ import annotations

import math

import numpy as np

from ident.compiled import compiled
from plan.geometry.simplex import simplex_gap

# Below this gap the bound for separated bodies is refined to the distance [m].
BAND = 0.05
# Squared sine of the angle between two edges below which they are parallel.
PARALLEL = 1e-10


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def box_gap(ra, ta, ha, rb, tb, hb):  # type: ignore[no-untyped-def]
    """Signed separation of two boxes [m]: the largest gap over their 15 separating axes.

    Along an axis it is the distance of the centres less what both boxes reach. The axes are the
    normals of either box's faces, and of each pair of their edges. Exact where the boxes overlap, a
    lower bound where they are apart.

    Args:
        ra: Axes of the first box, shape (3, 3), in columns.
        ta: Its centre, (3,) [m].
        ha: Its half edge lengths, (3,) [m].
        rb: Axes of the second box, in the same frame.
        tb: Its centre.
        hb: Its half edge lengths.
    """
    # Cosines between the axes, and the second centre, in the axes of the first box.
    c = np.empty((3, 3))
    t = np.empty(3)
    for i in range(3):
        t[i] = ra[0, i] * (tb[0] - ta[0]) + ra[1, i] * (tb[1] - ta[1]) + ra[2, i] * (tb[2] - ta[2])
        for j in range(3):
            c[i, j] = ra[0, i] * rb[0, j] + ra[1, i] * rb[1, j] + ra[2, i] * rb[2, j]
    best = -1e9
    for i in range(3):
        gap = abs(t[i]) - ha[i] - hb[0] * abs(c[i, 0]) - hb[1] * abs(c[i, 1]) - hb[2] * abs(c[i, 2])
        best = max(best, gap)
        along = t[0] * c[0, i] + t[1] * c[1, i] + t[2] * c[2, i]
        gap = (
            abs(along) - hb[i] - ha[0] * abs(c[0, i]) - ha[1] * abs(c[1, i]) - ha[2] * abs(c[2, i])
        )
        best = max(best, gap)
    for i in range(3):
        i1 = (i + 1) % 3
        i2 = (i + 2) % 3
        for j in range(3):
            square = 1.0 - c[i, j] * c[i, j]
            if square < PARALLEL:  # parallel edges: a face has the same normal
                continue
            j1 = (j + 1) % 3
            j2 = (j + 2) % 3
            along = t[i2] * c[i1, j] - t[i1] * c[i2, j]
            reach = (
                ha[i1] * abs(c[i2, j])
                + ha[i2] * abs(c[i1, j])
                + hb[j1] * abs(c[i, j2])
                + hb[j2] * abs(c[i, j1])
            )
            best = max(best, (abs(along) - reach) / math.sqrt(square))
    return best


@compiled(fastmath=True, nogil=True, inline="always", error_model="numpy")
def ball_gap(i, j, bodies):  # type: ignore[no-untyped-def]
    """Gap of the balls round two bodies [m]; negative where they overlap.

    Args:
        i: Number of the one body.
        j: Number of the other.
        bodies: All bodies, placed by `place_bodies`.
    """
    apart = 0.0
    for k in range(3):
        apart += (bodies.each.placed_at[i, k] - bodies.each.placed_at[j, k]) ** 2
    return math.sqrt(apart) - bodies.each.ball[i] - bodies.each.ball[j]


@compiled(fastmath=True, nogil=True, error_model="numpy")
def body_gap(i, j, bodies, warm, enough, band):  # type: ignore[no-untyped-def]
    """Signed separation of two bodies by number, in their places [m]; `warm` as in `simplex_gap`.

    What is known to be larger than `enough`, or than `band`, is not looked at closer: any lower
    bound above it may come back.

    Args:
        i: Number of the one body.
        j: Number of the other.
        bodies: All bodies, placed by `place_bodies`.
        warm: Three numbers, read and written: see `simplex_gap`.
        enough: A gap beyond which nobody asks [m].
        band: A gap up to which it is exact at most [m].
    """
    rot = bodies.each.placed_rot
    centre = bodies.each.placed_at
    extra = bodies.each.radius[i] + bodies.each.radius[j]
    simple = bodies.each.number[i] == 0 and bodies.each.number[j] == 0
    known = min(band, enough)
    if not simple or extra > 0.0:
        bound = ball_gap(i, j, bodies)
        if bound > known:
            return bound
    if simple:
        bound = box_gap(
            rot[i], centre[i], bodies.each.core[i], rot[j], centre[j], bodies.each.core[j]
        )
        bound -= extra
        if bound <= -extra:
            return bound
    else:
        bound = box_gap(
            rot[i], centre[i], bodies.each.half[i], rot[j], centre[j], bodies.each.half[j]
        )
    if bound > known:
        return bound
    return max(bound, simplex_gap(i, j, bodies, known + extra, warm) - extra)


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def shape_gap(i, j, bodies, warm, enough, band):  # type: ignore[no-untyped-def]
    """Signed separation of two shapes [m]; of near hulls with parts, the smallest gap of these.

    Args:
        i: Number of the one body.
        j: Number of the other.
        bodies: All bodies, placed by `place_bodies`.
        warm: As in `body_gap`.
        enough: As in `body_gap` [m].
        band: As in `body_gap` [m].
    """
    gap = body_gap(i, j, bodies, warm, enough, band)
    if bodies.each.parts[i] + bodies.each.parts[j] == 0 or gap > min(enough, band):
        return gap
    first_of_i, end_of_i = _range_of_parts(i, bodies)
    first_of_j, end_of_j = _range_of_parts(j, bodies)
    least = 1e9
    seen = np.empty(3)
    for a in range(first_of_i, end_of_i):
        for b in range(first_of_j, end_of_j):
            for k in range(3):
                seen[k] = warm[k]
            least = min(least, body_gap(a, b, bodies, seen, min(enough, least), band))
    return max(gap, least)


@compiled(fastmath=True, nogil=True, error_model="numpy", inner=True)
def _range_of_parts(body, bodies):  # type: ignore[no-untyped-def]
    """Numbers of a hull's parts, the first and the one behind the last; its own without parts."""
    parts = bodies.each.parts[body]
    if parts == 0:
        return body, body + 1
    return bodies.each.part[body], bodies.each.part[body] + parts
