"""Equations A8 to A10 of the paper as they are printed, errors and all.

Capital I where lower-case l is meant (I₂², I₃ a₂, …) is read as l: it has no other reading. Each error that changes
a number is a switch, so that its effect can be measured by itself.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.robot.lumped import LumpedParameters

GRAVITY = 9.81
# Names as in the errata: entry of A2 and A8 to A10.
ERRORS = ("sign_of_L", "M33", "C21", "G2", "C32")


def printed_torque(
    p: LumpedParameters,
    q: Float[Array, "T 3"],
    dq: Float[Array, "T 3"],
    ddq: Float[Array, "T 3"],
    errors: tuple[str, ...] = ERRORS,
) -> Float[Array, "T 3"]:
    """M(θ) ddθ + C(θ, dθ) dθ + G(θ) with the chosen misprints in, the others mended [N m]."""
    assert set(errors) <= set(ERRORS)
    _, t2, t3 = q.T
    (v1, v2, v3), (w1, w2, w3) = dq.T, ddq.T
    s2, c2, s3, c3 = np.sin(t2), np.cos(t2), np.sin(t3), np.cos(t3)
    s23, c23 = np.sin(t2 + t3), np.cos(t2 + t3)
    a2, a3, l2, l3, m2, m3, m4 = p.a2, p.a3, p.l2, p.l3, p.m2, p.m3, p.m4

    m11 = p.I1y + p.I2x * c2**2 + p.I2y * s2**2 + p.I3x * c23**2 + p.I3y * s23**2
    m11 = m11 + l2**2 * s2**2 * m2 + a2**2 * s2**2 * m3 + a2**2 * s2**2 * m4 + l3**2 * s23**2 * m3
    m11 = m11 + a3**2 * s23**2 * m4 + 2 * l3 * a2 * s2 * s23 * m3 + 2 * a3 * a2 * s2 * s23 * m4
    m22 = p.I2z + p.I3z + m2 * l2**2 + m3 * l3**2 + m4 * a3**2 + m3 * a2**2 + m4 * a2**2
    m22 = m22 + 2 * a2 * a3 * c3 * m4 + 2 * l3 * a2 * c3 * m3
    m23 = p.I3z + m3 * l3**2 + m4 * a3**2 + a2 * a3 * c3 * m4 + l3 * a2 * c3 * m3
    m33 = m23 if "M33" in errors else p.I3z + m3 * l3**2 + m4 * a3**2

    fore = (-p.I3x + p.I3y + l3**2 * m3 + a3**2 * m4) * c23 * s23
    upper = (l2**2 * m2 + a2**2 * m3 + a2**2 * m4) * c2 * s2
    mixed = (l3 * m3 + a3 * m4) * a2
    c12 = 2 * v1 * (fore - p.I2x * c2 * s2 + p.I2y * c2 * s2 + upper + mixed * (c2 * s23 + s2 * c23))
    c13 = 2 * v1 * (fore + mixed * s2 * c23)
    first = -p.I2x * c2 * s2 if "C21" in errors else p.I2x * c2 * s2
    c21 = v1 * (first - p.I2y * c2 * s2 - fore - upper - mixed * (c2 * s23 + s2 * c23))
    c22, c23_entry = -2 * v3 * mixed * s3, -v3 * mixed * s3
    c31 = -v1 * (fore + mixed * s2 * c23)
    c32 = (t2 if "C32" in errors else v2) * mixed * s3

    last = a3 if "G2" in errors else a2
    g2 = -GRAVITY * (l3 * s23 * m3 + a3 * s23 * m4 + l2 * s2 * m2 + a2 * s2 * m3 + last * s2 * m4)
    g3 = -GRAVITY * (l3 * s23 * m3 + a3 * s23 * m4)
    sign = -1.0 if "sign_of_L" in errors else 1.0  # (A2) has L = T + V, by which gravity changes its sign
    return np.stack(
        [
            m11 * w1 + c12 * v2 + c13 * v3,
            m22 * w2 + m23 * w3 + c21 * v1 + c22 * v2 + c23_entry * v3 + sign * g2,
            m23 * w2 + m33 * w3 + c31 * v1 + c32 * v2 + sign * g3,
        ],
        axis=-1,
    )


def closed_form_torque(
    p: LumpedParameters, q: Float[Array, "T 3"], dq: Float[Array, "T 3"], ddq: Float[Array, "T 3"]
) -> Float[Array, "T 3"]:
    """The equations with all errors mended, at an arm's joint angles: θ = sign · q + offset [N m]."""
    sign = np.asarray(p.sign)
    return sign * printed_torque(p, sign * q + np.asarray(p.offset), sign * dq, sign * ddq, errors=())
