"""Masses that are not where the URDF has them: a load, a link, gravity itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.added_body import (
    LARGEST_TOOL_SHARE,
    PLACE,
    Places,
    acting,
    link_law,
    moment_change,
    place_of,
    placed,
    places_of_tuning,
    point_mass,
)
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
NOWHERE: Places = MappingProxyType({})
# A load that is laid out as more of the last link.
LIKE_LINK = "like_link"


class UnknownPayload(Effect):
    """A load at the last link that the model doesn't know: mass m at a centre c, in the last link's frame.

    The four columns belong to m and m (c − c₀), with the inertia that a point mass has near c₀: a reach along the last
    joint's axis, or the place that was found for it. The search also lays it out as more of the last link: how a body
    spreads about its centre is known of neither, and must not decide between the two names. Columns that act on no
    torque, whatever the motion, are left out: the height of what hangs on a SCARA.

    Args:
        places: Where a body was found on the last link, if one was.
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

    def __init__(self, places: Places = NOWHERE) -> None:
        self.places = places

    def screened(self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]) -> UnknownPayload:
        return UnknownPayload(places_of_tuning(session, [session.n - 1]))

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return near_one_pose(session)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return (*self._points(session), Variant(shape={LIKE_LINK: 1.0}))

    def _points(self, session: SessionContext) -> tuple[Variant, ...]:
        """Places of a point mass."""
        found = placed(self.places, session.runs[0].arm, session.n - 1)
        # As many points as without: the place was found, not chosen among more.
        usual = PAYLOAD_REACHES[: len(PAYLOAD_REACHES) - len(found)]
        return (*(Variant(shape={"reach_m": reach}) for reach in usual), *found)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """Figures are told of a point mass, as models take them."""
        return self._points(session) if LIKE_LINK in variant.shape else (variant,)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        arm = session.runs[0].arm
        nominal, axes = _load_place(arm, variant), _acting_axes(arm)
        unit = link_law(arm, arm.n - 1, Variant())[:, 0] if LIKE_LINK in variant.shape else point_mass(nominal)
        change = np.column_stack([unit, moment_change(nominal)[:, axes]])
        return [run.regressor[:, :, -10:] @ change for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        nominal = _load_place(session.runs[0].arm, variant)
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

    The columns belong to more mass, of the link's own density or of a body at the place that was found for it, and to
    shifts of the first moment m c, whose inertia about the joint goes along. Columns that act on no torque, whatever
    the motion, are left out.

    Args:
        places: Where a body was found on each link on which one was.
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

    def __init__(self, places: Places = NOWHERE) -> None:
        self.places = places

    def screened(self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]) -> LinkInertialError:
        return LinkInertialError(places_of_tuning(session, range(session.n)))

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return near_one_pose(session)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return (Variant(), *placed(self.places, session.runs[0].arm, joint))

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        change = _acting_law(session.runs[0].arm, joint, variant)
        return [run.regressor[:, :, 10 * joint : 10 * joint + 10] @ change for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        change = _acting_law(session.runs[0].arm, joint, variant)[:4]
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

    def tells_law(self, variant: Variant) -> bool:
        return bool(variant.shape)

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """Where the body was laid out: its second moments hang on it."""
        return {name: float(shape[name]) for name in PLACE if name in shape}

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        arm = session.runs[0].arm
        link = arm.inertial_parameters[10 * joint : 10 * joint + 10]
        mass = LARGEST_INERTIA_SHARE * max(float(link[0]), 0.1)
        lever = max(float(np.linalg.norm(link[1:4])) / max(float(link[0]), 1e-9), 0.1)
        law = link_law(arm, joint, variant)
        return np.array([mass, mass * lever, mass * lever, mass * lever])[acting(arm, joint, law)]

    def size_prior(self, session: SessionContext, joint: int, variant: Variant) -> SizePrior:
        """Student's t about zero for the mass, and for the moment beside that of so much of the link's own density."""
        usual = SizePrior.about_zero(0.5 * self.prior_scale(session, joint, variant))
        if not variant.shape:
            return usual
        arm = session.runs[0].arm
        law = link_law(arm, joint, variant)
        own = link_law(arm, joint, Variant())[1:4, 0]
        kept = acting(arm, joint, law)
        beside = np.concatenate([[0.0], law[1:4, 0] - own])[kept]
        first = kept[0] == 0

        def log_density(coefficients: Float[Array, " k"]) -> float:
            return usual.log_density(coefficients + beside * coefficients[0] if first else coefficients)

        return SizePrior(usual.deviation, log_density)


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
    last = arm.n - 1
    return [column - 1 for column in acting(arm, last, link_law(arm, last, Variant())) if column > 0]


def _load_place(arm: ArmModel, variant: Variant) -> Float[Array, " 3"]:
    """About which place a load is laid out, in the last link's frame [m]."""
    if LIKE_LINK in variant.shape:
        return link_law(arm, arm.n - 1, Variant())[1:4, 0]
    reach = variant.shape.get("reach_m")
    return place_of(variant) if reach is None else _flange_direction(arm) * reach


def _acting_law(arm: ArmModel, link: int, variant: Variant) -> Float[Array, "10 k"]:
    """Change of a link's numbers, by the columns that act on some torque."""
    law = link_law(arm, link, variant)
    return law[:, acting(arm, link, law)]
