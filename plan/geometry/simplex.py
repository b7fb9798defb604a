"""Distance of two convex bodies' cores by simplexes, compiled.

The bodies' difference A − B = {a − b} holds the origin where they overlap; else their distance is
that of its point nearest to the origin. Simplexes of up to four of its points close in on that
point. What is returned is the gap between two planes across the line to it: a lower bound of the
distance, which ends at the distance. Of bodies that overlap it is minus the depth along the best of
some directions, improved a little: never above minus the depth's true value.

Vectors are tuples of three [m]. Round bodies have a core, a box or corners, and a radius that is
left out here.

Source: E. G. Gilbert, D. W. Johnson, S. S. Keerthi, 1988, "A fast procedure for computing the
distance between complex objects in three-dimensional space"; nearest points of triangles by C.
Ericson, 2005.
"""

from __future__ import annotations

import math

import numpy as np

from ident.compiled import compiled

# Most points that are added to a simplex; what is reached by then is a lower bound still.
ROUNDS = 40
# The distance is known to this [m].
EXACT = 1e-5
# Steps by which a direction of least depth is improved.
TURNS = 8
# The first one's size [rad].
TURN = 0.3
# By what a step is multiplied that improved nothing.
SHRINK = 0.4
# Corners of a tetrahedron's faces, and the corner opposite to each.
FACES = ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1), (1, 2, 3, 0))
# Lengths below this are zero [m].
NO_LENGTH = 1e-12


@compiled(nogil=True, inline="always", error_model="numpy")
def _row(vectors, i):  # type: ignore[no-untyped-def]
    """One of some vectors, shape (k, 3)."""
    return vectors[i, 0], vectors[i, 1], vectors[i, 2]


@compiled(nogil=True, error_model="numpy", inner=True)
def _dot(a, b):  # type: ignore[no-untyped-def]
    """aᵀ b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(nogil=True, inline="always", error_model="numpy")
def _length(a):  # type: ignore[no-untyped-def]
    """|a|."""
    return math.sqrt(_dot(a, a))


@compiled(nogil=True, error_model="numpy", inner=True)
def _minus(a, b, share=1.0):  # type: ignore[no-untyped-def]
    """a − share · b."""
    return a[0] - share * b[0], a[1] - share * b[1], a[2] - share * b[2]


@compiled(nogil=True, error_model="numpy", inner=True)
def _scaled(a, share):  # type: ignore[no-untyped-def]
    """share · a."""
    return share * a[0], share * a[1], share * a[2]


@compiled(nogil=True, error_model="numpy", inner=True)
def _cross(a, b):  # type: ignore[no-untyped-def]
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled(nogil=True, inline="always", error_model="numpy")
def _farthest_corner(body, direction, bodies):  # type: ignore[no-untyped-def]
    """Of a core with corners, the one farthest along a direction in the body's axes."""
    corners = bodies.corners
    first = bodies.each.first[body]
    chosen = first
    best = -1e300
    for m in range(first, first + bodies.each.number[body]):
        along = (
            corners[m, 0] * direction[0]
            + corners[m, 1] * direction[1]
            + corners[m, 2] * direction[2]
        )
        if along > best:
            best = along
            chosen = m
    return corners[chosen, 0], corners[chosen, 1], corners[chosen, 2]


@compiled(nogil=True, error_model="numpy", inner=True)
def _farthest(direction, body, bodies):  # type: ignore[no-untyped-def]
    """The farthest point of a body's core along a direction, both in the base frame."""
    rot = bodies.each.placed_rot[body]
    centre = bodies.each.placed_at[body]
    inside = (
        rot[0, 0] * direction[0] + rot[1, 0] * direction[1] + rot[2, 0] * direction[2],
        rot[0, 1] * direction[0] + rot[1, 1] * direction[1] + rot[2, 1] * direction[2],
        rot[0, 2] * direction[0] + rot[1, 2] * direction[1] + rot[2, 2] * direction[2],
    )
    if bodies.each.number[body] == 0:
        half = bodies.each.core[body]
        point = (
            math.copysign(half[0], inside[0]),
            math.copysign(half[1], inside[1]),
            math.copysign(half[2], inside[2]),
        )
    else:
        point = _farthest_corner(body, inside, bodies)
    return (
        centre[0] + rot[0, 0] * point[0] + rot[0, 1] * point[1] + rot[0, 2] * point[2],
        centre[1] + rot[1, 0] * point[0] + rot[1, 1] * point[1] + rot[1, 2] * point[2],
        centre[2] + rot[2, 0] * point[0] + rot[2, 1] * point[1] + rot[2, 2] * point[2],
    )


@compiled(nogil=True, inline="always", error_model="numpy")
def _nearest_of_difference(direction, i, j, bodies):  # type: ignore[no-untyped-def]
    """The point of the difference of cores i and j that is least far along a direction.

    A direction from j to i: its product with the point is the gap between planes across it.
    """
    opposite = (-direction[0], -direction[1], -direction[2])
    return _minus(_farthest(opposite, i, bodies), _farthest(direction, j, bodies))


@compiled(nogil=True, inline="always", error_model="numpy")
def _is_corner(point, simplex, count):  # type: ignore[no-untyped-def]
    """Whether a point is one of the first `count` corners of a simplex, shape (4, 3)."""
    for m in range(count):
        apart = (
            abs(simplex[m, 0] - point[0])
            + abs(simplex[m, 1] - point[1])
            + abs(simplex[m, 2] - point[2])
        )
        if apart < NO_LENGTH:
            return True
    return False


@compiled(nogil=True, error_model="numpy", inner=True)
def simplex_gap(i, j, bodies, enough, warm):  # type: ignore[no-untyped-def]
    """Signed separation of two bodies' cores, their radii left out [m].

    Args:
        i, j: Numbers of the bodies.
        bodies: See `compiled.CompiledBodies`, in their places.
        enough: A gap that is known to be larger than this need not be known closer [m].
        warm: A direction to start from, shape (3,), if not zero: the one in which the bodies were
            seen last time. It is replaced.
    """
    simplex = np.empty((4, 3))
    count = 0
    nearest = (warm[0], warm[1], warm[2])
    if nearest[0] == 0.0 and nearest[1] == 0.0 and nearest[2] == 0.0:
        places = bodies.each.placed_at
        nearest = _minus(_row(places, i), _row(places, j))
    distance = _length(nearest)
    if distance < NO_LENGTH:
        nearest = (0.0, 0.0, 1.0)
        distance = 1.0
    widest = _scaled(nearest, 1.0 / distance)
    best = -1e300
    for _ in range(ROUNDS):
        direction = _scaled(nearest, 1.0 / distance)
        point = _nearest_of_difference(direction, i, j, bodies)
        gap = _dot(point, direction)
        if gap > best:
            best = gap
            widest = direction
        if best > enough or (count > 0 and distance - best < EXACT):
            break
        if _is_corner(point, simplex, count):
            break
        simplex[count, 0] = point[0]
        simplex[count, 1] = point[1]
        simplex[count, 2] = point[2]
        count, nearest = _nearest(simplex, count + 1)
        distance = _length(nearest)
        if count == 4 or distance < 1e-10:
            break
    warm[0] = widest[0]
    warm[1] = widest[1]
    warm[2] = widest[2]
    if best > min(enough, 0.0):
        return best
    return _least_depth(widest, i, j, bodies)


@compiled(nogil=True, inline="always", error_model="numpy")
def _least_depth(first, i, j, bodies):  # type: ignore[no-untyped-def]
    """The largest gap, minus the least depth, among some directions.

    They are a given one and both bodies' axes; the best is improved step by step.
    """
    chosen = first
    nearest = first
    best = -1e300
    places = bodies.each.placed_at
    away = _minus(_row(places, i), _row(places, j))
    rot = bodies.each.placed_rot
    for k in range(7):
        direction = first
        if k < 6:
            body = i if k < 3 else j
            direction = (rot[body, 0, k % 3], rot[body, 1, k % 3], rot[body, 2, k % 3])
            if _dot(direction, away) < 0.0:
                direction = _scaled(direction, -1.0)
        point = _nearest_of_difference(direction, i, j, bodies)
        if _dot(point, direction) > best:
            best = _dot(point, direction)
            chosen = direction
            nearest = point
    return _turned(chosen, nearest, best, i, j, bodies)


@compiled(nogil=True, inline="always", error_model="numpy")
def _turned(chosen, nearest, best, i, j, bodies):  # type: ignore[no-untyped-def]
    """The largest gap that a direction reaches when it is turned towards its nearest point.

    Args:
        chosen: The direction, of length 1.
        nearest: The difference's nearest point along it [m].
        best: Their product, the gap along it [m].
        i, j, bodies: As in `simplex_gap`.
    """
    angle = TURN
    for _ in range(TURNS):
        side = _minus(nearest, chosen, best)
        length = _length(side)
        if length < NO_LENGTH:
            break
        direction = _minus(_scaled(chosen, math.cos(angle)), side, -math.sin(angle) / length)
        point = _nearest_of_difference(direction, i, j, bodies)
        if _dot(point, direction) > best:
            best = _dot(point, direction)
            chosen = direction
            nearest = point
        else:
            angle *= SHRINK
    return best


@compiled(nogil=True, inline="always", error_model="numpy")
def _nearest(simplex, count):  # type: ignore[no-untyped-def]
    """The corners that carry a simplex's point nearest to the origin: their number, and the point.

    They come first in `simplex`, the others are overwritten. A simplex of fewer than three corners
    is a triangle in which the last corner stands more than once. The number is 4 where the origin
    lies inside a tetrahedron.

    Args:
        simplex: Its corners [m], shape (4, 3).
        count: How many of them there are.
    """
    least = 1e300
    nearest = (0.0, 0.0, 0.0)
    carried = FACES[0]
    shares = (0.0, 0.0, 0.0)
    last = count - 1
    for number in range(4 if count == 4 else 1):
        face = FACES[number]
        a = _row(simplex, face[0])
        b = _row(simplex, min(face[1], last))
        c = _row(simplex, min(face[2], last))
        if count == 4 and _hidden(a, b, c, _row(simplex, face[3])):
            continue
        u, v, w = _shares(a, b, c)
        point = (
            u * a[0] + v * b[0] + w * c[0],
            u * a[1] + v * b[1] + w * c[1],
            u * a[2] + v * b[2] + w * c[2],
        )
        if _dot(point, point) < least:
            least = _dot(point, point)
            nearest = point
            carried = face
            shares = (u, v, w)
    if least == 1e300:
        return 4, nearest
    carriers = 0
    for k in range(3):
        if shares[k] > 0.0:
            # Never before its own place: faces name their corners in order.
            for m in range(3):
                simplex[carriers, m] = simplex[carried[k], m]
            carriers += 1
    return carriers, nearest


@compiled(nogil=True, inline="always", error_model="numpy")
def _shares(a, b, c):  # type: ignore[no-untyped-def]
    """Shares of a triangle's corners in its point nearest to the origin; they add up to 1.

    Signs of the origin's places along the edges tell whether that point is a corner, on an edge, or
    inside.
    """
    ab = _minus(b, a)
    ac = _minus(c, a)
    square_b = _dot(ab, ab)
    square_c = _dot(ac, ac)
    area = square_b * square_c - _dot(ab, ac) ** 2
    if area <= 1e-14 * square_b * square_c:
        return _shares_of_line(a, b, c)
    # Where the origin lies along the edges ab and ac, seen from each corner.
    ab_a = -_dot(ab, a)
    ab_b = -_dot(ab, b)
    ab_c = -_dot(ab, c)
    ac_a = -_dot(ac, a)
    ac_b = -_dot(ac, b)
    ac_c = -_dot(ac, c)
    if ab_a <= 0.0 and ac_a <= 0.0:
        return 1.0, 0.0, 0.0
    if ab_b >= 0.0 and ac_b <= ab_b:
        return 0.0, 1.0, 0.0
    if ac_c >= 0.0 and ab_c <= ac_c:
        return 0.0, 0.0, 1.0
    # Areas of the triangles of the origin's projection with each edge, times a common factor.
    area_c = ab_a * ac_b - ab_b * ac_a
    area_b = ab_c * ac_a - ab_a * ac_c
    area_a = ab_b * ac_c - ab_c * ac_b
    if area_c <= 0.0 and ab_a >= 0.0 and ab_b <= 0.0:
        share = ab_a / (ab_a - ab_b)
        return 1.0 - share, share, 0.0
    if area_b <= 0.0 and ac_a >= 0.0 and ac_c <= 0.0:
        share = ac_a / (ac_a - ac_c)
        return 1.0 - share, 0.0, share
    if area_a <= 0.0 and ac_b >= ab_b and ab_c >= ac_c:
        share = (ac_b - ab_b) / (ac_b - ab_b + ab_c - ac_c)
        return 0.0, 1.0 - share, share
    return 1.0 - (area_b + area_c) / area, area_b / area, area_c / area


@compiled(nogil=True, inline="always", error_model="numpy")
def _shares_of_line(a, b, c):  # type: ignore[no-untyped-def]
    """The same of three corners on one line: of the two that are farthest apart alone."""
    ab = _minus(b, a)
    ac = _minus(c, a)
    bc = _minus(c, b)
    square_ab = _dot(ab, ab)
    square_ac = _dot(ac, ac)
    square_bc = _dot(bc, bc)
    if square_ab >= max(square_ac, square_bc):
        share = _share(a, ab, square_ab)
        return 1.0 - share, share, 0.0
    if square_ac >= square_bc:
        share = _share(a, ac, square_ac)
        return 1.0 - share, 0.0, share
    share = _share(b, bc, square_bc)
    return 0.0, 1.0 - share, share


@compiled(nogil=True, inline="always", error_model="numpy")
def _share(a, edge, square):  # type: ignore[no-untyped-def]
    """How far along an edge from a its point nearest to the origin lies, as a share of it.

    Args:
        a: The edge's first corner [m].
        edge: From there to the second [m].
        square: Its squared length [m²].
    """
    return min(max(-_dot(a, edge) / square, 0.0), 1.0) if square > 0.0 else 0.0


@compiled(nogil=True, inline="always", error_model="numpy")
def _hidden(a, b, c, d):  # type: ignore[no-untyped-def]
    """Whether the origin lies on the side of the face a, b, c on which d lies."""
    normal = _cross(_minus(b, a), _minus(c, a))
    return -_dot(normal, _minus(d, a)) * _dot(normal, a) > 0.0
