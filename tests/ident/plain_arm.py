"""An arm in plain numpy: Newton and Euler's recursion over a URDF's own links. Nothing of armgap or Pinocchio is in it.

Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 5.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s²]
RATE = 250.0  # of a log [Hz]
STEP = 0.0005  # of a replay [s]
# What a drawn arm's numbers are of the largest torque of its joints: damping, dry friction, rotor, noise.
DAMPING_SHARE = 0.05  # [s/rad]
FRICTION_SHARE = 0.04
ROTOR_SHARE = 0.003  # [s²]
NOISE_SHARE = 0.0005
ENCODER_NOISE = 1e-5  # [rad]


def numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])


def turn_rpy(angles: np.ndarray) -> np.ndarray:
    """Rotation by roll, pitch and yaw about fixed axes."""
    x, y, z = angles
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def origin_of(element: ElementTree.Element | None) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and place of an `<origin>`; nothing without one."""
    given = {} if element is None else element.attrib
    return turn_rpy(numbers(given.get("rpy", "0 0 0"))), numbers(given.get("xyz", "0 0 0"))


def turn_about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations about an axis, one for each angle, by Rodrigues' formula (T, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)


@dataclass(frozen=True)
class Link:
    """A link and the joint that carries it."""

    parent: int  # of the links, -1 for the root
    joint: int  # of the moving joints, -1 where it is fixed
    turn: np.ndarray  # of the joint's frame in the parent's
    place: np.ndarray  # [m]
    axis: np.ndarray
    mass: float  # [kg]
    centre: np.ndarray  # [m]
    inertia: np.ndarray  # about the centre [kg m²]


@dataclass(frozen=True)
class PlainArm:
    """All links, parents first, with friction as the URDF states it and rotors, which no URDF can."""

    links: tuple[Link, ...]
    joints: tuple[str, ...]
    damping: np.ndarray  # [N m s/rad]
    friction: np.ndarray  # [N m]
    effort: np.ndarray  # largest torque [N m]

    @property
    def rotors(self) -> np.ndarray:
        return ROTOR_SHARE * self.effort

    @classmethod
    def read(cls, text: str) -> PlainArm:
        """Every link below the root that a joint carries."""
        robot = ElementTree.fromstring(text)
        bodies = {body.get("name"): body for body in robot.iter("link")}
        carriers = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}
        order: list[str] = []
        waiting = [name for name in bodies if name not in carriers]
        while waiting:
            name = waiting.pop(0)
            order.append(name)
            waiting += [child for child, joint in carriers.items() if joint.find("parent").get("link") == name]
        moving = [carriers[name] for name in order if name in carriers and carriers[name].get("type") != "fixed"]
        names = tuple(joint.get("name") for joint in moving)
        links = tuple(_link(name, bodies[name], carriers.get(name), order, names) for name in order)
        stated = [joint.find("dynamics") for joint in moving]
        damping = np.array([0.0 if row is None else float(row.get("damping", 0.0)) for row in stated])
        friction = np.array([0.0 if row is None else float(row.get("friction", 0.0)) for row in stated])
        effort = np.array([float(joint.find("limit").get("effort")) for joint in moving])
        return cls(links, names, damping, friction, effort)

    def rigid(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Torque of the bodies alone [N m]; all arguments and the result (T, n)."""
        count = len(q)
        turns: list[np.ndarray] = []
        rates, gains, pulls = [], [], []  # angular velocity and acceleration, linear acceleration of each frame
        for link in self.links:
            above = link.parent
            turn = np.repeat(link.turn[None], count, axis=0)
            spin = np.zeros((count, 3))
            speed_up = np.zeros((count, 3))
            if link.joint >= 0:
                turn = turn @ turn_about(link.axis, q[:, link.joint])
                spin = dq[:, link.joint, None] * link.axis
                speed_up = ddq[:, link.joint, None] * link.axis
            rate = np.zeros((count, 3)) if above < 0 else rates[above]
            gain = np.zeros((count, 3)) if above < 0 else gains[above]
            pull = np.repeat(-GRAVITY[None], count, axis=0) if above < 0 else pulls[above]
            pull = pull + np.cross(gain, link.place) + np.cross(rate, np.cross(rate, link.place))
            inward = turn.transpose(0, 2, 1)
            rate, gain, pull = (np.einsum("tij,tj->ti", inward, vector) for vector in (rate, gain, pull))
            turns.append(turn)
            rates.append(rate + spin)
            gains.append(gain + speed_up + np.cross(rate, spin))
            pulls.append(pull)
        forces = [np.zeros((count, 3)) for _ in self.links]
        moments = [np.zeros((count, 3)) for _ in self.links]
        torque = np.zeros((count, len(self.joints)))
        for k in range(len(self.links) - 1, -1, -1):
            link, rate, gain = self.links[k], rates[k], gains[k]
            centre = pulls[k] + np.cross(gain, link.centre) + np.cross(rate, np.cross(rate, link.centre))
            force = link.mass * centre
            forces[k] += force
            moments[k] += gain @ link.inertia + np.cross(rate, rate @ link.inertia) + np.cross(link.centre, force)
            if link.joint >= 0:
                torque[:, link.joint] = moments[k] @ link.axis
            if link.parent >= 0:
                outward = np.einsum("tij,tj->ti", turns[k], forces[k])
                forces[link.parent] += outward
                moments[link.parent] += np.einsum("tij,tj->ti", turns[k], moments[k]) + np.cross(link.place, outward)
        return torque

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Torque with rotors and friction [N m] (T, n)."""
        return self.rigid(q, dq, ddq) + self.rotors * ddq + self.damping * dq + self.friction * np.sign(dq)

    def replay(self, q: np.ndarray, dq: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Angles [rad] under a torque for each step, from a state on (S, n)."""
        angle, speed = q.copy(), dq.copy()
        path = np.empty_like(torque)
        size = len(angle)
        unit = np.vstack([np.zeros((1, size)), np.eye(size)])
        for k, given in enumerate(torque):
            rows = self.rigid(np.repeat(angle[None], size + 1, 0), np.repeat(speed[None], size + 1, 0), unit)
            inertia = (rows[1:] - rows[0]).T + np.diag(self.rotors)
            drag = self.damping * speed + self.friction * np.sign(speed)
            speed = speed + STEP * np.linalg.solve(inertia, given - rows[0] - drag)
            angle = angle + STEP * speed
            path[k] = angle
        return path


def _link(
    name: str,
    body: ElementTree.Element,
    carrier: ElementTree.Element | None,
    order: list[str],
    names: tuple[str, ...],
) -> Link:
    inertial = body.find("inertial")
    mass, centre, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        mass = float(inertial.find("mass").get("value"))
        turn, centre = origin_of(inertial.find("origin"))
        of = {key: float(value) for key, value in inertial.find("inertia").attrib.items()}
        rows = ("ixx ixy ixz", "ixy iyy iyz", "ixz iyz izz")
        own = np.array([[of[key] for key in row.split()] for row in rows])
        inertia = turn @ own @ turn.T
    if carrier is None:
        return Link(-1, -1, np.eye(3), np.zeros(3), np.zeros(3), mass, centre, inertia)
    turn, place = origin_of(carrier.find("origin"))
    axis_element = carrier.find("axis")
    axis = numbers("1 0 0" if axis_element is None else axis_element.get("xyz"))
    moves = carrier.get("type") != "fixed"
    joint = names.index(carrier.get("name")) if moves else -1
    return Link(order.index(carrier.find("parent").get("link")), joint, turn, place, axis, mass, centre, inertia)


def state_friction(text: str, factor: float) -> str:
    """A URDF without shapes whose joints state so many times the friction that suits their largest torque."""
    robot = ElementTree.fromstring(text)
    for body in robot.iter("link"):
        for shape in [*body.findall("visual"), *body.findall("collision")]:
            body.remove(shape)
    for joint in robot.findall("joint"):
        for row in joint.findall("dynamics"):
            joint.remove(row)
        if joint.get("type") != "fixed":
            effort = float(joint.find("limit").get("effort"))
            damping, friction = factor * DAMPING_SHARE * effort, factor * FRICTION_SHARE * effort
            ElementTree.SubElement(joint, "dynamics", damping=f"{damping:.9g}", friction=f"{friction:.9g}")
    return ElementTree.tostring(robot, encoding="unicode")


def motion_of(joints: int, seed: int, seconds: float, rate: float = RATE) -> tuple[np.ndarray, ...]:
    """Time [s] and angles, speeds and accelerations of waves of all joints (T, n)."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / rate)
    q = np.zeros((len(time), joints)) + rng.uniform(-0.6, 0.6, joints)
    dq, ddq = np.zeros_like(q), np.zeros_like(q)
    for _ in range(3):
        size, pulse, phase = (rng.uniform(*ends, joints) for ends in ((0.15, 0.4), (0.6, 3.0), (0.0, 2.0 * np.pi)))
        angle = pulse * time[:, None] + phase
        q += size * np.sin(angle)
        dq += size * pulse * np.cos(angle)
        ddq -= size * pulse**2 * np.sin(angle)
    return time, q, dq, ddq


def record(arm: PlainArm, folder: Path, seed: int, runs: int = 6, seconds: float = 8.0) -> Path:
    """A session in native columns: what the arm's own torque is along motions, with noise."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, 1])
    for run in range(runs):
        time, q, dq, ddq = motion_of(len(arm.joints), 1000 * seed + run, seconds)
        noise = NOISE_SHARE * arm.effort * rng.standard_normal(q.shape)
        torque = arm.torque(q, dq, ddq) + noise
        angle = q + ENCODER_NOISE * rng.standard_normal(q.shape)
        columns = {"time": (seconds + 2.0) * run + time}
        for j, joint in enumerate(arm.joints):
            columns[f"{joint}/position"] = angle[:, j]
            columns[f"{joint}/effort"] = torque[:, j]
        pq.write_table(pa.table(columns), folder / f"run_{run:02d}.parquet")
    return folder
