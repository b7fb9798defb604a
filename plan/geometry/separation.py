"""Signed separation of boxes by the separating-axis theorem, compiled, and swept along whole trajectories.

Overlapping boxes: the largest gap over the 15 axes is minus the exact penetration depth. Apart: it is a lower
bound of the distance, which is refined by alternating projections where the boxes are close enough to matter.
Coal checks every returned plan; this loop is what the planners look at 10⁵ times.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ident.arrays import Array

# Below this gap the bound for separated boxes is refined to the distance [m].
BAND = 0.05
# Steps through a collision: a section's share at most, so that its depth is felt.
STEPS = 24
# Where a gap is at its margin, a step changes it by this at most [m].
FINE = 2e-3


@njit(cache=True, fastmath=True, nogil=True)
def box_gap(ra, ta, ha, rb, tb, hb):  # type: ignore[no-untyped-def]
    """Signed separation of two boxes [m]: rotation, centre and half lengths of each, in one frame."""
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
    if best <= 0.0 or best > BAND:
        return best
    return max(best, _projected_gap(c, t, ha, hb))


@njit(cache=True, fastmath=True, nogil=True)
def _projected_gap(c, t, ha, hb):  # type: ignore[no-untyped-def]
    """Gap along the line between nearest points, found by projecting from box to box; a lower bound at any step."""
    p, x, d = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        p[i] = min(max(t[i], -ha[i]), ha[i])
    length = 1e9
    for _ in range(40):
        for i in range(3):
            x[i] = t[i]
        for j in range(3):
            y = c[0, j] * (p[0] - t[0]) + c[1, j] * (p[1] - t[1]) + c[2, j] * (p[2] - t[2])
            y = min(max(y, -hb[j]), hb[j])
            for i in range(3):
                x[i] += c[i, j] * y
        total = 0.0
        for i in range(3):
            p[i] = min(max(x[i], -ha[i]), ha[i])
            d[i] = x[i] - p[i]
            total += d[i] * d[i]
        if total > length * (1.0 - 1e-9):
            break
        length = total
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    if length < 1e-12:
        return -1e9
    gap = 0.0
    for i in range(3):
        gap += (d[i] * t[i] - ha[i] * abs(d[i])) / length
    for j in range(3):
        gap -= hb[j] * abs(c[0, j] * d[0] + c[1, j] * d[1] + c[2, j] * d[2]) / length
    return gap


@njit(cache=True, fastmath=True, nogil=True)
def place_boxes(rot, off, axes, sliding, carrier, box_rot, box_at, q, frame_rot, frame_at, out_rot, out_at):  # type: ignore[no-untyped-def]
    """World placement of every box for one position q; frame arrays are scratch of n + 1 frames, 0 the world."""
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
    for b in range(carrier.shape[0]):
        f = carrier[b]
        for k in range(3):
            out_at[b, k] = frame_at[f, k]
            for m in range(3):
                out_at[b, k] += frame_rot[f, k, m] * box_at[b, m]
                out_rot[b, k, m] = (
                    frame_rot[f, k, 0] * box_rot[b, 0, m]
                    + frame_rot[f, k, 1] * box_rot[b, 1, m]
                    + frame_rot[f, k, 2] * box_rot[b, 2, m]
                )


@njit(cache=True, fastmath=True, nogil=True)
def gaps_of_states(rot, off, axes, sliding, carrier, box_rot, box_at, box_half, pairs, q):  # type: ignore[no-untyped-def]
    """Signed separation of every pair at every position, shape (T, P) [m]."""
    n, boxes = q.shape[1], carrier.shape[0]
    frame_rot, frame_at = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    at_rot, at = np.empty((boxes, 3, 3)), np.empty((boxes, 3))
    out = np.empty((q.shape[0], pairs.shape[0]))
    for t in range(q.shape[0]):
        place_boxes(rot, off, axes, sliding, carrier, box_rot, box_at, q[t], frame_rot, frame_at, at_rot, at)
        for p in range(pairs.shape[0]):
            a, b = pairs[p, 0], pairs[p, 1]
            out[t, p] = box_gap(at_rot[a], at[a], box_half[a], at_rot[b], at[b], box_half[b])
    return out


@njit(cache=True, fastmath=True, nogil=True)
def sweep(rot, off, axes, sliding, carrier, box_rot, box_at, box_half, pairs, levers, points, slopes, h, peaks, margin):  # type: ignore[no-untyped-def]
    """Smallest gap along each trajectory, skipping ahead as far as the gap and the top speed allow.

    Args:
        levers: Most that a pair's gap can change for a unit of each joint, shape (P, n) [m/rad].
        points, slopes: Knots of the splines and velocities there, shape (B, V + 2, n).
        h: Section durations, shape (B, V + 1) [s].
        peaks: Top speed in each section, shape (B, V + 1, n) [rad/s].
        margin: Gap that counts as violated below [m].

    Returns:
        Smallest gap seen [m] and the mean of max(margin − gap, 0) over time [m], shape (B, 2).
    """
    batch, sections, n = peaks.shape
    boxes, count = carrier.shape[0], pairs.shape[0]
    frame_rot, frame_at = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    at_rot, at = np.empty((boxes, 3, 3)), np.empty((boxes, 3))
    q, clear, rate = np.empty(n), np.empty(count), np.empty(count)
    out = np.empty((batch, 2))
    for b in range(batch):
        least, violation, total = 1e9, 0.0, 0.0
        for k in range(sections):
            duration = h[b, k]
            total += duration
            for p in range(count):
                clear[p], rate[p] = 0.0, 1e-9
                for j in range(n):
                    rate[p] += levers[p, j] * peaks[b, k, j]
            coarse, t = duration / STEPS, 0.0
            while True:
                s = t / duration
                for j in range(n):
                    q0, q1 = points[b, k, j], points[b, k + 1, j]
                    v0, v1 = slopes[b, k, j] * duration, slopes[b, k + 1, j] * duration
                    d = q1 - q0
                    q[j] = q0 + s * (v0 + s * (3.0 * d - 2.0 * v0 - v1 + s * (v0 + v1 - 2.0 * d)))
                place_boxes(rot, off, axes, sliding, carrier, box_rot, box_at, q, frame_rot, frame_at, at_rot, at)
                worst, ahead = 1e9, duration
                for p in range(count):
                    if clear[p] <= t:
                        i, j = pairs[p, 0], pairs[p, 1]
                        gap = box_gap(at_rot[i], at[i], box_half[i], at_rot[j], at[j], box_half[j])
                        worst = min(worst, gap)
                        # The gap reaches its margin no sooner than this, from either side.
                        ahead_p = max(abs(gap - margin), FINE) / rate[p]
                        clear[p] = t + (ahead_p if gap > margin else min(ahead_p, coarse))
                    ahead = min(ahead, clear[p])
                least = min(least, worst)
                step = ahead - t
                violation += max(margin - worst, 0.0) * step
                if t >= duration:
                    break
                t = min(t + step, duration)
        out[b, 0], out[b, 1] = least, violation / total
    return out


def signed_separation(first: tuple[Array, Array, Array], second: tuple[Array, Array, Array]) -> float:
    """Signed separation of two boxes given as (rotation, centre, half lengths) [m]."""
    return float(box_gap(*(np.ascontiguousarray(part, dtype=float) for part in (*first, *second))))
