"""Tables and keys of a scene file, each with its meaning: the reader refuses others, the reference is made of them."""

from __future__ import annotations

# Table -> key -> what it says; units stand in the names. "" is the top of the file.
KEYS: dict[str, dict[str, str]] = {
    "": {
        "robot": 'Needed. URDF path (from the file on) or name: "tm5-900", "panda".',
        "task": "Needed. What the arm is to do.",
        "limits": "Limits other than the robot's.",
        "obstacle": "A list, [[obstacle]]: shapes in the base frame.",
        "attached": "A list, [[attached]]: shapes that the arm carries; keys of an obstacle, and link, touches.",
        "floor": "A floor.",
        "payload": "Mass that the arm carries.",
        "tool": "What the tool has to keep on its way.",
        "pass": "A list, [[pass]]: via points that must be passed, in this order.",
        "srdf": "File that names pairs of links to leave out of checks.",
        "trial": "A list, [[trial]]: taught motions with name, via_points_deg and times_s.",
    },
    "task": {
        "start_deg": "Needed. Angles at the start [deg], one a moving joint: as many joints move.",
        "goal_deg": "Angles at the end [deg]; needed unless goals_deg or goal_pose is given.",
        "goals_deg": "Rows of such angles, any of which will do [deg].",
        "goal_pose": "Where a frame is to end: a table with xyz_m, rpy_rad or quaternion_xyzw, frame (the last link); "
        "or several, [[task.goal_pose]], any of which will do.",
        "duration_s": "Duration [s]; needed for least energy, left out for least time.",
        "via_points": "Via points, at least. If left out: 2.",
        "wrist_deg": "Angles of the joints that stand still [deg]. If left out: zeros.",
        "clearance_m": "Distance to keep from everything [m]. If left out: 0.005.",
        "reach_deg": "How far a via angle may go from the initial one [deg]. If left out: 90.",
        "avoid_singular": "true: singular positions are fined. If left out: false.",
        "via_points_deg": "Via points to begin from, rows of angles [deg].",
        "times_s": "Their time stamps [s].",
    },
    "limits": {
        "lower_deg": "Least angle of each joint [deg], inside the robot's.",
        "upper_deg": "Largest angle of each joint [deg], inside the robot's.",
        "torque_Nm": "Largest torque of each joint [N m]. If left out: the robot's.",
        "speed_deg_s": "Largest speed of each joint [deg/s]. If left out: the robot's.",
        "acceleration_deg_s2": "Largest acceleration of each joint [deg/s²]. If left out: the maker's, where known.",
        "jerk_deg_s3": "Largest jerk of each joint [deg/s³]. If left out: the maker's, where known.",
        "makers": "false: the maker's published limits are not kept. If left out: true.",
    },
    "tool": {
        "frame": "The tool's frame. If left out: the arm's tip.",
        "speed_m_s": "Largest speed of its origin [m/s].",
        "straight": "true: it goes in a straight line; with six moving joints or more it turns evenly on the way.",
        "within_m": "How far it may be off that line [m]. If left out: 0.001.",
        "within_deg": "How far it may be off that turn [deg]. If left out: 0.5.",
        "cone": "A list, [[tool.cone]]: where its axes may point.",
    },
    "tool.cone": {
        "axis": "Axis of the tool's frame. If left out: [0, 0, 1].",
        "towards": "A direction in the base frame. If left out: [0, 0, -1].",
        "allowed_deg": "The axis stays within this angle of it [deg]; this or keep_out_deg is needed.",
        "keep_out_deg": "The axis stays outside this angle of it [deg].",
    },
    "pass": {
        "deg": "Angles of the moving joints [deg]; these or xyz_m are needed.",
        "within_deg": "How far each joint may be off when it passes [deg]. If left out: 0.1.",
        "xyz_m": "Place of the tool in the base frame [m].",
        "within_m": "How far each coordinate may be off when it passes [m]. If left out: 0.001.",
    },
    "floor": {"height_m": "Its height above the base [m]. If left out: 0."},
    "payload": {
        "mass_kg": "Needed. Mass [kg].",
        "com_m": "Its centre in the frame of link [m]. If left out: the frame's origin.",
        "link": "That frame. If left out: the arm's tip.",
    },
}
