"""One joint's Kalman filter and its Rauch-Tung-Striebel smoother, compiled.

State x = (q, dq, ddq). Between samples Δt apart

    x⁺ = F x + w,  F = [[1, Δt, Δt²/2], [0, 1, Δt], [0, 0, 1]],
    cov w = s [[Δt⁵/20, Δt⁴/8, Δt³/6], [Δt⁴/8, Δt³/3, Δt²/2], [Δt³/6, Δt²/2, Δt]],

and z = H x + v = q + v with var v = r; K = P Hᵀ / S is the gain, S = P₀₀ + r the innovation's
variance. Covariances P are computed only until they settle where the sampling is regular, and
sample by sample where it is not. They are six numbers each, written out: a small matrix would cost
many times as much as its products.

The smoother goes backwards by adjoints: with λ = 0 behind the last sample, each state becomes
x̂ = x − P λ, and a sample before it

    λ⁻ = Fᵀ ((I − K H)ᵀ λ − Hᵀ e / S),    Λ⁻ = Fᵀ ((I − K H)ᵀ Λ (I − K H) + Hᵀ H / S) F,

e the innovation and Λ the covariance of λ, of which the smoothed covariance is P − P Λ P. It
inverts nothing, and needs no smoothed covariance but the one that is asked for.

Source: Rauch, Tung and Striebel 1965; Bar-Shalom, Li and Kirubarajan 2001, section 6.2.3
(white-jerk model); Bryson and Frazier 1963 (smoothing by adjoints).
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled

# Covariances have settled when a step changes them by less than this share. Rounding keeps some
# from ever coming closer than 1e-15; what is left after 1e-13 moves no state by 1e-9.
SETTLED = 1e-13
# On so many first samples the smoother's start, which is wide against all that is measured, is
# still felt.
ANCHORED = 8

Covariance = tuple[float, float, float, float, float, float]
"""The numbers of a symmetric P = [[a, b, c], [b, d, e], [c, e, f]]."""
Vector = tuple[float, float, float]


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
def _row(history: Float[Array, "T 7"], k: int) -> Covariance:
    """A filtered covariance as `filter_joint` kept it."""
    return (
        history[k, 0],
        history[k, 1],
        history[k, 2],
        history[k, 3],
        history[k, 4],
        history[k, 5],
    )


@compiled(error_model="numpy", nogil=True)
def _keep(history: Float[Array, "T 7"], k: int, p: Covariance) -> None:
    """Writes a filtered covariance into the first six numbers of a row of the history."""
    history[k, 0] = p[0]
    history[k, 1] = p[1]
    history[k, 2] = p[2]
    history[k, 3] = p[3]
    history[k, 4] = p[4]
    history[k, 5] = p[5]


@compiled(error_model="numpy", nogil=True)
def _times(p: Covariance, v: Vector) -> Vector:
    """P v."""
    a, b, c, d, e, f = p
    return (
        a * v[0] + b * v[1] + c * v[2],
        b * v[0] + d * v[1] + e * v[2],
        c * v[0] + e * v[1] + f * v[2],
    )


@compiled(error_model="numpy", nogil=True)
def _product(v: Vector, w: Vector) -> float:
    """vᵀ w."""
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]


@compiled(error_model="numpy", nogil=True)
def _smoothed_variances(p: Covariance, information: Covariance) -> Vector:
    """Diagonal of P − P Λ P."""
    a, b, c, d, e, f = p
    first = (a, b, c)
    second = (b, d, e)
    third = (c, e, f)
    return (
        a - _product(first, _times(information, first)),
        d - _product(second, _times(information, second)),
        f - _product(third, _times(information, third)),
    )


@compiled(error_model="numpy", nogil=True)
def _adjoint_of_change(p: Covariance, y: Vector) -> Vector:
    """λ = −P⁻¹ y by P = L D Lᵀ, L with a unit diagonal."""
    a, b, c, d, e, f = p
    l10 = b / a
    l20 = c / a
    d1 = d - l10 * b
    l21 = (e - l20 * b) / d1
    d2 = f - l20 * c - l21 * l21 * d1
    y1 = y[1] - l10 * y[0]
    x2 = (y[2] - l20 * y[0] - l21 * y1) / d2
    x1 = y1 / d1 - l21 * x2
    return l10 * x1 + l20 * x2 - y[0] / a, -x1, -x2


@compiled(error_model="numpy", nogil=True)
def _adjoint_before_step(adjoint: Vector, h: float) -> Vector:
    """Fᵀ λ, a step of h seconds back."""
    g = 0.5 * h * h
    l0, l1, l2 = adjoint
    return l0, l1 + h * l0, l2 + (g * l0 + h * l1)


@compiled(error_model="numpy", nogil=True)
def _information_before(
    information: Covariance, rest: Vector, weight: float, h: float
) -> Covariance:
    """Λ before a sample and the step that leads to it.

    Args:
        information: Λ behind the sample.
        rest: 1 − K₀, K₁ and K₂ of the sample's gain.
        weight: 1 / S, S the innovation's variance.
        h: Length of the step [s].
    """
    m00, m01, m02, m11, m12, m22 = information
    r0, k1, k2 = rest
    # (I − K H)ᵀ Λ (I − K H) + Hᵀ H / S
    w1 = k1 * m11 + k2 * m12
    w2 = k1 * m12 + k2 * m22
    m00 = r0 * (r0 * m00 - 2 * (k1 * m01 + k2 * m02)) + k1 * w1 + k2 * w2 + weight
    m01 = r0 * m01 - w1
    m02 = r0 * m02 - w2
    # Fᵀ Λ F
    g = 0.5 * h * h
    return (
        m00,
        m01 + h * m00,
        m02 + h * m01 + g * m00,
        m11 + 2 * h * m01 + h * h * m00,
        m12 + h * m02 + h * m11 + (h * h + g) * m01 + g * h * m00,
        m22 + (2 * h * m12 + 2 * g * m02 + h * h * m11 + 2 * g * h * m01 + g * g * m00),
    )


@compiled(error_model="numpy", nogil=True)
def filter_joint(
    z: Float[Array, " T"],
    dt: Float[Array, " T-1"],
    noise: Float[Array, " 5"],
    states: Float[Array, "T 3"],
    history: Float[Array, "T 7"],
    sums: Float[Array, " 6"],
) -> None:
    """Filtered states of one joint in one run, and what its likelihood is made of.

    Args:
        z: Measured positions [rad].
        dt: Sampling intervals [s].
        noise: s [rad²/s⁵] and r [rad²], standard deviations of the first velocity [rad/s] and
            acceleration [rad/s²], and 1 where the sampling is regular, else 0.
        states: Gets the filtered states.
        history: Gets the six numbers of each covariance and 1 / S until they settle.
        sums: To its first two the logarithms of innovation variances and the squares of normalised
            innovations are added; the third becomes the number of rows of the history.
    """
    s = noise[0]
    r = noise[1]
    regular = noise[4] > 0.0
    p = (r, 0.0, 0.0, noise[2] * noise[2], 0.0, noise[3] * noise[3])
    filtered = 1
    settled = False
    variance = 1.0
    k0 = 0.0
    k1 = 0.0
    k2 = 0.0
    _keep(history, 0, p)
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
            _keep(history, k, p)
            history[k, 6] = 1.0 / variance
            filtered = k + 1
            settled = regular and _settled(p, before)
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
    z: Float[Array, " T"],
    dt: Float[Array, " T-1"],
    noise: Float[Array, " 5"],
    states: Float[Array, "T 3"],
    history: Float[Array, "T 7"],
    sums: Float[Array, " 6"],
) -> None:
    """Makes filtered states smoothed ones, in place, from the last to the first.

    Λ is carried to the middle of the run only, where the variances are asked for.

    Args:
        z, dt, noise, history: As `filter_joint` takes and leaves them.
        states: Filtered states; they become smoothed ones.
        sums: As `filter_joint` leaves them; the last three become the variances of position
            [rad²], velocity and acceleration in the middle of the run.
    """
    samples = len(z)
    middle = samples // 2
    s = noise[0]
    r = noise[1]
    last = int(sums[2]) - 1
    adjoint = (0.0, 0.0, 0.0)
    information = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(samples - 1, -1, -1):
        p = _row(history, min(k, last))
        if k == middle:
            variances = _smoothed_variances(p, information)
            sums[3] = variances[0]
            sums[4] = variances[1]
            sums[5] = variances[2]
        if k < samples - 1:
            change = _times(p, adjoint)
            states[k, 0] -= change[0]
            states[k, 1] -= change[1]
            states[k, 2] -= change[2]
        if k == 0:
            break
        h = dt[k - 1]
        g = 0.5 * h * h
        position = states[k - 1, 0] + h * states[k - 1, 1] + g * states[k - 1, 2]
        velocity = states[k - 1, 1] + h * states[k - 1, 2]
        weight = history[min(k, last), 6]
        # 1 − K₀ is r / S: the difference would lose all its digits on a run's first samples.
        r0 = r * weight
        k1 = p[1] / r
        k2 = p[2] / r
        if k > ANCHORED:
            innovation = z[k] - position
            l0, l1, l2 = adjoint
            adjoint = (r0 * l0 - k1 * l1 - k2 * l2 - innovation * weight, l1, l2)
        else:
            # The same from what smoothing changed, −(F P Fᵀ + Q)⁻¹ (x̂ − F x): a wide first P times
            # a small λ loses digits that this keeps.
            ahead = _predict(_row(history, min(k - 1, last)), h, s)
            acceleration = states[k - 1, 2]
            change = (
                states[k, 0] - position,
                states[k, 1] - velocity,
                states[k, 2] - acceleration,
            )
            adjoint = _adjoint_of_change(ahead, change)
        adjoint = _adjoint_before_step(adjoint, h)
        if k > middle:
            information = _information_before(information, (r0, k1, k2), weight, h)
