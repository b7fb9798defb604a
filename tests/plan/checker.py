"""A second opinion on plans: reads what is on disk (plan, scene, model, URDF) and shares no code with `plan`.

Kinematics and dynamics are written out anew from the URDF's XML and the model's figures, the net from its weights'
bytes, energy by Simpson's rule, and shapes collide by Coal on the URDF's own geometry (meshes, not their hulls).
"""

from __future__ import annotations

import copy
import json
import struct
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from scipy.special import expit

# Samples of a motion for torque and energy (even number of steps), and for collisions.
FINE, COARSE = 20_000, 600
# Rounding that is let pass, as a share of a limit.
ROUNDING = 1e-6
# What a proven clearance may fall short of what was asked for, and rounding [m].
SHORT = 5e-4 + 1e-6
# How closely energy must agree: the plan's own quadrature and Simpson's rule both stumble where friction turns.
ENERGY = 2e-3


def turn(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations about a unit axis by T angles (Rodrigues), shape (T, 3, 3)."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * k + (1 - c) * (k @ k)


def place(element: ET.Element | None) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift of an <origin>."""
    if element is None:
        return np.eye(3), np.zeros(3)
    roll, pitch, yaw = (float(v) for v in element.get("rpy", "0 0 0").split())
    parts = [turn(axis, np.array([angle]))[0] for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True)]
    return parts[2] @ parts[1] @ parts[0], np.array([float(v) for v in element.get("xyz", "0 0 0").split()])


@dataclass
class Arm:
    """A chain of revolute joints with ten inertial numbers each, about the joint's own frame."""

    rotations: list[np.ndarray]
    shifts: list[np.ndarray]
    axes: list[np.ndarray]
    inertias: np.ndarray

    @classmethod
    def read(cls, urdf: str, joints: list[str], inertias: np.ndarray) -> Arm:
        root = ET.fromstring(urdf)
        parents = {j.find("child").get("link"): j for j in root.findall("joint")}  # type: ignore[union-attr]
        named = {j.get("name"): j for j in root.findall("joint")}
        rotations, shifts, axes = [], [], []
        for k, name in enumerate(joints):
            before = named[joints[k - 1]].find("child").get("link") if k else None  # type: ignore[union-attr]
            joint, rotation, shift = named[name], np.eye(3), np.zeros(3)
            axis = joint.find("axis")
            axes.append(np.array([float(v) for v in axis.get("xyz").split()]) if axis is not None else np.eye(3)[0])  # type: ignore[union-attr]
            while True:
                r, p = place(joint.find("origin"))
                rotation, shift = r @ rotation, p + r @ shift
                link = joint.find("parent").get("link")  # type: ignore[union-attr]
                if link == before or link not in parents:
                    break
                joint = parents[link]
                assert joint.get("type") == "fixed", joint.get("name")
            rotations.append(rotation)
            shifts.append(shift)
        return cls(rotations, shifts, axes, inertias)

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Newton and Euler's equations in each link's own axes, T states at a time."""
        steps, n = q.shape
        w, dw, a = np.zeros((steps, 3)), np.zeros((steps, 3)), np.tile([0.0, 0.0, 9.81], (steps, 1))
        turns, forces, moments = [], [], []
        for j in range(n):
            into = np.einsum("ab,tbc->tac", self.rotations[j], turn(self.axes[j], q[:, j])).transpose(0, 2, 1)
            p, z = self.shifts[j], self.axes[j]
            at = a + np.cross(dw, p) + np.cross(w, np.cross(w, p))
            before = np.einsum("tab,tb->ta", into, w)
            a, w = np.einsum("tab,tb->ta", into, at), before + dq[:, j, None] * z
            dw = np.einsum("tab,tb->ta", into, dw) + np.cross(before, dq[:, j, None] * z) + ddq[:, j, None] * z
            m, mc = self.inertias[j, 0], self.inertias[j, 1:4]
            xx, xy, yy, xz, yz, zz = self.inertias[j, 4:]
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            forces.append(m * a + np.cross(dw, mc) + np.cross(w, np.cross(w, mc)))
            moments.append(dw @ inertia + np.cross(w, w @ inertia) + np.cross(mc, a))
            turns.append(into)
        out, f, tau = np.empty((steps, n)), np.zeros((steps, 3)), np.zeros((steps, 3))
        for j in reversed(range(n)):
            if j + 1 < n:
                back = turns[j + 1].transpose(0, 2, 1)
                f, tau = np.einsum("tab,tb->ta", back, f), np.einsum("tab,tb->ta", back, tau)
                tau = tau + np.cross(self.shifts[j + 1], f)
            f, tau = f + forces[j], tau + moments[j]
            out[:, j] = tau @ self.axes[j]
        return out


class Net:
    """The default residual net, from its bytes: a small perceptron for each joint, SiLU inside."""

    def __init__(self, folder: Path) -> None:
        record = json.loads((folder / "residual.json").read_text())
        self.mean, self.std = np.array(record["input_mean"]), np.array(record["input_std"])
        self.scale = np.array(record["output_std"])
        # Beyond what the net was fitted on it is asked at the edge.
        self.edge = [np.array(record["bounds"][side]) for side in ("low", "high")]
        raw = (folder / "residual.safetensors").read_bytes()
        size = struct.unpack("<Q", raw[:8])[0]
        self.parts = {}
        for name, part in json.loads(raw[8 : 8 + size]).items():
            if name != "__metadata__":
                begin, end = (8 + size + offset for offset in part["data_offsets"])
                self.parts[name] = np.frombuffer(raw[begin:end], "<f4").reshape(part["shape"]).astype(float)

    def torque(self, dq: np.ndarray, ddq: np.ndarray, load: np.ndarray) -> np.ndarray:
        low, high = self.edge
        dq, ddq, load = (np.clip(part, low[k], high[k]) for k, part in enumerate((dq, ddq, load)))
        steep = np.tanh(dq / 0.02)
        features = [dq, ddq, steep, np.tanh(dq / 0.15), load, np.sqrt(load**2 + 0.25) * steep]
        x = (np.stack(features, axis=2) - self.mean) / self.std
        total = np.zeros(dq.shape)
        for k in range(dq.shape[1]):
            y = x[:, k] @ self.parts["weights.0"][k] + self.parts["biases.0"][k]
            total[:, k] = (y * expit(y) @ self.parts["weights.1"][k] + self.parts["biases.1"][k])[:, 0]
        return total * self.scale


class Model:
    """Torque of a model folder."""

    def __init__(self, folder: Path) -> None:
        record = tomllib.loads((folder / "model.toml").read_text())
        self.joints = record["robot"]["joints"]
        numbers = np.array(list(record["inertia"]["links"].values()))
        self.arm = Arm.read((folder / "arm.urdf").read_text(), self.joints, numbers)
        self.loss = {k: np.array(v) for k, v in record["loss"].items() if k != "figures"}
        self.net = Net(folder) if (folder / "residual.json").exists() else None

    def carrying(self, payload: dict[str, Any], world: World, tip: str) -> Model:
        """The same with a mass whose centre is given in a frame of the URDF, the tip's where none is named."""
        frame = world.model.frames[world.model.getFrameId(payload.get("link", tip))]
        at = frame.placement.act(np.array(payload.get("com_m", [0.0, 0.0, 0.0]), dtype=float))
        inertia = payload["mass_kg"] * (at @ at * np.eye(3) - np.outer(at, at))
        numbers, row = self.arm.inertias.copy(), self.joints.index(world.model.names[frame.parentJoint])
        numbers[row] += [payload["mass_kg"], *(payload["mass_kg"] * at), *inertia[np.tril_indices(3)]]
        loaded = copy.copy(self)
        loaded.arm = replace(self.arm, inertias=numbers)
        return loaded

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        rigid, loss = self.arm.torque(q, dq, ddq), self.loss
        width = loss["transition_speed_rad_s"]
        slip = np.where(width > 0, np.tanh(dq / np.where(width > 0, width, 1.0)), np.sign(dq))
        total = rigid + loss["motor_inertia"] * ddq + loss["viscous"] * dq + loss["coulomb"] * slip + loss["offset"]
        return total if self.net is None else total + self.net.torque(dq, ddq, rigid)


class Scan:
    """Balls about the points of a `.npy` file, looked at one by one near a link."""

    def __init__(self, path: Path, radius: float, turn: np.ndarray, shift: np.ndarray) -> None:
        self.points, self.ball = np.load(path) @ turn.T + shift, coal.Sphere(radius)
        self.tree, self.radius = cKDTree(self.points), radius

    def hits(self, shape: Any, pose: Any, request: Any) -> bool:
        middle, reach = pose.transform(shape.aabb_center), shape.aabb_radius + self.radius + request.security_margin
        for k in self.tree.query_ball_point(np.asarray(middle).ravel(), reach):
            at = coal.Transform3s(np.eye(3), self.points[k])
            if coal.collide(shape, pose, self.ball, at, request, coal.CollisionResult()):
                return True
        return False


class Crate:
    """A box; far ones are passed over by the balls round both."""

    def __init__(self, size: list[float], turn: np.ndarray, shift: np.ndarray) -> None:
        self.box, self.pose = coal.Box(*size), coal.Transform3s(turn, shift)
        self.middle, self.radius = shift, float(np.linalg.norm(size)) / 2

    def hits(self, shape: Any, pose: Any, request: Any) -> bool:
        reach = self.radius + shape.aabb_radius + request.security_margin
        if np.linalg.norm(np.asarray(pose.transform(shape.aabb_center)).ravel() - self.middle) > reach:
            return False
        return bool(coal.collide(shape, pose, self.box, self.pose, request, coal.CollisionResult()))


class Facets:
    """The triangles of a mesh's file, as Coal's own loader reads it."""

    def __init__(self, path: Path, turn: np.ndarray, shift: np.ndarray) -> None:
        self.mesh = coal.MeshLoader().load(str(path), np.ones(3))
        self.pose = coal.Transform3s(turn, shift)

    def hits(self, shape: Any, pose: Any, request: Any) -> bool:
        return bool(coal.collide(shape, pose, self.mesh, self.pose, request, coal.CollisionResult()))


class World:
    """Coal on the URDF's own geometry and the scene's boxes and clouds, and boxes that are carried.

    What is carried names its link, or hangs on the frame given as the arm's tip.
    """

    def __init__(
        self, urdf: Path, packages: list[str], scene: dict[str, Any], folder: Path = Path(), tip: str = ""
    ) -> None:
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.shapes = pin.buildGeomFromUrdf(self.model, str(urdf), pin.GeometryType.COLLISION, package_dirs=packages)
        self.data = self.model.createData()
        self.carried = {entry["name"] for entry in scene.get("attached", [])}
        for entry in scene.get("attached", []):
            number = self.model.getFrameId(entry.get("link", tip))
            r, _ = place(ET.Element("origin", rpy=" ".join(map(str, entry.get("rpy_rad", [0, 0, 0])))))
            at = self.model.frames[number].placement * pin.SE3(r, np.array(entry["xyz_m"], dtype=float))
            joint, box = self.model.frames[number].parentJoint, coal.Box(*entry["size_m"])
            self.shapes.addGeometryObject(pin.GeometryObject(entry["name"], joint, number, at, box))
        self.things: list[tuple[str, Crate | Scan | Facets]] = []
        for one in self.shapes.geometryObjects:
            one.geometry.computeLocalAABB()
        for entry in scene.get("obstacle", []):
            r, _ = place(ET.Element("origin", rpy=" ".join(map(str, entry.get("rpy_rad", [0, 0, 0])))))
            at = r, np.array(entry.get("xyz_m", [0, 0, 0]), dtype=float)
            if "cloud" in entry:
                self.things.append((entry["name"], Scan(folder / entry["cloud"], entry["radius_m"], *at)))
            elif "file" in entry:
                self.things.append((entry["name"], Facets(folder / entry["file"], *at)))
            else:
                self.things.append((entry["name"], Crate(entry["size_m"], *at)))

    def near(
        self,
        named: dict[str, float],
        q: np.ndarray,
        left_out: set[frozenset[str]],
        margin: float,
        kept: dict[frozenset[str], float] | None = None,
    ) -> list[str]:
        """Pairs that come nearer than a margin somewhere along T positions of named joints.

        Links among themselves keep what `kept` says of them, else the margin, or what they have at the ends if less;
        where `kept` is not given they must not touch.
        """
        request = coal.CollisionRequest()
        found: set[str] = set()
        objects = list(self.shapes.geometryObjects)
        frames = self.model.frames
        links = [one.name if one.name in self.carried else frames[one.parentFrame].name for one in objects]
        whole = pin.neutral(self.model)
        # A column follows a joint by name; held joints stay at their places.
        columns = []
        for k, (name, value) in enumerate(named.items()):
            index = self.model.joints[self.model.getJointId(name)].idx_q
            if np.isnan(value):
                columns.append((index, k))
            else:
                whole[index] = value
        # Links between which no joint moves can't come nearer to each other.
        moving = {self.model.getJointId(name) for name, value in named.items() if np.isnan(value)}
        carried = [moving.intersection(self.model.supports[one.parentJoint]) for one in objects]
        pairs = [
            (a, b)
            for a in range(len(objects))
            for b in range(a)
            if carried[a] != carried[b]
            and not ({frozenset((links[a], links[b])), frozenset((objects[a].name, objects[b].name))} & left_out)
        ]
        least = dict.fromkeys(pairs, 0.0 if kept is None else margin)
        for number, row in enumerate((q[0], q[-1], *q)):
            for index, k in columns:
                whole[index] = row[k]
            pin.forwardKinematics(self.model, self.data, whole)
            at = [self.data.oMi[one.parentJoint] * one.placement for one in objects]
            poses = [coal.Transform3s(one.rotation, one.translation) for one in at]
            for k, one in enumerate(objects):
                if not carried[k]:
                    continue
                request.security_margin = margin
                for name, thing in self.things:
                    if thing.hits(one.geometry, poses[k], request):
                        found.add(f"{links[k]} and {name}")
            for a, b in pairs:
                shapes = objects[a].geometry, poses[a], objects[b].geometry, poses[b]
                if kept is not None and number < 2:
                    apart = coal.distance(*shapes, coal.DistanceRequest(), coal.DistanceResult())
                    least[a, b] = min(least[a, b], max(apart - SHORT, 0.0))
                reported = np.inf if kept is None else kept.get(frozenset((links[a], links[b])), np.inf)
                request.security_margin = max(min(least[a, b], reported - SHORT), 0.0)
                if coal.collide(*shapes, request, coal.CollisionResult()):
                    found.add(f"{links[a]} and {links[b]}")
        return sorted(found)


def rule_faults(plan: dict[str, Any], scene: dict[str, Any], world: World, tip: str, steps: int = 4000) -> list[str]:
    """Which of the scene's rules of the way a plan breaks: `[tool]`, `[[tool.cone]]`, `[[pass]]`, sets of goals.

    Args:
        plan, scene: As for `faults`.
        world: Its model places the tool.
        tip: The frame that counts as the tool where the scene names none.
        steps: Places at which it is looked at.
    """
    n, tool, found = len(plan["joints"]), scene.get("tool", {}), []
    times = np.array([0.0, *plan["times_s"], plan["duration_s"]])
    curve = CubicSpline(
        times, np.array([plan["start_rad"], *plan["via_points_rad"], plan["goal_rad"]]), bc_type="clamped"
    )
    t = np.linspace(0.0, times[-1], steps + 1)
    q, whole, at, turns = curve(t), pin.neutral(world.model), [], []
    for name, value in plan["held"].items():
        whole[world.model.joints[world.model.getJointId(name)].idx_q] = value
    columns = [world.model.joints[world.model.getJointId(name)].idx_q for name in plan["joints"]]
    frame = world.model.getFrameId(tool.get("frame", tip))
    for row in q:
        whole[columns] = row
        pin.framesForwardKinematics(world.model, world.data, whole)
        at.append(world.data.oMf[frame].translation.copy())
        turns.append(world.data.oMf[frame].rotation.copy())
    place, turned = np.array(at), np.array(turns)
    if "speed_m_s" in tool:
        speed = np.linalg.norm(np.diff(place, axis=0), axis=1).max() / (t[1] - t[0])
        found += [f"tool at {speed:.4f} m/s"] * bool(speed > tool["speed_m_s"] * (1.0 + 1e-6))
    if tool.get("straight"):
        way = place[-1] - place[0]
        share = np.clip((place - place[0]) @ way / (way @ way), 0.0, 1.0)
        off = np.linalg.norm(place - place[0] - share[:, None] * way, axis=1).max()
        found += [f"tool {1000 * off:.3f} mm off its line"] * bool(off > tool.get("within_m", 1e-3) + 1e-9)
        if n >= 6:
            whole_turn = pin.log3(turned[0].T @ turned[-1])
            wanted = [turned[0] @ pin.exp3(s * whole_turn) for s in share]
            angle = max(np.linalg.norm(pin.log3(a.T @ b)) for a, b in zip(wanted, turned, strict=True))
            found += [f"tool turned by {np.degrees(angle):.3f} deg"] * bool(
                np.degrees(angle) > tool.get("within_deg", 0.5) + 1e-6
            )
    for cone in tool.get("cone", []):
        axis, towards = (np.array(cone.get(k, [0, 0, z]), dtype=float) for k, z in (("axis", 1), ("towards", -1)))
        cosine = turned @ (axis / np.linalg.norm(axis)) @ (towards / np.linalg.norm(towards))
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        found += [f"cone: {angle.max():.3f} deg"] * bool(angle.max() > cone.get("allowed_deg", 180.0) + 1e-6)
        found += [f"cone: {angle.min():.3f} deg"] * bool(angle.min() < cone.get("keep_out_deg", 0.0) - 1e-6)
    since = 0
    for number, via in enumerate(scene.get("pass", []), start=1):
        missed = place - via["xyz_m"] if "xyz_m" in via else np.degrees(q) - via["deg"]
        within = via.get("within_m", 1e-3) if "xyz_m" in via else via.get("within_deg", 0.1)
        # Between two places looked at, the motion comes nearer by half a step at most.
        steps_there = np.abs(np.diff(missed, axis=0)).max(axis=1)
        near = np.abs(missed).max(axis=1)[:-1] <= within + steps_there / 2
        hits = np.flatnonzero(near[since:])
        if len(hits) == 0:
            found.append(f"via point {number} is not passed in its turn")
            break
        since += int(hits[0])
    goals = scene["task"].get("goals_deg")
    if goals is not None and min(np.abs(np.degrees(plan["goal_rad"]) - goal).max() for goal in goals) > 1e-6:
        found.append("goal is none of those")
    return found


def faults(
    plan: dict[str, Any], scene: dict[str, Any], model: Model, world: World, limits: dict[str, Any]
) -> list[str]:
    """What an independent look finds broken in a plan's record; nothing where all is as it says.

    Args:
        plan: The record of `plan.result/1`.
        scene: The scene file's contents.
        model: The model's torque, of all joints of the arm.
        world: Shapes.
        limits: `lower`, `upper`, `speed` and `torque` of the joints that move, and `clearance`.
    """
    n, found = len(plan["joints"]), []
    points = np.array([plan["start_rad"], *plan["via_points_rad"], plan["goal_rad"]])
    times = np.array([0.0, *plan["times_s"], plan["duration_s"]])
    curve = CubicSpline(times, points, bc_type="clamped")
    t = np.linspace(0.0, times[-1], FINE + 1)
    q, dq, ddq = curve(t), curve(t, 1), curve(t, 2)
    for name, asked in (("start", scene["task"]["start_deg"]), ("goal", scene["task"].get("goal_deg"))):
        if asked is not None and np.abs(points[0 if name == "start" else -1] - np.radians(asked)).max() > 1e-9:
            found.append(f"{name} is another")
    held = np.array(list(plan["held"].values()))[: len(model.joints) - n]
    full = [
        np.hstack([part, np.tile(rest, (len(t), 1))]) for part, rest in ((q, held), (dq, 0 * held), (ddq, 0 * held))
    ]
    tau = model.torque(*full)[:, :n]
    for name, share in (("torque", np.abs(tau) / limits["torque"]), ("speed", np.abs(dq) / limits["speed"])):
        if share.max() > 1.0 + ROUNDING:
            found.append(f"{name}: {100 * share.max():.3f} %")
    if (q < limits["lower"] - 1e-9).any() or (q > limits["upper"] + 1e-9).any():
        found.append("position")
    if scene["task"]["objective"] == "energy" and abs(times[-1] - scene["task"]["duration_s"]) > 1e-9:
        found.append("duration is another")
    weights = np.ones(FINE + 1)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    power = tau * dq
    sums = {"signed": power, "positive": np.maximum(power, 0.0), "absolute": np.abs(power)}
    scale = max(abs(plan["energy_J"]["absolute"]), 1.0)
    for name, part in sums.items():
        joules = float(weights @ part.sum(axis=1)) * times[-1] / FINE / 3.0
        if abs(joules - plan["energy_J"][name]) > ENERGY * scale:
            found.append(f"{name} energy is {joules:.4f} J, the plan says {plan['energy_J'][name]:.4f} J")
    left_out = {frozenset(pair["links"]) for pair in plan["unchecked_pairs"]}
    named = {**dict.fromkeys(plan["joints"], float("nan")), **plan["held"]}
    some = q[:: max(1, FINE // COARSE)]
    kept = {frozenset(cut["links"]): cut["kept_m"] for cut in plan["clearance_cuts"]}
    found += world.near(named, some, left_out, limits["clearance"] - SHORT, kept)
    return found
