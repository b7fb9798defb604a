"""Signed separation of two convex bodies, compiled.

By the separating axes of their boxes, near ones by simplexes.

Overlapping boxes: the largest gap over the 15 axes is minus the exact penetration depth. Apart: it
is a lower bound of the distance, refined by simplexes where the boxes are close enough to matter.
Round bodies are boxes, rods or points with a radius; hulls are corners, with a radius where some of
them were left out. Coal checks every returned plan; this loop is what the planners look at 10⁵
times.

Simplexes of the bodies' difference close in on the point nearest to the origin, and what is
returned is the gap between two planes that stand on the line to it, a lower bound that ends at the
distance. Overlapping: the best of some directions, improved a little; it is never above minus the
depth's true value. Vectors are tuples of three.

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
# Corners of a tetrahedron's faces, and the corner opposite to each.
FACES = ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1), (1, 2, 3, 0))
# Below this gap the bound for separated bodies is refined to the distance [m].
BAND = 0.05


@compiled(nogil=True)
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(nogil=True)
def _minus(a, b, share=1.0):  # type: ignore[no-untyped-def]
    """a − share · b."""
    return a[0] - share * b[0], a[1] - share * b[1], a[2] - share * b[2]


@compiled(nogil=True)
def _scaled(a, share):  # type: ignore[no-untyped-def]
    return share * a[0], share * a[1], share * a[2]


@compiled(nogil=True)
def _farthest(d, i, bodies):  # type: ignore[no-untyped-def]
    """The farthest point of a body's core along a direction of the base frame."""
    r = bodies.placed_rot[i]
    lx = r[0, 0] * d[0] + r[1, 0] * d[1] + r[2, 0] * d[2]
    ly = r[0, 1] * d[0] + r[1, 1] * d[1] + r[2, 1] * d[2]
    lz = r[0, 2] * d[0] + r[1, 2] * d[1] + r[2, 2] * d[2]
    if bodies.number[i] == 0:
        x = math.copysign(bodies.core[i, 0], lx)
        y = math.copysign(bodies.core[i, 1], ly)
        z = math.copysign(bodies.core[i, 2], lz)
    else:
        chosen = bodies.first[i]
        best = -1e300
        for m in range(bodies.first[i], bodies.first[i] + bodies.number[i]):
            along = (
                bodies.corners[m, 0] * lx + bodies.corners[m, 1] * ly + bodies.corners[m, 2] * lz
            )
            if along > best:
                best = along
                chosen = m
        x = bodies.corners[chosen, 0]
        y = bodies.corners[chosen, 1]
        z = bodies.corners[chosen, 2]
    return (
        bodies.placed_at[i, 0] + r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        bodies.placed_at[i, 1] + r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        bodies.placed_at[i, 2] + r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@compiled(nogil=True)
def _difference(d, i, j, bodies):  # type: ignore[no-untyped-def]
    """The nearest point of the cores' difference along a direction from j to i."""
    return _minus(_farthest((-d[0], -d[1], -d[2]), i, bodies), _farthest(d, j, bodies))


@compiled(nogil=True)
def simplex_gap(i, j, bodies, enough, warm):  # type: ignore[no-untyped-def]
    """Signed separation of two bodies' cores, their radii left out [m].

    Args:
        i, j: Numbers of the bodies.
        bodies: See `compiled.CompiledBodies`, in their places.
        enough: A gap that is known to be larger than this need not be known closer [m].
        warm: A direction to start from, if not zero: the one in which the bodies were seen last
            time. It is replaced.
    """
    simplex = np.empty((4, 3))
    count = 0
    x = (warm[0], warm[1], warm[2])
    if x[0] == 0.0 and x[1] == 0.0 and x[2] == 0.0:
        x = _minus(bodies.placed_at[i], bodies.placed_at[j])
    length = math.sqrt(_dot(x, x))
    if length < 1e-12:
        x = (0.0, 0.0, 1.0)
        length = 1.0
    kept = _scaled(x, 1.0 / length)
    best = -1e300
    for _ in range(ROUNDS):
        d = _scaled(x, 1.0 / length)
        w = _difference(d, i, j, bodies)
        gap = _dot(w, d)
        if gap > best:
            best = gap
            kept = d
        if best > enough or (count > 0 and length - best < EXACT):
            break
        known = False
        for m in range(count):
            known = (
                known
                or abs(simplex[m, 0] - w[0]) + abs(simplex[m, 1] - w[1]) + abs(simplex[m, 2] - w[2])
                < 1e-12
            )
        if known:
            break
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = w
        count, x = _nearest(simplex, count + 1)
        length = math.sqrt(_dot(x, x))
        if count == 4 or length < 1e-10:
            break
    warm[0], warm[1], warm[2] = kept
    return best if best > min(enough, 0.0) else _deepest(kept, i, j, bodies)


@compiled(nogil=True)
def _deepest(first, i, j, bodies):  # type: ignore[no-untyped-def]
    """The largest gap (the least depth) among some directions, the best improved step by step."""
    chosen = first
    point = first
    best = -1e300
    away = _minus(bodies.placed_at[i], bodies.placed_at[j])
    rot = bodies.placed_rot
    for k in range(7):
        d = first
        if k < 6:
            body = i if k < 3 else j
            d = (rot[body, 0, k % 3], rot[body, 1, k % 3], rot[body, 2, k % 3])
            if _dot(d, away) < 0.0:
                d = _scaled(d, -1.0)
        w = _difference(d, i, j, bodies)
        if _dot(w, d) > best:
            best = _dot(w, d)
            chosen = d
            point = w
    step = TURN
    for _ in range(TURNS):
        side = _minus(point, chosen, best)
        length = math.sqrt(_dot(side, side))
        if length < 1e-12:
            break
        d = _minus(_scaled(chosen, math.cos(step)), side, -math.sin(step) / length)
        w = _difference(d, i, j, bodies)
        if _dot(w, d) > best:
            best = _dot(w, d)
            chosen = d
            point = w
        else:
            step *= 0.4
    return best


@compiled(nogil=True)
def _nearest(p, count):  # type: ignore[no-untyped-def]
    """The corners that carry a simplex's point nearest to the origin: their number, and the point.

    They come first in p, an array of shape (4, 3), the others are overwritten. A simplex of fewer
    than three corners is a triangle in which the last corner stands more than once. The number is 4
    where the origin lies inside a tetrahedron.
    """
    least = 1e300
    nearest = (0.0, 0.0, 0.0)
    carried = FACES[0]
    shares = (0.0, 0.0, 0.0)
    last = count - 1
    for number in range(4 if count == 4 else 1):
        face = FACES[number]
        a = p[face[0]]
        b = p[min(face[1], last)]
        c = p[min(face[2], last)]
        if count == 4 and _hidden(a, b, c, p[face[3]]):
            continue
        u, v, w = _shares(a, b, c)
        x = (
            u * a[0] + v * b[0] + w * c[0],
            u * a[1] + v * b[1] + w * c[1],
            u * a[2] + v * b[2] + w * c[2],
        )
        if _dot(x, x) < least:
            least = _dot(x, x)
            nearest = x
            carried = face
            shares = (u, v, w)
    if least == 1e300:
        return 4, nearest
    kept = 0
    for k in range(3):
        if shares[k] > 0.0:
            # Never before its own place: faces name their corners in order.
            for m in range(3):
                p[kept, m] = p[carried[k], m]
            kept += 1
    return kept, nearest


@compiled(nogil=True)
def _shares(a, b, c):  # type: ignore[no-untyped-def]
    """Shares of a triangle's corners in its point nearest to the origin.

    A corner, on an edge, or inside.
    """
    ab = _minus(b, a)
    ac = _minus(c, a)
    square_b = _dot(ab, ab)
    square_c = _dot(ac, ac)
    area = square_b * square_c - _dot(ab, ac) ** 2
    if area <= 1e-14 * square_b * square_c:  # a line: of its ends alone
        bc = _minus(c, b)
        square = _dot(bc, bc)
        if square_b >= max(square_c, square):
            share = _share(a, ab, square_b)
            return 1.0 - share, share, 0.0
        if square_c >= square:
            share = _share(a, ac, square_c)
            return 1.0 - share, 0.0, share
        share = _share(b, bc, square)
        return 0.0, 1.0 - share, share
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
    w = ab_a * ac_b - ab_b * ac_a
    v = ab_c * ac_a - ab_a * ac_c
    u = ab_b * ac_c - ab_c * ac_b
    if w <= 0.0 and ab_a >= 0.0 and ab_b <= 0.0:
        share = ab_a / (ab_a - ab_b)
        return 1.0 - share, share, 0.0
    if v <= 0.0 and ac_a >= 0.0 and ac_c <= 0.0:
        share = ac_a / (ac_a - ac_c)
        return 1.0 - share, 0.0, share
    if u <= 0.0 and ac_b >= ab_b and ab_c >= ac_c:
        share = (ac_b - ab_b) / (ac_b - ab_b + ab_c - ac_c)
        return 0.0, 1.0 - share, share
    return 1.0 - (v + w) / area, v / area, w / area


@compiled(nogil=True)
def _share(a, edge, square):  # type: ignore[no-untyped-def]
    """How far along an edge from a its point nearest to the origin lies, as a share of it."""
    return min(max(-_dot(a, edge) / square, 0.0), 1.0) if square > 0.0 else 0.0


@compiled(nogil=True)
def _hidden(a, b, c, d):  # type: ignore[no-untyped-def]
    """Whether the origin lies on the side of the face a, b, c on which d lies."""
    u = _minus(b, a)
    v = _minus(c, a)
    normal = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    return -_dot(normal, _minus(d, a)) * _dot(normal, a) > 0.0


@compiled(fastmath=True, nogil=True)
def box_gap(ra, ta, ha, rb, tb, hb):  # type: ignore[no-untyped-def]
    """Signed separation of two boxes [m]: rotation, centre and half lengths of each, in one frame.

    Exact where they overlap, a lower bound where they are apart.

    Args:
        ra: Axes of the first box (3, 3), in columns.
        ta: Its centre (3,) [m].
        ha: Its half edge lengths (3,) [m].
        rb: Axes of the second box.
        tb: Its centre.
        hb: Its half edge lengths.
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
        gap = (
            abs(along) - hb[i] - ha[0] * abs(c[0, i]) - ha[1] * abs(c[1, i]) - ha[2] * abs(c[2, i])
        )
        best = max(best, gap)
    for i in range(3):
        i1 = (i + 1) % 3
        i2 = (i + 2) % 3
        for j in range(3):
            square = 1.0 - c[i, j] * c[i, j]
            if square < 1e-10:  # parallel edges: their normal is a face normal, done above
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


@compiled(fastmath=True, nogil=True, inline="always")
def ball_gap(i, j, bodies):  # type: ignore[no-untyped-def]
    """Gap of the balls round two bodies [m]; negative where they overlap.

    Args:
        i: Number of the one body.
        j: Number of the other.
        bodies: All bodies, placed by `place_bodies`.
    """
    apart = 0.0
    for k in range(3):
        apart += (bodies.placed_at[i, k] - bodies.placed_at[j, k]) ** 2
    return math.sqrt(apart) - bodies.ball[i] - bodies.ball[j]


@compiled(fastmath=True, nogil=True)
def body_gap(i, j, bodies, warm, enough, band=BAND):  # type: ignore[no-untyped-def]
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
    rot = bodies.placed_rot
    at = bodies.placed_at
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


@compiled(fastmath=True, nogil=True)
def shape_gap(i, j, bodies, warm, enough, band=BAND):  # type: ignore[no-untyped-def]
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
    if bodies.parts[i] + bodies.parts[j] == 0 or gap > min(enough, band):
        return gap
    first, last = (
        (bodies.part[i], bodies.part[i] + bodies.parts[i]) if bodies.parts[i] > 0 else (i, i + 1)
    )
    begin, end = (
        (bodies.part[j], bodies.part[j] + bodies.parts[j]) if bodies.parts[j] > 0 else (j, j + 1)
    )
    least = 1e9
    seen = np.empty(3)
    for a in range(first, last):
        for b in range(begin, end):
            seen[:] = warm
            least = min(least, body_gap(a, b, bodies, seen, min(enough, least), band))
    return max(gap, least)
