"""ArmModel: a URDF as batched rigid-body dynamics.

The only importer of Pinocchio in the identification.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Bool, Float, freeze, in_a_line
from ident.errors import RobotError, first_line
from ident.recordings.recording import Payload
from ident.robot.branches import arm_tips
from ident.robot.chain import Chain, compute_joint_poses, compute_regressor
from ident.robot.limits import KnownLimits, known_limits
from ident.robot.names import find_urdf, split_tip
from ident.robot.urdf import lock_beside, normalise_urdf, parse_urdf
from ident.robot.urdf_elements import followers, read_reductions
from ident.safe_read import read_text

STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # on the base of a URDF, which stands on a floor [m/s²]


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A serial arm of n one-axis joints: kinematics, inverse dynamics, regressor and collision
    geometry.
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
        """Loads a URDF or xacro path, or a name (`ident.robot.names`); grippers, heads and wheels
        are locked at zero.

        Args:
            robot: Path or name; of a robot of several arms with the last joint of one
                (`baxter:left_w2`).
            joints: Joints to keep; the others are locked at their neutral position. All if None.

        Raises:
            RobotError: No such robot, not a URDF, no inertia, or not a serial chain.
        """
        path = find_urdf(robot)
        (_, tip) = split_tip(robot)
        if path.suffix == ".xacro":  # few are
            text = import_module("ident.robot.xacro_files").expand(path)
        else:
            text = read_text(path, "give a URDF file", RobotError)
        text, beside = lock_beside(text, tip, str(path)) if tip else (text, {})
        arm = cls.from_urdf(text, path, tip=tip)
        arm = replace(arm, locked_joints={**beside, **arm.locked_joints})
        if joints is not None:
            arm._require_joints(joints)
        return arm if joints is None else arm.keeping(joints)

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
        try:
            model = pin.buildModelFromXML(urdf)
        except (ValueError, RuntimeError) as error:
            raise RobotError(
                where, f"the parser refused it ({first_line(error)})", "check it with check_urdf"
            ) from None
        # A chain of one-axis joints whose every joint moves some mass.
        if model.nv == 0:
            raise RobotError(where, "it has no moving joint", "give an arm")
        if model.nq != model.nv or model.nv != model.njoints - 1:
            what = "it has joints of more than one axis"
            raise RobotError(where, what, "give an arm of revolute and prismatic joints")
        parents = list(model.parents)[1:]
        if parents != list(range(model.njoints - 1)):
            fork = next(i for i, parent in enumerate(parents, start=1) if parent != i - 1)
            tips = " or ".join(f":{name}" for name in arm_tips(urdf)[:2])
            remedy = f"name the last joint of the arm that is meant behind the robot: {tips}"
            raise RobotError(where, f"not a serial chain: {model.names[fork]} forks off", remedy)
        if coupled := [*followers(parse_urdf(urdf, where))]:
            what = (
                f"{', '.join(coupled)} move with other joints (<mimic>): as a palletiser's, they "
                "make no chain"
            )
            raise RobotError(
                where,
                what,
                "give an arm of free joints; coupled ones that hardly weigh can be made fixed",
            )
        moved = np.cumsum([model.inertias[i].mass for i in range(model.njoints - 1, 0, -1)])[::-1]
        for i, mass in enumerate(moved, start=1):
            if not mass > 0.0:
                remedy = "add <inertial> to the links beyond that joint"
                raise RobotError(where, f"joint {model.names[i]} moves no mass", remedy)
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
        """The torque limits; where the URDF has none, what a joint needs against gravity gives one
        [N m or N].
        """
        known = np.isfinite(self.known_limits.effort)
        if known.all():
            return self.effort_limit
        gravity = np.abs(self.weight_in_poses).max(axis=0)
        return np.where(known, self.effort_limit, np.maximum(4.0 * gravity, 0.1 * gravity.max()))

    @property
    def weight_in_poses(self) -> Float[Array, "p n"]:
        """Torque that holds the arm still in poses all over [N m]."""
        return self.gravity(np.random.default_rng(0).uniform(-1.5, 1.5, (64, self.n)))

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
        """SHA-256 of joints, lengths, axes and inertias, to the nine places that numbers through
        xacro keep.
        """
        digest = hashlib.sha256("\0".join(self.joint_names).encode())
        for values in (self.chain.rotations[:, 0], *self.chain[1:4], self.inertial_parameters):
            digest.update((np.round(np.asarray(values, dtype=float), 9) + 0.0).tobytes())
        return digest.hexdigest()

    def is_same(self, other: ArmModel) -> bool:
        """Whether both are one arm where they have joints in common, whatever they are called."""
        common = [name for name in self.joint_names if name in other.joint_names]
        return bool(common) and self.keeping(common).content == other.keeping(common).content

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
        """Torque that holds the arm still [N m]."""
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
        """∂τ/∂q, ∂τ/∂dq and ∂τ/∂ddq (the mass matrix) of `inverse_dynamics`; rows are torques,
        columns are joints.

        Tuned links may weigh less than nothing. Pinocchio's sums of bodies can't; the derivatives
        are linear in all inertial parameters, so that masses are added to every link, and taken
        away again.
        """
        parameters = self.inertial_parameters
        if np.any(parameters[::10] < 0.0):
            more = np.zeros_like(parameters)
            more[::10] = 1.0 + np.maximum(-parameters[::10], 0.0)
            pair = (
                self.with_inertial_parameters(parameters + more),
                self.with_inertial_parameters(more),
            )
            heavy, added = (arm.derivatives(q, dq, ddq) for arm in pair)
            return heavy[0] - added[0], heavy[1] - added[1], heavy[2] - added[2]
        data = self.model.createData()
        states = [np.ascontiguousarray(values, dtype=float) for values in (q, dq, ddq)]
        out = np.empty((3, len(states[0]), self.n, self.n))
        for k, state in enumerate(zip(*states, strict=True)):
            out[0, k], out[1, k], out[2, k] = pin.computeRNEADerivatives(self.model, data, *state)
        return out[0], out[1], out[2]

    def mean_inertia(self, q: Float[Array, "T n"]) -> Float[Array, " n"]:
        """What each joint moves of the links, on average over some positions [kg m²]."""
        return np.asarray(
            np.diagonal(self.derivatives(q, 0.0 * q, 0.0 * q)[2], axis1=1, axis2=2).mean(axis=0)
        )

    @property
    def inertial_parameters(self) -> Float[Array, " 10n"]:
        """Ten numbers a link: m, m c, and inertia about the joint frame as xx, xy, yy, xz, yz, zz
        [SI].
        """
        return freeze(
            np.concatenate(
                [self.model.inertias[i].toDynamicParameters() for i in range(1, self.n + 1)]
            )
        )

    def with_inertial_parameters(self, parameters: Float[Array, " 10n"]) -> ArmModel:
        """The same arm with other link inertias, in the order of `inertial_parameters`."""
        model = pin.Model(self.model)
        for i, link in enumerate(
            np.reshape(np.asarray(parameters, dtype=float), (self.n, 10)), start=1
        ):
            # Set piece by piece: the constructor refuses what least squares may find, an inertia
            # that no body could have. A zero mass carries its moments about the joint frame.
            inertia = pin.Inertia.Zero()
            mass = float(link[0])
            lever = link[1:4] / mass if mass != 0.0 else np.zeros(3)
            about_origin = link[[4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(3, 3)
            cross = pin.skew(lever)
            inertia.mass = mass
            inertia.lever = lever
            inertia.inertia = about_origin + mass * cross @ cross
            model.inertias[i] = inertia
        return replace(self, model=model)

    def with_payload(self, payload: Payload | None) -> ArmModel:
        """The same arm carrying a point mass at the payload's centre of mass, in the last link's
        frame.
        """
        if payload is None or payload.mass_kg == 0.0:
            return self
        body = pin.Inertia(
            float(payload.mass_kg), np.array(payload.com_m, dtype=float), np.zeros((3, 3))
        )
        model = pin.Model(self.model)
        model.inertias[self.n] = model.inertias[self.n] + body
        return replace(self, model=model)

    def with_position_limits(
        self, lower: Float[Array, " n"], upper: Float[Array, " n"]
    ) -> ArmModel:
        """The same arm with other limits of its joints' positions [rad or m]."""
        model = pin.Model(self.model)
        model.lowerPositionLimit = np.array(lower, dtype=float)
        model.upperPositionLimit = np.array(upper, dtype=float)
        return replace(self, model=model)

    def with_gravity(self, gravity: Float[Array, " 3"]) -> ArmModel:
        """The same arm under another gravity vector in the base frame [m/s²]."""
        model = pin.Model(self.model)
        model.gravity.linear = np.asarray(gravity, dtype=float)
        return replace(self, model=model)

    def with_rotors(self, inertia: Float[Array, " n"]) -> ArmModel:
        """The same arm with rotors on its joints [kg m²]: inverse and forward dynamics feel them,
        the regressor not.
        """
        model = pin.Model(self.model)
        model.armature = np.array(inertia, dtype=float)
        return replace(self, model=model)

    def forward_dynamics(self, q: Array, dq: Array, tau: Array) -> Float[Array, "*T n"]:
        """Joint accelerations of one state or of T states under joint torques [rad/s²]."""
        states = [
            np.asfortranarray(np.atleast_2d(np.asarray(values, dtype=float)).T)
            for values in (q, dq, tau)
        ]
        acceleration = np.reshape(pin.abaInParallel(1, self._pool, *states), states[0].shape)
        return np.ascontiguousarray(acceleration.T).reshape(np.shape(q))

    def locked(self, joints: Sequence[str], positions: Sequence[float] | None = None) -> ArmModel:
        """The arm with some joints fixed, at the given positions or at neutral: the exact
        reduction.

        Inertias changed by `with_inertial_parameters` are carried over.
        """
        if not joints:
            return self
        self._require_joints(joints)
        if set(joints) == set(self.joint_names):
            raise RobotError(
                self.source or self.name, "every joint would be locked", "keep at least one joint"
            )
        angles = (
            self.neutral[[self.joint_names.index(name) for name in joints]]
            if positions is None
            else positions
        )
        fixed = {name: float(value) for name, value in zip(joints, angles, strict=True)}
        reduced = ArmModel.from_urdf(self.urdf, self.source, fixed, self.tip)
        reduced = reduced.with_inertial_parameters(self._merged_inertias(reduced, fixed))
        reduced = reduced.with_gravity(self.model.gravity.linear)
        return replace(reduced, locked_joints={**self.locked_joints, **fixed})

    def keeping(self, joints: Sequence[str]) -> ArmModel:
        """The arm with all joints but these fixed at neutral; names that it does not have are
        passed over.
        """
        return self.locked([name for name in self.joint_names if name not in joints])

    def forward_kinematics(self, q: Float[Array, " n"]) -> dict[str, Float[Array, "4 4"]]:
        """Pose of every link in the base frame, as homogeneous transforms."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, np.asarray(q, dtype=float))
        return {
            frame.name: data.oMf[i].homogeneous
            for i, frame in enumerate(self.model.frames)
            if frame.type == pin.FrameType.BODY
        }

    def link_poses(
        self, q: Float[Array, "T n"], links: Sequence[str]
    ) -> dict[str, tuple[Float[Array, "T 3 3"], Float[Array, "T 3"]]]:
        """Orientation and place [m] of some links in the base frame, for T positions at once."""
        frames = {
            frame.name: frame for frame in self.model.frames if frame.type == pin.FrameType.BODY
        }
        joints = {name: int(frames[name].parentJoint) for name in links}
        joint_poses = compute_joint_poses(
            self.chain, np.asarray(q, dtype=float), sorted(set(joints.values()))
        )
        poses = {}
        for name, joint in joints.items():
            turn, origin = joint_poses[joint]
            placed = frames[name].placement
            poses[name] = turn @ placed.rotation, origin + turn @ placed.translation
        return poses

    @cached_property
    def geometry(self) -> pin.GeometryModel:
        """Collision geometry.

        Raises:
            RobotError: A mesh that the URDF names is not there, or can't be read.
        """
        return self._read_geometry("collision", pin.GeometryType.COLLISION)

    @cached_property
    def visual_geometry(self) -> pin.GeometryModel:
        """The shapes by which the arm is shown; raises as `geometry` does."""
        return self._read_geometry("visual", pin.GeometryType.VISUAL)

    def _read_geometry(self, tag: str, kind: pin.GeometryType) -> pin.GeometryModel:
        from ident.robot.meshes import with_mesh_paths  # a model alone needs no shapes

        where = str(self.source or self.name)
        text = with_mesh_paths(self.urdf, tag, self.source, where)
        try:
            return pin.buildGeomFromUrdfString(self.model, text, kind, package_dirs=["/"])
        except (ValueError, RuntimeError) as error:
            lines = [line.removeprefix("message: ") for line in str(error).splitlines()]
            reason = next(
                (line for line in lines if "resource" in line or "Mesh" in line), "".join(lines[:1])
            )
            what = f"{tag} geometry can't be read ({reason})"
            raise RobotError(where, what, "mend or replace the mesh, or give boxes") from None

    @cached_property
    def _pool(self) -> pin.ModelPool:
        return pin.ModelPool(self.model, 1)

    @cached_property
    def chain(self) -> Chain:
        """Joint placements, axes, which joints slide, gravity and inertias, as plain arrays."""
        model = self.model
        placed = list(self.model.jointPlacements)[1:]
        inertias = list(self.model.inertias)[1:]
        axes = np.zeros((self.n, 3))
        sliding = np.zeros(self.n, dtype=bool)
        rotations = []
        for i, joint in enumerate(list(model.joints)[1:]):
            data = joint.createData()
            joint.calc(data, np.zeros(1))
            subspace = np.asarray(data.S.matrix if hasattr(data.S, "matrix") else data.S).reshape(6)
            sliding[i] = np.linalg.norm(subspace[:3]) > 0.5
            axes[i] = subspace[:3] if sliding[i] else subspace[3:]
            first = placed[i].rotation
            cross = (not sliding[i]) * pin.skew(axes[i])
            rotations.append([first, first @ cross, first @ cross @ cross])
        sliding.setflags(write=False)
        masses = [
            freeze([getattr(inertia, name) for inertia in inertias])
            for name in ("mass", "lever", "inertia")
        ]
        offsets = freeze([placement.translation for placement in placed])
        gravity = freeze(model.gravity.linear)
        return Chain(freeze(rotations), offsets, freeze(axes), sliding, gravity, *masses)

    def _merged_inertias(self, reduced: ArmModel, fixed: dict[str, float]) -> Float[Array, " 10m"]:
        """Link inertias of the reduced arm, with this arm's (perhaps changed) inertias of the
        locked links added.
        """
        q = np.array([fixed.get(name, 0.0) for name in self.joint_names])
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, q)
        inertias = {}
        anchor = 0
        for i, name in enumerate(self.joint_names, start=1):
            if name not in fixed:
                anchor = i
                held = name
                # a copy: Pinocchio hands out references
                inertias[name] = pin.Inertia(self.model.inertias[i])
            elif anchor:
                inertias[held] = inertias[held] + data.oMi[anchor].actInv(data.oMi[i]).act(
                    self.model.inertias[i]
                )
        return np.concatenate(
            [inertias[name].toDynamicParameters() for name in reduced.joint_names]
        )

    def _require_joints(self, joints: Sequence[str]) -> None:
        """Raises RobotError unless all are joints of this arm."""
        for name in set(joints).difference(self.joint_names):
            remedy = f"its joints are: {', '.join(self.joint_names)}"
            raise RobotError(self.source or self.name, f"no moving joint {name!r}", remedy)
