"""Signed separation of two convex bodies that are known by their farthest points alone, compiled.

Apart: simplexes of the bodies' difference close in on the point nearest to the origin, and what is returned is the gap
between two planes that stand on the line to it, a lower bound that ends at the distance. Overlapping: the best of
some directions, improved a little; it is never above minus the depth's true value.

Source: E. G. Gilbert, D. W. Johnson, S. S. Keerthi, 1988, "A fast procedure for computing the distance between
complex objects in three-dimensional space"; nearest points of triangles and tetrahedra by C. Ericson, 2005.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Most points that are added to a simplex; what is reached by then is a lower bound still.
ROUNDS = 40
# The distance is known to this [m].
EXACT = 1e-5
# Steps by which a direction of least depth is improved, and the first one's size [rad].
TURNS, TURN = 8, 0.3


@njit(cache=True, nogil=True)
def _farthest(dx, dy, dz, i, rot, at, bodies):  # type: ignore[no-untyped-def]
    """The farthest point of a body's core along a direction of the base frame."""
    r = rot[i]
    lx = r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz
    ly = r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz
    lz = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
    if bodies.number[i] == 0:
        x = math.copysign(bodies.core[i, 0], lx)
        y = math.copysign(bodies.core[i, 1], ly)
        z = math.copysign(bodies.core[i, 2], lz)
    else:
        chosen, best = bodies.first[i], -1e300
        for m in range(bodies.first[i], bodies.first[i] + bodies.number[i]):
            along = bodies.corners[m, 0] * lx + bodies.corners[m, 1] * ly + bodies.corners[m, 2] * lz
            if along > best:
                best, chosen = along, m
        x, y, z = bodies.corners[chosen, 0], bodies.corners[chosen, 1], bodies.corners[chosen, 2]
    return (
        at[i, 0] + r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        at[i, 1] + r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        at[i, 2] + r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@njit(cache=True, nogil=True)
def _difference(dx, dy, dz, i, j, rot, at, bodies):  # type: ignore[no-untyped-def]
    """The nearest point of the cores' difference along a direction from j to i."""
    ax, ay, az = _farthest(-dx, -dy, -dz, i, rot, at, bodies)
    bx, by, bz = _farthest(dx, dy, dz, j, rot, at, bodies)
    return ax - bx, ay - by, az - bz


@njit(cache=True, nogil=True)
def simplex_gap(i, j, rot, at, bodies, enough, warm):  # type: ignore[no-untyped-def]
    """Signed separation of two bodies' cores, their radii left out [m].

    Args:
        i, j: Numbers of the bodies.
        rot, at: Placements of all bodies.
        bodies: See `compiled.Bodies`.
        enough: A gap that is known to be larger than this need not be known closer [m].
        warm: A direction to start from, if not zero: the one that was found here last time. It is replaced.
    """
    simplex, count = np.empty((4, 3)), 0
    x, y, z = warm[0], warm[1], warm[2]
    if x == 0.0 and y == 0.0 and z == 0.0:
        x, y, z = at[i, 0] - at[j, 0], at[i, 1] - at[j, 1], at[i, 2] - at[j, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-12:
        x, y, z, length = 0.0, 0.0, 1.0, 1.0
    tx, ty, tz, best = x / length, y / length, z / length, -1e300
    for _ in range(ROUNDS):
        dx, dy, dz = x / length, y / length, z / length
        wx, wy, wz = _difference(dx, dy, dz, i, j, rot, at, bodies)
        gap = wx * dx + wy * dy + wz * dz
        if gap > best:
            best, tx, ty, tz = gap, dx, dy, dz
        if best > enough or (count > 0 and length - best < EXACT):
            break
        known = False
        for m in range(count):
            known = known or abs(simplex[m, 0] - wx) + abs(simplex[m, 1] - wy) + abs(simplex[m, 2] - wz) < 1e-12
        if known:
            break
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = wx, wy, wz
        count, x, y, z = _nearest(simplex, count + 1)
        length = math.sqrt(x * x + y * y + z * z)
        if count == 4 or length < 1e-10:
            break
    warm[0], warm[1], warm[2] = tx, ty, tz
    return best if best > min(enough, 0.0) else _deepest(tx, ty, tz, i, j, rot, at, bodies)


@njit(cache=True, nogil=True)
def _deepest(tx, ty, tz, i, j, rot, at, bodies):  # type: ignore[no-untyped-def]
    """The largest gap (the least depth) found among some directions, the best of them improved step by step."""
    cx, cy, cz, best = tx, ty, tz, -1e300
    nx, ny, nz = 0.0, 0.0, 0.0
    away_x, away_y, away_z = at[i, 0] - at[j, 0], at[i, 1] - at[j, 1], at[i, 2] - at[j, 2]
    for k in range(7):
        dx, dy, dz = tx, ty, tz
        if k < 6:
            body = i if k < 3 else j
            dx, dy, dz = rot[body, 0, k % 3], rot[body, 1, k % 3], rot[body, 2, k % 3]
            if dx * away_x + dy * away_y + dz * away_z < 0.0:
                dx, dy, dz = -dx, -dy, -dz
        wx, wy, wz = _difference(dx, dy, dz, i, j, rot, at, bodies)
        gap = wx * dx + wy * dy + wz * dz
        if gap > best:
            best, cx, cy, cz, nx, ny, nz = gap, dx, dy, dz, wx, wy, wz
    step = TURN
    for _ in range(TURNS):
        sx, sy, sz = nx - best * cx, ny - best * cy, nz - best * cz
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        if length < 1e-12:
            break
        c, s = math.cos(step), math.sin(step) / length
        dx, dy, dz = c * cx + s * sx, c * cy + s * sy, c * cz + s * sz
        wx, wy, wz = _difference(dx, dy, dz, i, j, rot, at, bodies)
        gap = wx * dx + wy * dy + wz * dz
        if gap > best:
            best, cx, cy, cz, nx, ny, nz = gap, dx, dy, dz, wx, wy, wz
        else:
            step *= 0.4
    return best


@njit(cache=True, nogil=True)
def _nearest(p, count):  # type: ignore[no-untyped-def]
    """Point of a simplex nearest to the origin, after the number of corners that carry it; these come first in p."""
    if count == 1:
        return 1, p[0, 0], p[0, 1], p[0, 2]
    if count == 2:
        return _nearest_of_edge(p, 0, 1)
    if count == 3:
        return _nearest_of_triangle(p, 0, 1, 2)
    return _nearest_of_tetrahedron(p)


@njit(cache=True, nogil=True)
def _keep(p, a, b, c):  # type: ignore[no-untyped-def]
    """Moves three corners to the front."""
    for k in range(3):
        x, y, z = p[a, k], p[b, k], p[c, k]
        p[0, k], p[1, k], p[2, k] = x, y, z


@njit(cache=True, nogil=True)
def _nearest_of_edge(p, a, b):  # type: ignore[no-untyped-def]
    ex, ey, ez = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
    square = ex * ex + ey * ey + ez * ez
    share = -(p[a, 0] * ex + p[a, 1] * ey + p[a, 2] * ez) / square if square > 0.0 else 0.0
    if share >= 1.0:
        _keep(p, b, a, a)
        return 1, p[0, 0], p[0, 1], p[0, 2]
    _keep(p, a, b, a)
    if share <= 0.0:
        return 1, p[0, 0], p[0, 1], p[0, 2]
    return 2, p[0, 0] + share * ex, p[0, 1] + share * ey, p[0, 2] + share * ez


@njit(cache=True, nogil=True)
def _edge_square(p, a, b):  # type: ignore[no-untyped-def]
    """Square of the origin's distance from an edge."""
    ex, ey, ez = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
    square = ex * ex + ey * ey + ez * ez
    share = -(p[a, 0] * ex + p[a, 1] * ey + p[a, 2] * ez) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    x, y, z = p[a, 0] + share * ex, p[a, 1] + share * ey, p[a, 2] + share * ez
    return x * x + y * y + z * z


@njit(cache=True, nogil=True)
def _inside_triangle(p, a, b, c):  # type: ignore[no-untyped-def]
    """Shares of b and c in the origin's foot on a triangle's plane, and whether it lies inside."""
    ux, uy, uz = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
    vx, vy, vz = p[c, 0] - p[a, 0], p[c, 1] - p[a, 1], p[c, 2] - p[a, 2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    au = -(p[a, 0] * ux + p[a, 1] * uy + p[a, 2] * uz)
    av = -(p[a, 0] * vx + p[a, 1] * vy + p[a, 2] * vz)
    area = uu * vv - uv * uv
    if area <= 1e-14 * uu * vv:
        return False, 0.0, 0.0
    s, t = (vv * au - uv * av) / area, (uu * av - uv * au) / area
    return s > 0.0 and t > 0.0 and s + t < 1.0, s, t


@njit(cache=True, nogil=True)
def _nearest_of_triangle(p, a, b, c):  # type: ignore[no-untyped-def]
    inside, s, t = _inside_triangle(p, a, b, c)
    if inside:
        _keep(p, a, b, c)
        return (
            3,
            p[0, 0] + s * (p[1, 0] - p[0, 0]) + t * (p[2, 0] - p[0, 0]),
            p[0, 1] + s * (p[1, 1] - p[0, 1]) + t * (p[2, 1] - p[0, 1]),
            p[0, 2] + s * (p[1, 2] - p[0, 2]) + t * (p[2, 2] - p[0, 2]),
        )
    ab, ac, bc = _edge_square(p, a, b), _edge_square(p, a, c), _edge_square(p, b, c)
    if ab <= ac and ab <= bc:
        return _nearest_of_edge(p, a, b)
    if ac <= bc:
        return _nearest_of_edge(p, a, c)
    return _nearest_of_edge(p, b, c)


@njit(cache=True, nogil=True)
def _triangle_square(p, a, b, c):  # type: ignore[no-untyped-def]
    """Square of the origin's distance from a triangle."""
    inside, s, t = _inside_triangle(p, a, b, c)
    if inside:
        square = 0.0
        for k in range(3):
            x = p[a, k] + s * (p[b, k] - p[a, k]) + t * (p[c, k] - p[a, k])
            square += x * x
        return square
    return min(_edge_square(p, a, b), min(_edge_square(p, a, c), _edge_square(p, b, c)))


@njit(cache=True, nogil=True)
def _hidden(p, a, b, c, d):  # type: ignore[no-untyped-def]
    """Whether the origin lies on the side of the face a, b, c on which d lies."""
    ux, uy, uz = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
    vx, vy, vz = p[c, 0] - p[a, 0], p[c, 1] - p[a, 1], p[c, 2] - p[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    opposite = nx * (p[d, 0] - p[a, 0]) + ny * (p[d, 1] - p[a, 1]) + nz * (p[d, 2] - p[a, 2])
    origin = -(nx * p[a, 0] + ny * p[a, 1] + nz * p[a, 2])
    return opposite * origin > 0.0


@njit(cache=True, nogil=True)
def _nearest_of_tetrahedron(p):  # type: ignore[no-untyped-def]
    best, face = 1e300, -1
    if not _hidden(p, 0, 1, 2, 3):
        best, face = _triangle_square(p, 0, 1, 2), 0
    if not _hidden(p, 0, 1, 3, 2):
        square = _triangle_square(p, 0, 1, 3)
        if square < best:
            best, face = square, 1
    if not _hidden(p, 0, 2, 3, 1):
        square = _triangle_square(p, 0, 2, 3)
        if square < best:
            best, face = square, 2
    if not _hidden(p, 1, 2, 3, 0):
        square = _triangle_square(p, 1, 2, 3)
        if square < best:
            best, face = square, 3
    if face < 0:
        return 4, 0.0, 0.0, 0.0
    if face == 0:
        return _nearest_of_triangle(p, 0, 1, 2)
    if face == 1:
        return _nearest_of_triangle(p, 0, 1, 3)
    if face == 2:
        return _nearest_of_triangle(p, 0, 2, 3)
    return _nearest_of_triangle(p, 1, 2, 3)
