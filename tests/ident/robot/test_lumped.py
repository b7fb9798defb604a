"""Laws of the paper's three-joint model."""

import numpy as np
import pytest

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.robot.lumped import LumpedParameters, build_lumped_arm, lumped_parameters
from tests.ident.made_up import joint, link, random_states, urdf

# Set R in the paper's names, published with its derivation.
NAMES = ("m2", "m3", "m4", "a2", "a3", "d1", "l2", "l3", "I1y", "I2x", "I2y", "I2z", "I3x", "I3y", "I3z")
MASSES_LENGTHS = (8.897, 2.443, 3.802, 0.429, 0.4115, 0.1452, 0.2145, 0.304)
MOMENTS = (0.0088001191, 0.024459, 0.355, 0.348, 0.0036349728, 0.0609980271, 0.060500000044)
SET_R = dict(zip(NAMES, MASSES_LENGTHS + MOMENTS, strict=True))


GRAVITY = 9.81


def closed_form_torque(
    p: LumpedParameters, q: Float[Array, "T 3"], dq: Float[Array, "T 3"], ddq: Float[Array, "T 3"]
) -> Float[Array, "T 3"]:
    """M(θ) ddθ + C(θ, dθ) dθ + G(θ) of the paper's equations A8 to A10, their five misprints mended [N m]."""
    sign = np.asarray(p.sign)
    _, t2, t3 = (sign * q + np.asarray(p.offset)).T
    (v1, v2, v3), (w1, w2, w3) = (sign * dq).T, (sign * ddq).T
    s2, c2, s3, c3 = np.sin(t2), np.cos(t2), np.sin(t3), np.cos(t3)
    s23, c23 = np.sin(t2 + t3), np.cos(t2 + t3)
    a2, a3, l2, l3, m2, m3, m4 = p.a2, p.a3, p.l2, p.l3, p.m2, p.m3, p.m4

    m11 = p.I1y + p.I2x * c2**2 + p.I2y * s2**2 + p.I3x * c23**2 + p.I3y * s23**2
    m11 = m11 + l2**2 * s2**2 * m2 + a2**2 * s2**2 * m3 + a2**2 * s2**2 * m4 + l3**2 * s23**2 * m3
    m11 = m11 + a3**2 * s23**2 * m4 + 2 * l3 * a2 * s2 * s23 * m3 + 2 * a3 * a2 * s2 * s23 * m4
    m22 = p.I2z + p.I3z + m2 * l2**2 + m3 * l3**2 + m4 * a3**2 + m3 * a2**2 + m4 * a2**2
    m22 = m22 + 2 * a2 * a3 * c3 * m4 + 2 * l3 * a2 * c3 * m3
    m23 = p.I3z + m3 * l3**2 + m4 * a3**2 + a2 * a3 * c3 * m4 + l3 * a2 * c3 * m3
    m33 = p.I3z + m3 * l3**2 + m4 * a3**2

    fore = (-p.I3x + p.I3y + l3**2 * m3 + a3**2 * m4) * c23 * s23
    upper = (l2**2 * m2 + a2**2 * m3 + a2**2 * m4) * c2 * s2
    mixed = (l3 * m3 + a3 * m4) * a2
    c12 = 2 * v1 * (fore - p.I2x * c2 * s2 + p.I2y * c2 * s2 + upper + mixed * (c2 * s23 + s2 * c23))
    c13 = 2 * v1 * (fore + mixed * s2 * c23)
    c21 = v1 * (p.I2x * c2 * s2 - p.I2y * c2 * s2 - fore - upper - mixed * (c2 * s23 + s2 * c23))
    c22, c23_entry = -2 * v3 * mixed * s3, -v3 * mixed * s3
    c31 = -v1 * (fore + mixed * s2 * c23)
    c32 = v2 * mixed * s3

    g2 = -GRAVITY * (l3 * s23 * m3 + a3 * s23 * m4 + l2 * s2 * m2 + a2 * s2 * m3 + a2 * s2 * m4)
    g3 = -GRAVITY * (l3 * s23 * m3 + a3 * s23 * m4)
    torque = np.stack(
        [
            m11 * w1 + c12 * v2 + c13 * v3,
            m22 * w2 + m23 * w3 + c21 * v1 + c22 * v2 + c23_entry * v3 + g2,
            m23 * w2 + m33 * w3 + c31 * v1 + c32 * v2 + g3,
        ],
        axis=-1,
    )
    return sign * torque


@pytest.fixture(scope="module")
def figures(arm: ArmModel) -> LumpedParameters:
    return lumped_parameters(arm)


@pytest.fixture(scope="module")
def states() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """10,000 states, |dq| ≤ π rad/s, |ddq| ≤ 10 rad/s²."""
    return random_states(np.random.default_rng(11), 10_000, 3)


def test_figures_are_those_of_the_urdf(figures: LumpedParameters) -> None:
    """The projection of the URDF gives set R, and the paper's angles are the joint angles."""
    for name, value in SET_R.items():
        assert getattr(figures, name) == pytest.approx(value, abs=1e-9)
    assert figures.sign == (1, 1, 1)
    assert np.allclose(figures.offset, 0.0, atol=1e-12)


def test_closed_form_equals_pinocchio(arm: ArmModel, figures: LumpedParameters, states: tuple) -> None:
    """With the five errors mended the printed terms are the lumped arm's torque to 1e-10 N m on 10,000 states:

    there is no sixth.
    """
    lumped = build_lumped_arm(arm)
    assert lumped.joint_names == arm.joint_names[:3]
    assert np.allclose(closed_form_torque(figures, *states), lumped.inverse_dynamics(*states), rtol=0, atol=1e-10)


@pytest.mark.parametrize("robot", ["ur10", "ur3", "kinova"])
def test_other_arms_of_the_kind_are_lumped_too(robot: str) -> None:
    """Arms whose zero lies elsewhere: closed form = Pinocchio lumped to 1e-10 of 100 N m, offsets and signs found."""
    other = ArmModel.load(robot)
    states = random_states(np.random.default_rng(13), 500, 3)
    closed = closed_form_torque(lumped_parameters(other), *states)
    lumped = build_lumped_arm(other)
    assert np.allclose(closed, lumped.inverse_dynamics(*states), rtol=0, atol=1e-8)
    # A lumped arm is near the real one: gravity within a fifth of its size, so the zero is right.
    whole = np.hstack([states[0], np.zeros((500, other.n - 3))])
    gravity = other.gravity(whole)[:, :3]
    assert np.abs(lumped.gravity(states[0]) - gravity).max() < 0.2 * np.abs(gravity).max()


def test_an_arm_of_another_kind_is_refused() -> None:
    """Joints 1 to 3 must be vertical, horizontal, parallel; and there must be a wrist."""
    for arm in (ArmModel.load("panda"), ArmModel.load("xarm7")):
        with pytest.raises(RobotError, match=r"not vertical, horizontal, parallel.*--links 6"):
            lumped_parameters(arm)
    short = ArmModel.from_urdf(urdf(link("a"), link("b"), link("c"), joint("1", "a", "b"), joint("2", "b", "c")))
    with pytest.raises(RobotError, match="it has 2 joints"):
        build_lumped_arm(short)


def mass_matrix_row(arm: ArmModel, q: np.ndarray, joint: int) -> np.ndarray:
    """Torques that accelerate one joint by 1 rad/s² from rest, gravity taken off [kg m²]."""
    unit = np.zeros_like(q)
    unit[:, joint] = 1.0
    return arm.inverse_dynamics(q, np.zeros_like(q), unit) - arm.gravity(q)


@pytest.mark.parametrize(
    ("pose", "exact", "lumped"), [((50, 0, -120), 1.19, 0.73), ((80, 30, -90), 0.71, 0.35)], ids=["start", "end"]
)
def test_m11_at_the_papers_task(arm: ArmModel, pose: tuple[int, ...], exact: float, lumped: float) -> None:
    """Erratum 18: M11 at start and end of the paper's task, exact against lumped."""
    q = np.deg2rad([pose])
    frozen = arm.locked(arm.joint_names[3:])
    assert mass_matrix_row(frozen, q, 0)[0, 0] == pytest.approx(exact, abs=0.01)
    assert mass_matrix_row(build_lumped_arm(arm), q, 0)[0, 0] == pytest.approx(lumped, abs=0.01)


def test_where_lumping_breaks(arm: ArmModel) -> None:
    """Over joints 2 and 3 within limits and the vendor's wrist postures (set R) the lumped model is off by 2.5 to 2.7 N
    m in gravity, a factor of 7.8 to 8.6 in M11 (arm upright, where lumped M11 is 0.037 kg m²), and it lacks an M12 of
    up to 0.79 and an M13 of up to 0.27 kg m².
    """
    two, three = np.meshgrid(np.arange(-180, 181, 5.0), np.arange(-155, 156, 5.0))
    q = np.deg2rad(np.stack([np.zeros(two.size), two.ravel(), three.ravel()], axis=1))
    lumped, rows = build_lumped_arm(arm), []
    for wrist in ((0, 0, 0), (0, 90, 0), (-90, 90, 0), (90, -90, 0)):  # joints 4 to 6 [deg]
        exact = arm.locked(arm.joint_names[3:], np.deg2rad(wrist))
        first, gravity = mass_matrix_row(exact, q, 0), np.abs(exact.gravity(q) - lumped.gravity(q)).max()
        ratio = first[:, 0] / mass_matrix_row(lumped, q, 0)[:, 0]
        rows.append((gravity, ratio.max(), *np.abs(first[:, 1:]).max(axis=0)))
        assert abs(np.sin(q[np.argmax(ratio), 1])) < 0.1
    off = np.abs(np.max(rows, axis=0) - [2.645, 8.56, 0.795, 0.272])
    assert np.all(off < [0.01, 0.05, 0.01, 0.01])
    assert min(gravity for gravity, *_ in rows) == pytest.approx(2.551, abs=0.01)
    assert rows[1][1] == pytest.approx(7.898, abs=0.01)
