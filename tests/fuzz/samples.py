"""Small good files, as text."""

import re

SESSION_TOML = """robot = "tm5-900"
sample_rate_hz = 50.0
[payload]
mass_kg = 1.0
com_m = [0, 0, 0.1]
[effort_sign]
joint_1 = -1
[drive_gain_Nm_per_A]
joint_2 = 12.5
[columns]
1 = "time"
"""
SCENE = """robot = "tm5-900"
[task]
start_deg = [50, 0, -120]
goal_deg = [80, 30, -90]
duration_s = 0.65
via_points = 2
wrist_deg = [0, 0, 0]
clearance_m = 0.005
reach_deg = 60.0
[limits]
lower_deg = [-170, -90, -150]
upper_deg = [170, 90, 150]
torque_Nm = [150.0, 150.0, 80.0]
speed_deg_s = [120, 120, 120]
acceleration_deg_s2 = [900, 900, 900]
jerk_deg_s3 = [9000, 9000, 9000]
[floor]
height_m = -0.1
[payload]
mass_kg = 0.5
com_m = [0.0, 0.0, 0.05]
[[obstacle]]
name = "monitor"
size_m = [0.12, 0.12, 0.12]
xyz_m = [0.04, -0.47, 0.56]
rpy_rad = [0, 0, 0]
[[obstacle]]
shape = "capsule"
radius_m = 0.1
length_m = 0.3
xyz_m = [0.9, 0.9, 0.5]
[[obstacle]]
file = "cube.stl"
scale = 0.2
xyz_m = [-0.9, 0.9, 0.5]
[[attached]]
shape = "sphere"
radius_m = 0.03
xyz_m = [0, 0, 0.05]
touches = ["link_6"]
"""
CYCLE = """robot = "tm5-900"
srdf = "arm.srdf"
[task]
start_deg = [50, 0, -120, 0, 60, 0]
goal_pose = { xyz_m = [0.3, -0.3, 0.5], quaternion_xyzw = [0, 1, 0, 0], frame = "link_6" }
at_most_s = 4.0
standby_W = 20.0
via_points_deg = [[60, 5, -110, 0, 60, 0], [70, 10, -100, 0, 60, 0]]
times_s = [1.0, 2.0]
[limits]
makers = false
[tool]
frame = "link_6"
speed_m_s = 0.5
straight = true
within_m = 0.002
within_deg = 1.0
[[tool.cone]]
axis = [0, 0, 1]
towards = [0, 0, -1]
allowed_deg = 20.0
[[pass]]
xyz_m = [0.3, -0.2, 0.5]
within_m = 0.002
[[leg]]
deg = [65, 15, -105, 0, 60, 0]
dwell_s = 0.2
does = "grip"
[[leg]]
any_deg = [[65, 15, -105, 0, 60, 0], [60, 10, -105, 0, 60, 0]]
[payload]
mass_kg = 0.5
link = "link_6"
[[attached]]
shape = "box"
size_m = [0.02, 0.02, 0.02]
xyz_m = [0, 0, 0.05]
link = "link_6"
[[obstacle]]
cloud = "scan.pcd"
radius_m = 0.01
"""
# Settings that are applied to a recording.
APPLIED = """robot = "tm5-900"
effort_kind = "joint_torque"
angle_unit = "rad"
time_unit = "s"
gravity_mps2 = [0.0, 0.0, -9.81]
[payload]
mass_kg = 1.0
com_m = [0, 0, 0.1]
[effort_sign]
joint_1 = -1
[direction]
joint_3 = -1
[zero_rad]
joint_4 = 0.1
[unit]
joint_5 = "deg"
"""
CALIBRATION = """{
  "joint_1": {"id": 1, "drive_mode": 0, "homing_offset": -14, "range_min": 1015, "range_max": 3128},
  "joint_2": {"id": 2, "drive_mode": 0, "homing_offset": 133, "range_min": 900, "range_max": 3100}
}
"""
LIMITS = """rung = "loss"
[torque_rmse_Nm]
total = 2.0
joint_1 = 3.5
[energy_error_J]
total = 5.0
"""
WORLD = """preset = "any"
rate_hz = [100, 500]
robot = ["tm5-900", "panda"]
encoder_noise_rad = 1e-5
"""
XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="links.xacro"/>
  <xacro:arg name="reach" default="0.4"/>
  <xacro:property name="reach" value="$(arg reach)"/>
  <xacro:property name="half" value="${reach / 2}"/>
  <xacro:property name="masses" value="${dict(upper=3.0, lower=2 ** 0.5)}"/>
  <link name="base"/>
  <xacro:segment name="upper" parent="base" mass="${masses['upper']}" z="${half + 0.1}"/>
  <xacro:segment name="lower" parent="upper" mass="${masses['lower']}" z="${round(sin(pi / 6) * reach, 4)}"/>
  <xacro:if value="${reach > 0.3}">
    <xacro:segment name="hand" parent="lower" mass="$(eval 1 + 1)" z="${max(half, 0.05)}"/>
  </xacro:if>
</robot>
"""
LINKS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="segment" params="name parent mass z:=0.2">
    <link name="${name}">
      <inertial>
        <origin xyz="0 0 ${z / 2}"/>
        <mass value="${mass}"/>
        <inertia ixx="${mass * z ** 2}" ixy="0" ixz="0" iyy="${mass * z ** 2}" iyz="0" izz="${mass * z ** 2}"/>
      </inertial>
    </link>
    <joint name="${name}_joint" type="revolute">
      <parent link="${parent}"/>
      <child link="${name}"/>
      <origin xyz="0 0 ${z}" rpy="${radians(90)} 0 0"/>
      <axis xyz="0 0 1"/>
      <limit lower="${-pi}" upper="${pi}" effort="100" velocity="3"/>
    </joint>
  </xacro:macro>
</robot>
"""
CUBE = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
FACES = ((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4))
FACES += ((1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7))
CATALOGUE = '''import numpy as np
from ident.effects.base import Effect


class Magnet(Effect):
    """A magnet."""

    id = "magnet"
    summary = "torque repeats three times a turn"

    def columns(self, session, joint, variant):
        return [np.sin(3 * run.motion.q[:, [joint]]) for run in session.runs]

    def parameters(self, session, joint, variant, coefficients, covariance):
        return {}
'''


def stl() -> str:
    lines = ["solid cube"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {} {} {}".format(*CUBE[k]) for k in face] + ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid cube\n"])


def ply() -> str:
    """The cube as a mesh in text."""
    head = ["ply", "format ascii 1.0", f"element vertex {len(CUBE)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"element face {len(FACES)}", "property list uchar int vertex_indices", "end_header"]
    corners = [f"{x} {y} {z}" for x, y, z in CUBE]
    return "\n".join([*head, *corners, *(f"3 {a} {b} {c}" for a, b, c in FACES), ""])


def obj() -> str:
    corners = [f"v {x} {y} {z}" for x, y, z in CUBE]
    return "\n".join([*corners, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES), ""])


DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="metre" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="cube"><mesh>
<source id="corners"><float_array id="numbers" count="24">{numbers}</float_array>
<technique_common><accessor source="#numbers" count="8" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<vertices id="vertices"><input semantic="POSITION" source="#corners"/></vertices>
{faces}
</mesh></geometry></library_geometries>
<library_nodes><node id="part"><instance_geometry url="#cube"/></node></library_nodes>
<library_visual_scenes><visual_scene id="scene">
<node id="base"><translate>0.5 0 0</translate><rotate>0 0 1 90</rotate><instance_node url="#part"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>
"""
TRIANGLES = """<triangles count="12"><input semantic="VERTEX" source="#vertices" offset="0"/>
<p>{places}</p></triangles>"""
POLYLIST = """<polylist count="12"><input semantic="VERTEX" source="#vertices" offset="0"/>
<vcount>{sides}</vcount><p>{places}</p></polylist>"""


def dae(faces: str = POLYLIST) -> str:
    """The cube as a COLLADA file: of triangles, or of polygons that are triangles."""
    numbers = " ".join(str(number) for corner in CUBE for number in corner)
    places = " ".join(str(place) for face in FACES for place in face)
    sides = " ".join(["3"] * len(FACES))
    return DAE.format(numbers=numbers, faces=faces.format(places=places, sides=sides))


def shaped(urdf: str, mesh: str) -> str:
    """A URDF whose first link has a mesh beside it as its shape, and no other link one."""
    urdf = re.sub(r"(?s)<(collision|visual)\b.*?</\1>", "", urdf)
    shape = f'<collision><geometry><mesh filename="{mesh}" scale="0.1 0.1 0.1"/></geometry></collision>'
    return urdf.replace("</link>", f"{shape}</link>", 1)
