"""One joint's Kalman filter and its Rauch-Tung-Striebel smoother, compiled.

State x = (q, dq, ddq). Between samples Δt apart

    x⁺ = F x + w,  F = [[1, Δt, Δt²/2], [0, 1, Δt], [0, 0, 1]],
    cov w = s [[Δt⁵/20, Δt⁴/8, Δt³/6], [Δt⁴/8, Δt³/3, Δt²/2], [Δt³/6, Δt²/2, Δt]],

and z = q + v with var v = r. Covariances are computed only until they settle where the sampling is
regular, and sample by sample where it is not. They are six numbers each, written out: a small
matrix would cost many times as much as its products.

Source: Rauch, Tung and Striebel 1965; Bar-Shalom, Li and Kirubarajan 2001, section 6.2.3
(white-jerk model); Bryson and Frazier 1963 (smoothing by adjoints).
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array
from ident.compiled import compiled

# Covariances have settled when a step changes them by less than this share. Rounding keeps some
# from ever coming closer than 1e-15; what is left after 1e-13 moves no state by 1e-9.
SETTLED = 1e-13
# On so many first samples the smoother's start, which is wide against all that is measured, is
# still felt.
ANCHORED = 8

Covariance = tuple[float, float, float, float, float, float]
"""The numbers of a symmetric P = [[a, b, c], [b, d, e], [c, e, f]]."""


@compiled(error_model="numpy", nogil=True)
def _predict(p: Covariance, h: float, s: float) -> Covariance:
    """F P Fᵀ + Q, a step of h seconds on."""
    a, b, c, d, e, f = p
    g = 0.5 * h * h
    top = a + h * b + g * c
    right = b + h * d + g * e
    corner = c + h * e + g * f
    return (
        top + h * right + g * corner + s * h**5 / 20,
        right + h * corner + s * h**4 / 8,
        corner + s * h**3 / 6,
        d + h * e + h * (e + h * f) + s * h**3 / 3,
        e + h * f + s * h**2 / 2,
        f + s * h,
    )


@compiled(error_model="numpy", nogil=True)
def _update(p: Covariance, r: float) -> Covariance:
    """The covariance after a measured position, (I − K H) P (I − K H)ᵀ + K r Kᵀ (Joseph's form)."""
    a, b, c, d, e, f = p
    v = a + r
    k0 = a / v
    k1 = b / v
    k2 = c / v
    return (
        a * (r / v) ** 2 + k0 * k0 * r,
        b - k1 * a - k0 * b + k0 * k1 * v,
        c - k2 * a - k0 * c + k0 * k2 * v,
        d - 2 * k1 * b + k1 * k1 * v,
        e - k1 * c - k2 * b + k1 * k2 * v,
        f - 2 * k2 * c + k2 * k2 * v,
    )


@compiled(error_model="numpy", nogil=True)
def _settled(new: Covariance, old: Covariance) -> bool:
    """Whether a step changed no entry by more than a share of the product of its two deviations."""
    a, b, c, d, e, f = new
    oa, ob, oc, od, oe, of = old
    return bool(
        abs(a - oa) <= SETTLED * np.sqrt(a * a)
        and abs(b - ob) <= SETTLED * np.sqrt(a * d)
        and abs(c - oc) <= SETTLED * np.sqrt(a * f)
        and abs(d - od) <= SETTLED * np.sqrt(d * d)
        and abs(e - oe) <= SETTLED * np.sqrt(d * f)
        and abs(f - of) <= SETTLED * np.sqrt(f * f)
    )


@compiled(error_model="numpy", nogil=True)
def filter_joint(
    z: Array, dt: Array, noise: Array, states: Array, history: Array, sums: Array
) -> None:
    """Filtered states of one joint in one run, and what its likelihood is made of.

    Args:
        z: Measured positions, shape (T,) [rad].
        dt: Sampling intervals, (T - 1,) [s].
        noise: s, r, deviations of the first velocity and acceleration, and whether the sampling is
            regular, (5,).
        states: Gets the filtered states, (T, 3).
        history: Gets the six numbers of each covariance and 1 / S until they settle, (T, 7).
        sums: To its first two the logarithms of innovation variances and the squares of normalised
            innovations are added; the third becomes the number of rows of the history, (6,).
    """
    s = noise[0]
    r = noise[1]
    p = (r, 0.0, 0.0, noise[2] * noise[2], 0.0, noise[3] * noise[3])
    filtered = 1
    settled = False
    variance = 1.0
    k0 = 0.0
    k1 = 0.0
    k2 = 0.0
    history[0, 0], history[0, 1], history[0, 2], history[0, 3], history[0, 4], history[0, 5] = p
    x0 = z[0]
    x1 = 0.0
    x2 = 0.0
    states[0, 0] = x0
    states[0, 1] = x1
    states[0, 2] = x2
    for k in range(1, len(z)):
        h = dt[k - 1]
        if not settled:
            ahead = _predict(p, h, s)
            before = p
            variance = ahead[0] + r
            k0 = ahead[0] / variance
            k1 = ahead[1] / variance
            k2 = ahead[2] / variance
            p = _update(ahead, r)
            (
                history[k, 0],
                history[k, 1],
                history[k, 2],
                history[k, 3],
                history[k, 4],
                history[k, 5],
            ) = p
            history[k, 6] = 1.0 / variance
            filtered = k + 1
            settled = noise[4] > 0.0 and _settled(p, before)
        x0 += h * x1 + 0.5 * h * h * x2
        x1 += h * x2
        innovation = z[k] - x0
        sums[0] += np.log(variance)
        sums[1] += innovation * innovation / variance
        x0 = x0 + k0 * innovation
        x1 = x1 + k1 * innovation
        x2 = x2 + k2 * innovation
        states[k, 0] = x0
        states[k, 1] = x1
        states[k, 2] = x2
    sums[2] = filtered


@compiled(error_model="numpy", nogil=True)
def smooth_joint(
    z: Array, dt: Array, noise: Array, states: Array, history: Array, sums: Array
) -> None:
    """Makes filtered states smoothed ones, in place.

    Backwards by adjoints (Bryson and Frazier): x̂ = x − P λ with λ⁻ = Fᵀ ((I − K H)ᵀ λ − Hᵀ e / S),
    which inverts nothing and needs no smoothed covariance; Λ, that of λ, is carried to the middle
    only. λ is l0 to l2, Λ is m00 to m22.

    Args:
        z, dt, noise, states, history: As `filter_joint` leaves them.
        sums: Its last three become the variances in the middle of the run.
    """
    samples = len(z)
    s = noise[0]
    r = noise[1]
    filtered = int(sums[2])
    l0 = 0.0
    l1 = 0.0
    l2 = 0.0
    m00 = 0.0
    m01 = 0.0
    m02 = 0.0
    m11 = 0.0
    m12 = 0.0
    m22 = 0.0
    for k in range(samples - 1, -1, -1):
        i = min(k, filtered - 1)
        a = history[i, 0]
        b = history[i, 1]
        c = history[i, 2]
        d = history[i, 3]
        e = history[i, 4]
        f = history[i, 5]
        if k == samples // 2:
            w0 = m00 * a + m01 * b + m02 * c
            w1 = m01 * a + m11 * b + m12 * c
            w2 = m02 * a + m12 * b + m22 * c
            sums[3] = a - (a * w0 + b * w1 + c * w2)
            w0 = m00 * b + m01 * d + m02 * e
            w1 = m01 * b + m11 * d + m12 * e
            w2 = m02 * b + m12 * d + m22 * e
            sums[4] = d - (b * w0 + d * w1 + e * w2)
            w0 = m00 * c + m01 * e + m02 * f
            w1 = m01 * c + m11 * e + m12 * f
            w2 = m02 * c + m12 * e + m22 * f
            sums[5] = f - (c * w0 + e * w1 + f * w2)
        if k < samples - 1:
            states[k, 0] -= a * l0 + b * l1 + c * l2
            states[k, 1] -= b * l0 + d * l1 + e * l2
            states[k, 2] -= c * l0 + e * l1 + f * l2
        if k == 0:
            break
        h = dt[k - 1]
        g = 0.5 * h * h
        # 1 − K₀ is r / S: the difference would lose all its digits on a run's first samples.
        weight = history[i, 6]
        k0 = r * weight
        k1 = b / r
        k2 = c / r
        innovation = z[k] - (states[k - 1, 0] + h * states[k - 1, 1] + g * states[k - 1, 2])
        l0 = k0 * l0 - k1 * l1 - k2 * l2 - innovation * weight
        if k <= ANCHORED:
            # The same from what smoothing changed: λ⁻ = −(F P Fᵀ + Q)⁻¹ (x̂ − F x). A wide first P
            # times a small λ loses digits that this keeps.
            i = min(k - 1, filtered - 1)
            p = (
                history[i, 0],
                history[i, 1],
                history[i, 2],
                history[i, 3],
                history[i, 4],
                history[i, 5],
            )
            pa, pb, pc, pd, pe, pf = _predict(p, h, s)
            x1 = states[k - 1, 1] + h * states[k - 1, 2]
            x0 = states[k - 1, 0] + h * states[k - 1, 1] + g * states[k - 1, 2]
            y0 = states[k, 0] - x0
            y1 = states[k, 1] - x1
            y2 = states[k, 2] - states[k - 1, 2]
            f10 = pb / pa
            f20 = pc / pa
            d1 = pd - f10 * pb
            f21 = (pe - f20 * pb) / d1
            d2 = pf - f20 * pc - f21 * f21 * d1
            y1 -= f10 * y0
            y2 = (y2 - f20 * y0 - f21 * y1) / d2
            y1 = y1 / d1 - f21 * y2
            l0 = f10 * y1 + f20 * y2 - y0 / pa
            l1 = -y1
            l2 = -y2
        l2 += g * l0 + h * l1
        l1 += h * l0
        if k > samples // 2:
            # (I − K H)ᵀ Λ (I − K H) + Hᵀ H / S, then Fᵀ Λ F.
            w1 = k1 * m11 + k2 * m12
            w2 = k1 * m12 + k2 * m22
            m00 = k0 * (k0 * m00 - 2 * (k1 * m01 + k2 * m02)) + k1 * w1 + k2 * w2 + weight
            m01 = k0 * m01 - w1
            m02 = k0 * m02 - w2
            n00 = m00
            n01 = m01 + h * m00
            n02 = m02 + h * m01 + g * m00
            n11 = m11 + 2 * h * m01 + h * h * m00
            n12 = m12 + h * m02 + h * m11 + (h * h + g) * m01 + g * h * m00
            m22 += 2 * h * m12 + 2 * g * m02 + h * h * m11 + 2 * g * h * m01 + g * g * m00
            m00 = n00
            m01 = n01
            m02 = n02
            m11 = n11
            m12 = n12
