"""The shipped URDF says what is published of the TM5-900, to the last digit that is published."""

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf

# Vendor's DH table (classic): offset of θ [deg], α [deg], a [m], d [m].
DH = (
    (0, -90, 0.0, 0.1452),
    (-90, 0, 0.429, 0.0),
    (0, 0, 0.4115, 0.0),
    (90, 90, 0.0, -0.1223),
    (0, 90, 0.0, 0.106),
    (0, 0, 0.0, 0.11315),
)
POSITION_LIMITS_DEG = (270, 180, 155, 180, 180, 270)
VELOCITY_LIMITS_DEG = (180, 180, 180, 225, 225, 225)
EFFORT_LIMITS = (157, 157, 157, 43, 43, 43)
GEAR_RATIOS = (100, 100, 100, 80, 80, 80)
# Recommended set: mass [kg], centre of mass [m], xx xy xz yy yz zz about it [kg m²], links 1 to 6.
INERTIALS = np.fromstring(
    """
4.032 0.0    -0.00484  0.00192 0.0119696631 -1.3257185e-05 -4.976894e-07 0.0115493998  1.5684e-08    0.0088001191
8.897 0.2145  0.0     -0.1451  0.024459      0.0            0.0          0.355         0.0           0.348
2.443 0.304   0.0     -0.0197  0.0036349728 -0.0003364099   8.7e-10      0.0609980271 -1.483504e-07  0.060500000044
1.576 0.0    -0.00638  0.00709 0.0025637446 -7.272469e-06  -2.13948e-08  0.0026425443  2.337788e-07  0.0020584051
1.576 0.0    -0.00638 -0.00709 0.0025637446  7.272469e-06   2.13948e-08  0.0026425443  2.337788e-07  0.0020584051
0.65  0.0     0.03885 -0.01936 0.0014897527  8.594908e-05  -1.576286e-06 0.0014535245 -4.385241e-06  0.0007745738
""",
    sep=" ",
).reshape(6, 10)
# Collision boxes: extents and centre in the link frame [m], links 0 to 6.
BOXES = (
    ((0.17681, 0.17682, 0.066), (0.0, 0.0, 0.033)),
    ((0.128, 0.139, 0.15), (0.0, -0.0055, 0.004)),
    ((0.557, 0.128, 0.15), (0.2145, 0.0, -0.15)),
    ((0.5235, 0.128, 0.1182), (0.19775, 0.0, -0.0159)),
    ((0.096, 0.113, 0.1005), (0.0, 0.003, 0.00225)),
    ((0.09059, 0.1176, 0.09449), (0.0, 0.0003, -0.00245)),
    ((0.08668, 0.14819, 0.11661), (0.0, 0.03076, -0.00605)),
)


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("tm5-900")


def _dh_pose(q: np.ndarray) -> np.ndarray:
    """Flange pose by the vendor's DH table."""
    pose = np.eye(4)
    for angle, (offset, alpha, a, d) in zip(q, DH, strict=True):
        theta, twist = angle + np.deg2rad(offset), np.deg2rad(alpha)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(twist), np.sin(twist)
        pose = pose @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    return pose


def test_the_flange_stands_where_the_vendor_says(arm: ArmModel) -> None:
    """Home pose (0, -0.23545, 1.0917) m; at random postures the DH table's pose to 1e-12."""
    home = arm.forward_kinematics(np.zeros(6))["flange"]
    assert np.allclose(home[:3, 3], (0.0, -0.23545, 1.0917), atol=1e-12)
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 6)):
        assert np.allclose(arm.forward_kinematics(q)["flange"], _dh_pose(q), atol=1e-12)


def test_limits_are_the_published_ones(arm: ArmModel) -> None:
    """Positions, velocities and torques; joint 3 is the one with ± 155°."""
    assert np.allclose(np.rad2deg(arm.upper), POSITION_LIMITS_DEG, atol=1e-9)
    assert np.allclose(np.rad2deg(arm.lower), -np.array(POSITION_LIMITS_DEG), atol=1e-9)
    assert np.allclose(np.rad2deg(arm.velocity_limit), VELOCITY_LIMITS_DEG, atol=1e-9)
    assert np.array_equal(arm.effort_limit, EFFORT_LIMITS)
    assert arm.joint_names == tuple(f"joint_{i}" for i in range(1, 7))


def test_masses_and_moments_are_the_recommended_set(arm: ArmModel) -> None:
    """Each link's mass, centre of mass and moments about it, which a body could have; 19.174 kg, base not counted."""
    assert INERTIALS[:, 0].sum() == pytest.approx(19.174)
    for i, (mass, x, y, z, xx, xy, xz, yy, yz, zz) in enumerate(INERTIALS, start=1):
        body = arm.model.inertias[i]
        assert body.mass == pytest.approx(mass)
        assert np.allclose(body.lever, (x, y, z), atol=1e-12)
        assert np.allclose(body.inertia, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], atol=2e-10)
        small, middle, large = np.linalg.eigvalsh(body.inertia)
        assert 0.0 < small <= large < small + middle


def test_every_link_has_its_box_and_no_mesh(arm: ArmModel) -> None:
    """Collision geometry is one box a link, base included, at the published place."""
    shapes = {item.name.rsplit("_", 1)[0]: item for item in arm.geometry.geometryObjects}
    poses = arm.forward_kinematics(np.zeros(6))
    data, placed = arm.model.createData(), arm.geometry.createData()
    pin.updateGeometryPlacements(arm.model, data, arm.geometry, placed, np.zeros(6))
    assert len(shapes) == 7
    for i, (extents, centre) in enumerate(BOXES):
        item = shapes[f"link_{i}"]
        index = arm.geometry.getGeometryId(item.name)
        assert np.allclose(2 * np.array(item.geometry.halfSide), extents)
        assert np.allclose(poses[f"link_{i}"] @ [*centre, 1.0], [*placed.oMg[index].translation, 1.0], atol=1e-12)
    assert "mesh" not in arm.urdf


def test_gear_ratios_are_told(arm: ArmModel) -> None:
    """100 on joints 1 to 3, 80 on 4 to 6; an arm without transmissions has none."""
    ratios = arm.gear_ratios
    assert ratios is not None
    assert np.array_equal(ratios, GEAR_RATIOS)
    assert ArmModel.load("panda").gear_ratios is None


def test_each_moving_link_carries_the_source_of_its_figures() -> None:
    """A comment stands before every link that moves, and the doubtful figures are called doubtful."""
    text = find_urdf("tm5-900").read_text(encoding="utf-8")
    builder = ET.TreeBuilder(insert_comments=True)
    children = list(ET.fromstring(text, ET.XMLParser(target=builder)))
    for i in range(1, 7):
        at = next(k for k, item in enumerate(children) if item.tag == "link" and item.get("name") == f"link_{i}")
        comment = children[at - 1]
        assert comment.tag is ET.Comment
        assert "S1" in (comment.text or "")
        assert "DOUBTFUL" in (comment.text or "")
