"""Masses that are not where the URDF has them: a load, a link, gravity itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant, delta_interval, linear_interval
from ident.effects.informative_motions import LEVEL_OR_LINKS, LEVEL_OR_ZERO, LOAD_OR_LINK
from ident.effects.knowledge import Expression, Range, Typical, exactly_as
from ident.effects.plausible import LARGEST_SMALL_ANGLE, arm_reach
from ident.effects.size_prior import SizePrior
from ident.effects.typical_sizes import coefficient_interval, near_one_pose
from ident.robot.arm import ArmModel

# Distance of the load from the last joint's frame, along its axis, about which its inertia is linearised [m].
PAYLOAD_REACHES = (0.03, 0.12)
LARGEST_PAYLOAD = 10.0  # [kg]
LEAST_PAYLOAD_SHARE = 0.003  # of the arm's mass
LARGEST_LEVER = 0.3  # [m]
LARGEST_INERTIA_SHARE = 0.4  # of a link's mass that a URDF may be off
LARGEST_TILT = 0.1  # [rad]
# Distance of a tool's centre from the flange, as a share of the arm's reach.
LARGEST_TOOL_SHARE = 0.5
# A column whose torque is less than this share of its link's largest acts on nothing.
LEAST_COLUMN = 1e-6
STRUCTURE_STATES = 30


class UnknownPayload(Effect):
    """A load at the last link that the model doesn't know: mass m at a centre c, in the last link's frame.

    The four columns belong to m and m (c − c₀), with the inertia that a point mass has near c₀, a reach along the last
    joint's axis. Columns that act on no torque, whatever the motion, are left out: the height of what hangs on a SCARA.
    """

    id = "payload"
    inertia_like = True
    scope = "arm"
    rows = "all"
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "the last link carries more than the model knows; look at gravity's torque over many poses"
    set_ups: ClassVar[Mapping[str, str]] = {"link_inertial_error": LOAD_OR_LINK}
    twins = ("link_inertial_error",)
    defining = ("mass_kg",)
    typical = Typical("mass_kg", 0.1)
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": exactly_as("link `payload`, fixed to the last link"),
        "mjcf": exactly_as("body `payload` in the last link"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return near_one_pose(session)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return tuple(Variant(shape={"reach_m": reach}) for reach in PAYLOAD_REACHES)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        nominal = _flange_direction(session.runs[0].arm) * variant.shape["reach_m"]
        axes = _acting_axes(session.runs[0].arm)
        change = np.column_stack([point_mass(nominal), moment_change(nominal)[:, axes]])
        return [run.regressor[:, :, -10:] @ change for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        nominal = _flange_direction(session.runs[0].arm) * variant.shape["reach_m"]
        # Without a mass there is no centre of one; a gram keeps the quotient finite.
        centres = {
            f"com_{axis}_m": Interval(nominal[k], nominal[k] - LARGEST_LEVER, nominal[k] + LARGEST_LEVER)
            for k, axis in enumerate("xyz")
        }
        for slot, k in enumerate(_acting_axes(session.runs[0].arm), start=1):
            centres[f"com_{'xyz'[k]}_m"] = delta_interval(
                lambda c, k=k, slot=slot: nominal[k] + c[slot] / max(c[0], 1e-3), coefficients, covariance
            )
        return {"mass_kg": coefficient_interval(0, coefficients, covariance), **centres}

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """An arm carries no more than it weighs, and no tool's centre is farther out than half the arm's reach."""
        arm = session.runs[0].arm
        own, far = float(arm.inertial_parameters[::10].sum()), LARGEST_TOOL_SHARE * arm_reach(arm)
        centre = Range(-far, far, "a tool's centre lies within half of the arm's reach")
        return {
            "mass_kg": Range(0.0, own, "an arm carries no more than it weighs"),
            **{f"com_{axis}_m": centre for axis in "xyz"},
        }

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        mass = figures["mass_kg"].words("kg")
        return f"weigh the tool: {mass} are not in the model; give them as [payload] of session.toml"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        levers = np.full(len(_acting_axes(session.runs[0].arm)), LARGEST_LEVER)
        return LARGEST_PAYLOAD * np.concatenate([[1.0], levers])

    def size_prior(self, session: SessionContext, joint: int, variant: Variant) -> SizePrior:
        """A hundredth of the arm's mass is as likely as a half, its centre anywhere in a tool's reach.

        Lighter than a tool, or heavier than the arm, by a factor of two is one deviation off.
        """
        arm = session.runs[0].arm
        most, far = float(arm.inertial_parameters[::10].sum()), LARGEST_TOOL_SHARE * arm_reach(arm)
        largest = self.prior_scale(session, joint, variant)
        axes = len(largest) - 1

        def log_density(coefficients: Float[Array, " k"]) -> float:
            mass = float(coefficients[0])
            if mass <= 0.0:
                return -np.inf
            beyond = np.log(mass / np.clip(mass, LEAST_PAYLOAD_SHARE * most, most)) / np.log(2.0)
            inside = np.log(mass * np.log(1.0 / LEAST_PAYLOAD_SHARE)) + axes * np.log(2.0 * far * mass)
            return -float(inside + 0.5 * beyond**2)

        return SizePrior(0.5 * largest, log_density)


class LinkInertialError(Effect):
    """A link of another mass, or with its centre of mass elsewhere.

    The columns belong to more mass of the link's own density, and to shifts of the first moment m c, whose inertia
    about the joint goes along. Columns that act on no torque, whatever the motion, are left out.
    """

    id = "link_inertial_error"
    inertia_like = True
    rows = "all"
    summary = "a link's mass or its centre is not that of the URDF; look at fast motion in many poses"
    twins = ("payload",)
    defining = ("mass_change_kg", *(f"moment_change_{axis}_kgm" for axis in "xyz"))
    typical = Typical("mass_change_kg", 0.25)
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": exactly_as("<inertial> of the link"),
        "mjcf": exactly_as("inertial of the body"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return near_one_pose(session)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        arm = session.runs[0].arm
        change = _link_change(arm, joint)[:, _acting(arm, joint)]
        return [run.regressor[:, :, 10 * joint : 10 * joint + 10] @ change for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        arm = session.runs[0].arm
        acting = _acting(arm, joint)
        change = _link_change(arm, joint)[:4, acting]
        found = {"mass_change_kg": linear_interval(change[0], coefficients, covariance)}
        for k, axis in enumerate("xyz", start=1):
            found[f"moment_change_{axis}_kgm"] = linear_interval(change[k], coefficients, covariance)
        return found

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """A link weighs something, no more than the whole arm, and its centre lies within the arm's reach."""
        arm = session.runs[0].arm
        own, whole = float(arm.inertial_parameters[10 * joint]), float(arm.inertial_parameters[::10].sum())
        moment = (own + abs(figures["mass_change_kg"].value)) * arm_reach(arm)
        centre = Range(-moment, moment, "the link's centre would lie beyond the arm's reach")
        found = {f"moment_change_{axis}_kgm": centre for axis in "xyz"}
        if figures["mass_change_kg"].low > -own:
            return found
        return {"mass_change_kg": Range(-own, whole, "the link's mass would be negative"), **found}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        change = figures["mass_change_kg"].words("kg")
        return f"correct the link behind {where} in the URDF: its mass is off by {change}; `ident patch` writes it"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        arm = session.runs[0].arm
        link = arm.inertial_parameters[10 * joint : 10 * joint + 10]
        mass = LARGEST_INERTIA_SHARE * max(float(link[0]), 0.1)
        lever = max(float(np.linalg.norm(link[1:4])) / max(float(link[0]), 1e-9), 0.1)
        return np.array([mass, mass * lever, mass * lever, mass * lever])[_acting(arm, joint)]

    def size_prior(self, session: SessionContext, joint: int, variant: Variant) -> SizePrior:
        return SizePrior.about_zero(0.5 * self.prior_scale(session, joint, variant))


class GravityMisalignment(Effect):
    """A base that is not level: turned by small angles about its own x and y axes.

    Gravity in the base frame changes by −ω × g, and the torque is linear in gravity.
    """

    id = "gravity_misalignment"
    inertia_like = True
    scope = "arm"
    rows = "all"
    summary = "the base is not level; look at gravity's torque on a joint that the model takes for vertical"
    set_ups: ClassVar[Mapping[str, str]] = {"link_inertial_error": LEVEL_OR_LINKS, "encoder_offset": LEVEL_OR_ZERO}
    defining = ("tilt_x_rad", "tilt_y_rad")
    typical = Typical("tilt_x_rad", 0.15)
    opposite = frozenset({"tilt_x_rad", "tilt_y_rad"})  # the simulated arm tells how gravity turns, not the base
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": exactly_as("fixed joint `level_to_base` above the base, turned by the tilt"),
        "mjcf": exactly_as("gravity of option"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return near_one_pose(session)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        found = []
        for run in session.runs:
            gravity = np.asarray(run.arm.model.gravity.linear)
            turns = [run.arm.with_gravity(-np.cross(axis, gravity)) for axis in np.eye(3)[:2]]
            found.append(np.stack([turned.gravity(run.motion.q) for turned in turns], axis=-1))
        return found

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {
            "tilt_x_rad": coefficient_interval(0, coefficients, covariance),
            "tilt_y_rad": coefficient_interval(1, coefficients, covariance),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        tilt = Range(-LARGEST_SMALL_ANGLE, LARGEST_SMALL_ANGLE, "mounted otherwise: turn the arm in the URDF")
        return {"tilt_x_rad": tilt, "tilt_y_rad": tilt}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        x, y = (figures[f"tilt_{axis}_rad"].words("mrad", 1e3) for axis in "xy")
        return f"level the base: it is turned by {x} about x and {y} about y; or turn the arm in the URDF"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.full(2, LARGEST_TILT)


def point_mass(centre: Float[Array, " 3"]) -> Float[Array, " 10"]:
    """Inertial parameters of a unit point mass."""
    inertia = (centre @ centre) * np.eye(3) - np.outer(centre, centre)
    return np.concatenate([[1.0], centre, _six(inertia)])


def moment_change(centre: Float[Array, " 3"]) -> Float[Array, "10 3"]:
    """Change of inertial parameters per change of the first moment, for a body that is shifted."""
    columns = []
    for axis in np.eye(3):
        inertia = 2 * (centre @ axis) * np.eye(3) - np.outer(centre, axis) - np.outer(axis, centre)
        columns.append(np.concatenate([[0.0], axis, _six(inertia)]))
    return np.stack(columns, axis=1)


def _six(inertia: Float[Array, "3 3"]) -> Float[Array, " 6"]:
    """Entries in the order xx, xy, yy, xz, yz, zz."""
    return np.asarray(inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])


def _flange_direction(arm: ArmModel) -> Float[Array, " 3"]:
    """Direction in the last link's frame in which tools are mounted: its joint's axis, away from the arm.

    The last link lies behind the flange and in front of the joint, or the reverse where frames sit at the flange: what
    is away from the arm is told by the way that the last joint is mounted.
    """
    axis = np.asarray(arm.joint_axes[-1])
    placement = arm.model.jointPlacements[arm.n]
    outward = float(placement.translation @ (placement.rotation @ axis))
    return -axis if outward < 0.0 else axis


def _acting_axes(arm: ArmModel) -> list[int]:
    """Axes of the last link's frame along which a shifted load changes some torque."""
    return [column - 1 for column in _acting(arm, arm.n - 1) if column > 0]


def _link_change(arm: ArmModel, link: int) -> Float[Array, "10 4"]:
    """Change of a link's parameters per kilogram of its own density, and per shift of its first moment."""
    parameters = arm.inertial_parameters[10 * link : 10 * link + 10]
    mass = float(parameters[0])
    if mass <= 0.0:
        return np.column_stack([point_mass(np.zeros(3)), moment_change(np.zeros(3))])
    return np.column_stack([parameters / mass, moment_change(parameters[1:4] / mass)])


def _acting(arm: ArmModel, link: int) -> list[int]:
    """Which columns of `_link_change` act on some torque: a matter of the arm, not of the motion."""
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, STRUCTURE_STATES, arm.n))
    torque = arm.regressor(q, dq, ddq)[:, :, 10 * link : 10 * link + 10] @ _link_change(arm, link)
    size = np.sqrt(np.mean(torque**2, axis=(0, 1)))
    return [int(k) for k in np.flatnonzero(size > LEAST_COLUMN * max(float(size.max()), 1e-12))]
