"""Signed separation of two convex bodies, compiled: by the separating axes of their boxes, near ones by simplexes.

Overlapping boxes: the largest gap over the 15 axes is minus the exact penetration depth. Apart: it is a lower bound of
the distance, refined by simplexes where the boxes are close enough to matter. Round bodies are boxes, rods or points
with a radius; hulls are corners, with a radius where some of them were left out.
Coal checks every returned plan; this loop is what the planners look at 10⁵ times.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from plan.geometry.simplex import simplex_gap

# Below this gap the bound for separated bodies is refined to the distance [m].
BAND = 0.05


@njit(cache=True, fastmath=True, nogil=True)
def box_gap(ra, ta, ha, rb, tb, hb):  # type: ignore[no-untyped-def]
    """Signed separation of two boxes [m]: rotation, centre and half lengths of each, in one frame.

    Exact where they overlap, a lower bound where they are apart.
    """
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
        gap = abs(along) - hb[i] - ha[0] * abs(c[0, i]) - ha[1] * abs(c[1, i]) - ha[2] * abs(c[2, i])
        best = max(best, gap)
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            square = 1.0 - c[i, j] * c[i, j]
            if square < 1e-10:  # parallel edges: their normal is a face normal, done above
                continue
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            along = t[i2] * c[i1, j] - t[i1] * c[i2, j]
            reach = ha[i1] * abs(c[i2, j]) + ha[i2] * abs(c[i1, j]) + hb[j1] * abs(c[i, j2]) + hb[j2] * abs(c[i, j1])
            best = max(best, (abs(along) - reach) / math.sqrt(square))
    return best


@njit(cache=True, fastmath=True, nogil=True, inline="always")
def ball_gap(i, j, bodies):  # type: ignore[no-untyped-def]
    """Gap of the balls round two bodies [m]."""
    apart = 0.0
    for k in range(3):
        apart += (bodies.placed_at[i, k] - bodies.placed_at[j, k]) ** 2
    return math.sqrt(apart) - bodies.ball[i] - bodies.ball[j]


@njit(cache=True, fastmath=True, nogil=True)
def body_gap(i, j, bodies, warm, enough, band=BAND):  # type: ignore[no-untyped-def]
    """Signed separation of two bodies by number, in their places [m]; `warm` as in `simplex_gap`.

    What is known to be larger than `enough`, or than `band`, is not looked at closer: any lower bound above it may
    come back.
    """
    rot, at = bodies.placed_rot, bodies.placed_at
    extra = bodies.radius[i] + bodies.radius[j]
    simple = bodies.number[i] == 0 and bodies.number[j] == 0
    known = min(band, enough)
    if not simple or extra > 0.0:
        bound = ball_gap(i, j, bodies)
        if bound > known:
            return bound
    if simple:
        bound = box_gap(rot[i], at[i], bodies.core[i], rot[j], at[j], bodies.core[j]) - extra
        if bound <= -extra:
            return bound
    else:
        bound = box_gap(rot[i], at[i], bodies.half[i], rot[j], at[j], bodies.half[j])
    if bound > known:
        return bound
    return max(bound, simplex_gap(i, j, bodies, known + extra, warm) - extra)


@njit(cache=True, fastmath=True, nogil=True)
def shape_gap(i, j, bodies, warm, enough, band=BAND):  # type: ignore[no-untyped-def]
    """As `body_gap`, of hulls that may have parts: where they are near, the smallest gap of any of these [m]."""
    gap = body_gap(i, j, bodies, warm, enough, band)
    if bodies.parts[i] + bodies.parts[j] == 0 or gap > min(enough, band):
        return gap
    first, last = (bodies.part[i], bodies.part[i] + bodies.parts[i]) if bodies.parts[i] > 0 else (i, i + 1)
    begin, end = (bodies.part[j], bodies.part[j] + bodies.parts[j]) if bodies.parts[j] > 0 else (j, j + 1)
    least, seen = 1e9, np.empty(3)
    for a in range(first, last):
        for b in range(begin, end):
            seen[:] = warm
            least = min(least, body_gap(a, b, bodies, seen, min(enough, least), band))
    return max(gap, least)
