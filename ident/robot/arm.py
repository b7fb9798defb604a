"""ArmModel: a URDF as batched rigid-body dynamics.

With `ident.robot.pinocchio_model` the only importer of Pinocchio in the identification.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Bool, Float, freeze, in_a_line
from ident.errors import RobotError
from ident.recordings.recording import Payload
from ident.robot.chain import Chain, compute_joint_poses, compute_regressor
from ident.robot.limits import KnownLimits, known_limits
from ident.robot.names import find_urdf, split_tip
from ident.robot.pinocchio_model import (
    build_model,
    inertial_parameters,
    merge_inertias,
    read_chain,
    read_geometry,
    torque_derivatives,
    with_inertial_parameters,
)
from ident.robot.urdf import lock_beside, normalise_urdf
from ident.robot.urdf_elements import read_reductions
from ident.safe_read import read_text

STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # on the base of a URDF, which stands on a floor [m/s²]


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A serial arm of n one-axis joints.

    Kinematics, inverse dynamics, regressor and collision geometry.
    """

    __repr__ = in_a_line

    name: str  # name of the robot, as the URDF gives it
    urdf: str  # URDF text with locked joints fixed and continuous joints made revolute
    model: pin.Model  # pinocchio model built from it; treat as read-only
    joint_names: tuple[str, ...]  # the n joint names, base to tip
    source: Path | None = None  # the URDF file
    # Joints fixed on the way, with their positions [rad or m].
    locked_joints: dict[str, float] = field(default_factory=dict)
    tip: str = ""  # the last joint by which one of several arms was named; else empty

    @classmethod
    def load(cls, robot: str | Path, joints: Sequence[str] | None = None) -> ArmModel:
        """Loads a URDF or xacro path, or a name (`ident.robot.names`).

        Grippers, heads and wheels are locked at zero.

        Args:
            robot: Path or name; of a robot of several arms with the last joint of one
                (`baxter:left_w2`).
            joints: Joints to keep; the others are locked at their neutral position. All if None.

        Raises:
            RobotError: No such robot, not a URDF, no inertia, or not a serial chain.
        """
        path = find_urdf(robot)
        tip = split_tip(robot)[1]
        if path.suffix == ".xacro":  # few are
            text = import_module("ident.robot.xacro_files").expand(path)
        else:
            text = read_text(path, "give a URDF file", RobotError)
        arm = cls.from_whole_urdf(text, path, tip)
        if joints is None:
            return arm
        arm._require_joints(joints)
        return arm.keeping(joints)

    @classmethod
    def from_whole_urdf(cls, text: str, source: Path, tip: str) -> ArmModel:
        """Builds the arm from a URDF that may have other arms beside it.

        Args:
            text: The URDF.
            source: Its file.
            tip: Name of the arm's last joint: all that is not on the way to it is locked at zero.
                Empty where the URDF has one arm alone.

        Raises:
            RobotError: As `load`.
        """
        beside: dict[str, float] = {}
        if tip:
            text, beside = lock_beside(text, tip, str(source))
        arm = cls.from_urdf(text, source, tip=tip)
        return replace(arm, locked_joints={**beside, **arm.locked_joints})

    @classmethod
    def from_urdf(
        cls,
        text: str,
        source: Path | None = None,
        locked: dict[str, float] | None = None,
        tip: str = "",
    ) -> ArmModel:
        """Builds the arm from a URDF text.

        Raises:
            RobotError: As `load`.
        """
        where = str(source or "URDF")
        urdf, fixed = normalise_urdf(text, where, locked or {})
        model = build_model(urdf, where)
        return cls(model.name, urdf, model, tuple(model.names)[1:], source, fixed, tip)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.model.nv)

    @property
    def lower(self) -> Float[Array, " n"]:
        """Lower position limits [rad or m]."""
        return freeze(self.model.lowerPositionLimit)

    @property
    def upper(self) -> Float[Array, " n"]:
        """Upper position limits [rad or m]."""
        return freeze(self.model.upperPositionLimit)

    @property
    def velocity_limit(self) -> Float[Array, " n"]:
        """Velocity limits [rad/s or m/s]."""
        return freeze(self.model.velocityLimit)

    @property
    def effort_limit(self) -> Float[Array, " n"]:
        """Torque limits [N m or N]."""
        return freeze(self.model.effortLimit)

    @property
    def known_limits(self) -> KnownLimits:
        """The limits that say something, infinite where the URDF has none or a placeholder."""
        return known_limits(self.lower, self.upper, self.velocity_limit, self.effort_limit)

    @property
    def rated_torque(self) -> Float[Array, " n"]:
        """The torque limits [N m or N].

        Where the URDF has none, what a joint needs against gravity gives one.
        """
        known = np.isfinite(self.known_limits.effort)
        if known.all():
            return self.effort_limit
        gravity = np.abs(self.weight_in_poses).max(axis=0)
        from_gravity = np.maximum(4.0 * gravity, 0.1 * gravity.max())
        return np.where(known, self.effort_limit, from_gravity)

    @property
    def weight_in_poses(self) -> Float[Array, "p n"]:
        """Torque that holds the arm still in poses all over [N m]."""
        poses = np.random.default_rng(0).uniform(-1.5, 1.5, (64, self.n))
        return self.gravity(poses)

    @property
    def gear_ratios(self) -> Float[Array, " n"] | None:
        """Reduction of each joint from the URDF's transmissions; None where a joint has none."""
        ratios = read_reductions(self.urdf)
        known = all(name in ratios for name in self.joint_names)
        return freeze([ratios[name] for name in self.joint_names]) if known else None

    @property
    def joint_axes(self) -> Float[Array, "n 3"]:
        """Axis of each joint in its own frame, unit length."""
        return self.chain.axes

    @property
    def sliding_joints(self) -> Bool[Array, " n"]:
        """Which joints are prismatic."""
        return self.chain.sliding

    @property
    def links(self) -> tuple[str, ...]:
        """Name of the link that each joint moves."""
        bodies = [frame for frame in self.model.frames if frame.type == pin.FrameType.BODY]
        names: dict[int, str] = {}
        for body in bodies:
            names.setdefault(int(body.parentJoint), str(body.name))
        return tuple(names[i] for i in range(1, self.n + 1))

    @property
    def digest(self) -> str:
        """SHA-256 of the URDF text: two arms with one digest are the same arm."""
        return hashlib.sha256(self.urdf.encode()).hexdigest()

    @property
    def content(self) -> str:
        """SHA-256 of joints, lengths, axes and inertias.

        They count to the nine places that numbers through xacro keep.
        """
        digest = hashlib.sha256("\0".join(self.joint_names).encode())
        chain = self.chain
        lengths = (chain.rotations[:, 0], chain.offsets, chain.axes, chain.sliding)
        for values in (*lengths, self.inertial_parameters):
            digest.update((np.round(np.asarray(values, dtype=float), 9) + 0.0).tobytes())
        return digest.hexdigest()

    def is_same(self, other: ArmModel) -> bool:
        """Whether both are one arm where they have joints in common, whatever they are called."""
        common = [name for name in self.joint_names if name in other.joint_names]
        if not common:
            return False
        alone = self.keeping(common, other.locked_joints)
        return alone.content == other.keeping(common, self.locked_joints).content

    @property
    def neutral(self) -> Float[Array, " n"]:
        """The neutral position: zero where the limits allow it [rad or m]."""
        return freeze(np.clip(np.zeros(self.n), self.lower, self.upper))

    def inverse_dynamics(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """Joint torque of the rigid arm, M ddq + C dq + G [N m], for T states at once.

        Source: paper, eq. 2 (with the erratum: C(θ, dθ) dθ).
        """
        states = [np.asfortranarray(np.asarray(values, dtype=float).T) for values in (q, dq, ddq)]
        if states[0].shape[1] == 0:
            return np.zeros((0, self.n))
        # a thread more waits busily: twice the processor time
        torque = pin.rneaInParallel(1, self._pool, *states)
        # one state comes back as a vector
        return np.ascontiguousarray(np.reshape(torque, states[0].shape).T)

    def gravity(self, q: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """Joint torques that hold the arm still at each position [N m, of a slider N]."""
        return self.inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))

    def regressor(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        columns: Sequence[int] | None = None,
    ) -> Float[Array, "T n k"]:
        """Y with τ = Y π, π the `inertial_parameters`; all of its columns, or those asked for."""
        return compute_regressor(self.chain, q, dq, ddq, columns)

    def derivatives(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
    ) -> tuple[Float[Array, "T n n"], Float[Array, "T n n"], Float[Array, "T n n"]]:
        """∂τ/∂q, ∂τ/∂dq and ∂τ/∂ddq (the mass matrix) of `inverse_dynamics`.

        Rows are torques, columns are joints.
        """
        of_q, of_dq, of_ddq = torque_derivatives(self.model, q, dq, ddq)
        return of_q, of_dq, of_ddq

    def mean_inertia(self, q: Float[Array, "T n"]) -> Float[Array, " n"]:
        """What each joint moves of the links, on average over positions [kg m², of a slider kg]."""
        at_rest = np.zeros_like(q)
        masses = self.derivatives(q, at_rest, at_rest)[2]
        return np.asarray(np.diagonal(masses, axis1=1, axis2=2).mean(axis=0))

    @property
    def inertial_parameters(self) -> Float[Array, " 10n"]:
        """Ten numbers a link [SI].

        m, m c, and inertia about the joint frame as xx, xy, yy, xz, yz, zz.
        """
        return freeze(inertial_parameters(self.model))

    def with_inertial_parameters(self, parameters: Float[Array, " 10n"]) -> ArmModel:
        """A copy of the arm with other link inertias, in the order of `inertial_parameters`."""
        return replace(self, model=with_inertial_parameters(self.model, parameters))

    def with_payload(self, payload: Payload | None) -> ArmModel:
        """An arm that carries a point mass, too, in the last link's frame.

        None, or a mass of zero, gives the arm itself.
        """
        if payload is None or payload.mass_kg == 0.0:
            return self
        centre = np.array(payload.com_m, dtype=float)
        body = pin.Inertia(float(payload.mass_kg), centre, np.zeros((3, 3)))
        model = pin.Model(self.model)
        model.inertias[self.n] = model.inertias[self.n] + body
        return replace(self, model=model)

    def with_position_limits(
        self, lower: Float[Array, " n"], upper: Float[Array, " n"]
    ) -> ArmModel:
        """A copy of the arm with other limits of its joints' positions [rad or m]."""
        model = pin.Model(self.model)
        model.lowerPositionLimit = np.array(lower, dtype=float)
        model.upperPositionLimit = np.array(upper, dtype=float)
        return replace(self, model=model)

    def with_gravity(self, gravity: Float[Array, " 3"]) -> ArmModel:
        """A copy of the arm under another gravity vector in the base frame [m/s²]."""
        model = pin.Model(self.model)
        model.gravity.linear = np.asarray(gravity, dtype=float)
        return replace(self, model=model)

    def with_rotors(self, inertia: Float[Array, " n"]) -> ArmModel:
        """A copy of the arm with rotors on its joints [kg m²].

        Inverse and forward dynamics feel them, the regressor not.
        """
        model = pin.Model(self.model)
        model.armature = np.array(inertia, dtype=float)
        return replace(self, model=model)

    def forward_dynamics(self, q: Array, dq: Array, tau: Array) -> Float[Array, "*T n"]:
        """Joint accelerations under joint torques [rad/s²].

        Args:
            q: Joint positions [rad], of one state (n,) or of T states (T, n).
            dq: Speeds [rad/s], of the same shape.
            tau: Torques [N m], of the same shape.

        Returns:
            Of the shape of `q`.
        """
        states = []
        for values in (q, dq, tau):
            rows = np.atleast_2d(np.asarray(values, dtype=float))
            states.append(np.asfortranarray(rows.T))
        acceleration = np.reshape(pin.abaInParallel(1, self._pool, *states), states[0].shape)
        return np.ascontiguousarray(acceleration.T).reshape(np.shape(q))

    def locked(self, joints: Sequence[str], positions: Sequence[float] | None = None) -> ArmModel:
        """The arm with some joints fixed, at the given positions or at neutral.

        The exact reduction: inertias changed by `with_inertial_parameters` are carried over.

        Args:
            joints: Their names.
            positions: Of each of them [rad or m].

        Raises:
            RobotError: One is no joint of the arm, or all are.
        """
        if not joints:
            return self
        self._require_joints(joints)
        if set(joints) == set(self.joint_names):
            where = self.source or self.name
            raise RobotError(where, "every joint would be locked", "keep at least one joint")
        if positions is None:
            neutral = self.neutral
            positions = [neutral[self.joint_names.index(name)] for name in joints]
        fixed = {name: float(value) for name, value in zip(joints, positions, strict=True)}
        reduced = ArmModel.from_urdf(self.urdf, self.source, fixed, self.tip)
        inertias = merge_inertias(self.model, fixed, reduced.joint_names)
        reduced = reduced.with_inertial_parameters(inertias)
        reduced = reduced.with_gravity(self.model.gravity.linear)
        return replace(reduced, locked_joints={**self.locked_joints, **fixed})

    def keeping(
        self, joints: Sequence[str], positions: Mapping[str, float] | None = None
    ) -> ArmModel:
        """The arm with all joints but these fixed.

        Args:
            joints: Names; those that it does not have are passed over.
            positions: Of the others, by name, where they are not fixed at neutral [rad or m].
        """
        neutral = dict(zip(self.joint_names, self.neutral.tolist(), strict=True))
        still = [name for name in self.joint_names if name not in joints]
        known = {**neutral, **(positions or {})}
        return self.locked(still, [known[name] for name in still])

    def forward_kinematics(self, q: Float[Array, " n"]) -> dict[str, Float[Array, "4 4"]]:
        """Pose of every link in the base frame, by its name, as homogeneous transforms [m]."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, np.asarray(q, dtype=float))
        poses = {}
        for frame, placement in zip(self.model.frames, data.oMf, strict=True):
            if frame.type == pin.FrameType.BODY:
                poses[frame.name] = placement.homogeneous
        return poses

    def link_poses(
        self, q: Float[Array, "T n"], links: Sequence[str]
    ) -> dict[str, tuple[Float[Array, "T 3 3"], Float[Array, "T 3"]]]:
        """Orientation and place [m] of some links in the base frame, for T positions at once.

        Args:
            q: Joint positions [rad].
            links: Their names.

        Returns:
            By the link's name: its axes in columns, and its origin.

        Raises:
            KeyError: The arm has no such link.
        """
        bodies = (frame for frame in self.model.frames if frame.type == pin.FrameType.BODY)
        frames = {frame.name: frame for frame in bodies}
        joints = {name: int(frames[name].parentJoint) for name in links}
        wanted = sorted(set(joints.values()))
        joint_poses = compute_joint_poses(self.chain, np.asarray(q, dtype=float), wanted)
        poses = {}
        for name, joint in joints.items():
            turn, origin = joint_poses[joint]
            placement = frames[name].placement
            poses[name] = (turn @ placement.rotation, origin + turn @ placement.translation)
        return poses

    @cached_property
    def geometry(self) -> pin.GeometryModel:
        """Collision geometry.

        Raises:
            RobotError: A mesh that the URDF names is not there, or can't be read.
        """
        return self._read_geometry("collision")

    @cached_property
    def visual_geometry(self) -> pin.GeometryModel:
        """The shapes by which the arm is shown; raises as `geometry` does."""
        return self._read_geometry("visual")

    def _read_geometry(self, tag: str) -> pin.GeometryModel:
        where = str(self.source or self.name)
        return read_geometry(self.model, self.urdf, tag, self.source, where)

    @cached_property
    def _pool(self) -> pin.ModelPool:
        return pin.ModelPool(self.model, 1)

    @cached_property
    def chain(self) -> Chain:
        """Joint placements, axes, which joints slide, gravity and inertias, as plain arrays."""
        return read_chain(self.model)

    def _require_joints(self, joints: Sequence[str]) -> None:
        """Raises RobotError unless all are joints of this arm."""
        for name in set(joints).difference(self.joint_names):
            remedy = f"its joints are: {', '.join(self.joint_names)}"
            raise RobotError(self.source or self.name, f"no moving joint {name!r}", remedy)
