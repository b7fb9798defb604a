"""Masses that are not where the URDF has them: a load, a link, gravity itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ident.arrays import Array, Float
from ident.effects.added_body import (
    LARGEST_TOOL_SHARE,
    PLACE,
    Places,
    acting,
    link_law,
    moment_about_axis,
    place_of,
    placed,
    places_of_tuning,
    weighs,
)
from ident.effects.base import Effect, Interval, Range, SessionContext, Variant
from ident.effects.intervals import SizePrior, coefficient_interval, delta_interval, linear_interval
from ident.effects.session_context import arm_mass, arm_reach
from ident.effects.settings import RIGID_BODY as LIMIT
from ident.robot.arm import ArmModel
from ident.units import MASS, MOMENT

NOWHERE: Places = MappingProxyType({})
# A load that is laid out as more of the last link.
LIKE_LINK = "like_link"
# Surface of the unit sphere in spaces of none to three axes.
SPHERES = (1.0, 2.0, 2.0 * np.pi, 4.0 * np.pi)
# Beyond the ends of a range of logarithms, where a factor of two is one deviation: the area of
# both tails.
BOTH_TAILS = float(np.sqrt(2.0 * np.pi) * np.log(2.0))


class UnknownPayload(Effect):
    """A load at the last link that the model doesn't know: mass m at a centre c, in the last link's
    frame.

    The four columns belong to m and m (c − c₀), with the inertia that a point mass has near c₀: a
    reach along the last joint's axis, or the place that was found for it. The search also lays it
    out as more of the last link: how a body spreads about its centre is known of neither, and must
    not decide between the two names. Columns that act on no torque, whatever the motion, are left
    out: the height of what hangs on a SCARA.

    Args:
        places: Where a body was found on the last link, if one was.
    """

    id = "payload"

    def __init__(self, places: Places = NOWHERE) -> None:
        self.places = places

    def screened(
        self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
    ) -> UnknownPayload:
        return UnknownPayload(places_of_tuning(session, [session.n - 1]))

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return (*self._points(session), Variant(shape={LIKE_LINK: 1.0}))

    def _points(self, session: SessionContext) -> tuple[Variant, ...]:
        """Places of a point mass."""
        places = placed(self.places, session.runs[0].arm, session.n - 1)
        # As many points as without: the place was found, not chosen among more.
        usual = LIMIT.payload_reaches[: len(LIMIT.payload_reaches) - len(places)]
        return (*(Variant(shape={"reach_m": reach}) for reach in usual), *places)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """All places of a point mass where the coarse variant is a link's ten numbers, else that
        variant: models take a point mass.
        """
        return self._points(session) if LIKE_LINK in variant.shape else (variant,)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        change = self._law(session.runs[0].arm, variant)
        return [run.regressor[:, :, -10:] @ change for run in session.runs]

    def _law(self, arm: ArmModel, variant: Variant) -> Float[Array, "10 k"]:
        """Change of the last link's numbers by the columns."""
        place = dict(zip(PLACE, map(float, load_place(arm, variant)), strict=True))
        law = link_law(
            arm, arm.n - 1, Variant() if LIKE_LINK in variant.shape else Variant(shape=place)
        )
        return law[:, [0, *(axis + 1 for axis in _acting_axes(arm))]]

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        arm = session.runs[0].arm
        last = arm.n - 1
        nominal = load_place(arm, variant)
        far = LARGEST_TOOL_SHARE * arm_reach(arm)
        mass = coefficient_interval(0, coefficients, covariance)
        moment = moment_about_axis(arm, last, self._law(arm, variant), coefficients, covariance)
        centres = {
            f"com_{axis}_m": Interval(nominal[k], nominal[k] - far, nominal[k] + far, "both")
            for k, axis in enumerate("xyz")
        }
        for slot, k in enumerate(_acting_axes(arm), start=1):
            # Without a mass there is no centre of one; a gram keeps the quotient finite.
            centres[f"com_{'xyz'[k]}_m"] = delta_interval(
                lambda c, k=k, slot=slot: nominal[k] + c[slot] / max(c[0], 1e-3),
                coefficients,
                covariance,
            )
        determined = weighs(arm, last)
        lightest = moment.low / max(arm_reach(arm), 1e-3)
        # what may weigh next to nothing has its centre anywhere
        if mass.low <= 0.0 or not determined:
            value = max(mass.value, lightest)
            most = mass.high if determined else arm_mass(arm)
            mass = Interval(value, lightest, max(most, value), "low" if determined else "both")
            centres = {
                name: Interval(float(np.clip(centre.value, -far, far)), -far, far, "both")
                for name, centre in centres.items()
            }
        return {"mass_kg": mass, **centres, "moment_about_axis_kgm": moment}

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        if estimates["mass_kg"].open or estimates["mass_kg"].low <= 0.0:
            moment = estimates["moment_about_axis_kgm"].words(MOMENT)
            return (
                f"weigh the tool: a load of {moment} about the last axis is not in the model; "
                "give it as [payload]"
            )
        mass = estimates["mass_kg"].words(MASS)
        return (
            f"weigh the tool: {mass} are not in the model; give them as [payload] of session.toml"
        )

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        arm = session.runs[0].arm
        levers = np.full(len(_acting_axes(arm)), LIMIT.largest_lever_share * arm_reach(arm))
        return LIMIT.largest_payload_share * arm_mass(arm) * np.concatenate([[1.0], levers])

    def size_prior(self, session: SessionContext, joint: int, variant: Variant) -> SizePrior:
        """A light load is as likely as one a few times as heavy, a near one as one farther out.

        Mass and distance of the centre count by their logarithms: the mass up to the arm's own,
        the distance up to a tool's reach. Where it is nearer than the nearest place at which loads
        are laid out, all places are alike. Lighter than a tool, heavier than the arm, or farther
        than a tool by a factor of two is one deviation off.
        """
        arm = session.runs[0].arm
        heaviest = arm_mass(arm)
        lightest = LIMIT.least_payload_share * heaviest
        near = min(LIMIT.payload_reaches)
        far = max(LARGEST_TOOL_SHARE * arm_reach(arm), 2.0 * near)
        largest = self.prior_scale(session, joint, variant)
        axes = _acting_axes(arm)
        moment_of_mass = self._law(arm, variant)[1:4, 0][axes]
        masses = np.log(heaviest / lightest) + BOTH_TAILS
        ratio = np.log(far / near)
        shells = ratio + 0.5 * BOTH_TAILS + 1.0 / max(len(axes), 1)
        places = SPHERES[len(axes)] * shells

        def log_density(coefficients: Float[Array, "... k"]) -> Float[np.ndarray, "..."]:
            weighs = coefficients[..., 0] > 0.0
            mass = np.where(weighs, coefficients[..., 0], heaviest)
            likely = np.clip(mass, lightest, heaviest)
            doublings = np.log2(mass / likely)
            density = -np.log(mass * masses) - 0.5 * doublings**2
            if len(axes):
                centre = moment_of_mass + coefficients[..., 1:] / mass[..., None]
                distance = np.maximum(np.linalg.norm(centre, axis=-1), near)
                usual = np.minimum(distance, far)
                of_place = len(axes) * np.log(distance * mass)
                density = density - np.log(places) - of_place
                density = density - 0.5 * np.log2(distance / usual) ** 2
            return np.where(weighs, density, -np.inf)

        return SizePrior(0.5 * largest, log_density, weighs=True)


class LinkInertialError(Effect):
    """A link of another mass, or with its centre of mass elsewhere.

    The columns belong to more mass, of the link's own density or of a body at the place that was
    found for it, and to shifts of the first moment m c, whose inertia about the joint goes along.
    Columns that act on no torque, whatever the motion, are left out.

    Args:
        places: Where a body was found on each link on which one was.
    """

    id = "link_inertial_error"

    def __init__(self, places: Places = NOWHERE) -> None:
        self.places = places

    def screened(
        self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
    ) -> LinkInertialError:
        return LinkInertialError(places_of_tuning(session, range(session.n)))

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return (Variant(), *placed(self.places, session.runs[0].arm, joint))

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        change = _acting_law(session.runs[0].arm, joint, variant)
        of_link = slice(10 * joint, 10 * joint + 10)
        return [run.regressor[:, :, of_link] @ change for run in session.runs]

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        arm = session.runs[0].arm
        change = _acting_law(arm, joint, variant)
        # Drawn to zero where the prior says more than the recordings.
        widest = (LIMIT.widest * self.prior_scale(session, joint, variant)) ** 2
        gain = widest[:, None] * np.linalg.inv(np.diag(widest) + covariance)
        coefficients = gain @ coefficients
        covariance = gain @ covariance
        mass = linear_interval(change[0], coefficients, covariance)
        none = -session.urdf_mass(joint)
        value = max(mass.value, none)  # a link weighs something
        if not weighs(arm, joint):
            mass = Interval(value, none, max(arm_mass(arm), value), "both")
        elif mass.low < none <= mass.high:
            mass = Interval(value, none, mass.high, "low")
        estimates = {"mass_change_kg": mass}
        for k, axis in enumerate("xyz", start=1):
            estimates[f"moment_change_{axis}_kgm"] = linear_interval(
                change[k], coefficients, covariance
            )
        about = moment_about_axis(arm, joint, change, coefficients, covariance)
        return {**estimates, "moment_about_axis_kgm": about}

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        """A link weighs something, no more than the whole arm, and its centre lies within the arm's
        reach.
        """
        arm = session.runs[0].arm
        mass = estimates["mass_change_kg"]
        mass_of_link = session.urdf_mass(joint)
        whole = arm_mass(arm)
        moment = (mass_of_link + abs(mass.value)) * arm_reach(arm)
        centre = Range(-moment, moment, "the link's centre would lie beyond the arm's reach")
        ranges = {f"moment_change_{axis}_kgm": centre for axis in "xyz"}
        if mass.low > -mass_of_link or mass.open:
            return ranges
        return {
            "mass_change_kg": Range(-mass_of_link, whole, "the link's mass would be negative"),
            **ranges,
        }

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        mass = estimates["mass_change_kg"]
        moment = estimates.get("moment_about_axis_kgm")
        change = f"mass is off by {mass.words(MASS)}"
        if moment is not None and (mass.open or mass.low <= 0.0 <= mass.high):
            change = f"moment about the joint's axis is off by {moment.words(MOMENT)}"
        return (
            f"correct the link behind {where}: beside what tuning changes, its {change}; `ident "
            "patch` writes both"
        )

    def tells_law(self, variant: Variant) -> bool:
        return bool(variant.shape)

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Where the body was laid out: its second moments hang on it."""
        return {name: float(shape[name]) for name in PLACE if name in shape}

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        arm = session.runs[0].arm
        link = arm.inertial_parameters[10 * joint : 10 * joint + 10]
        mass = LIMIT.largest_inertia_share * max(
            float(link[0]), LIMIT.least_link_share * arm_mass(arm)
        )
        least = LIMIT.least_link_length * arm_reach(arm)
        moment = float(np.linalg.norm(link[1:4]))
        lever = max(moment / max(float(link[0]), 1e-9), least)
        law = link_law(arm, joint, variant)
        moment = mass * lever
        sizes = np.array([mass, moment, moment, moment])
        return sizes[acting(arm, joint, law)]

    def size_prior(self, session: SessionContext, joint: int, variant: Variant) -> SizePrior:
        """Student's t about zero for the mass, and for the moment beside that of so much of the
        link's own density.
        """
        usual = SizePrior.about_zero(0.5 * self.prior_scale(session, joint, variant))
        if not variant.shape:
            return usual
        arm = session.runs[0].arm
        law = link_law(arm, joint, variant)
        moment_of_link = link_law(arm, joint, Variant())[1:4, 0]
        active = acting(arm, joint, law)
        beside = np.concatenate([[0.0], law[1:4, 0] - moment_of_link])[active]
        first = active[0] == 0

        def log_density(coefficients: Float[Array, "... k"]) -> Float[np.ndarray, "..."]:
            return usual.log_density(
                coefficients + beside * coefficients[..., :1] if first else coefficients
            )

        return SizePrior(usual.deviation, log_density)


class GravityMisalignment(Effect):
    """A base that is not level: turned by small angles about its own x and y axes.

    Gravity in the base frame changes by −ω × g, and the torque is linear in gravity.
    """

    id = "gravity_misalignment"

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        columns = []
        for run in session.runs:
            gravity = np.asarray(run.arm.model.gravity.linear)
            turns = [np.cross(axis, gravity) for axis in np.eye(3)[:2]]
            turned = [run.arm.with_gravity(-turn) for turn in turns]
            columns.append(np.stack([arm.gravity(run.motion.q) for arm in turned], axis=-1))
        return columns


def _acting_axes(arm: ArmModel) -> list[int]:
    """Axes of the last link's frame along which a shifted load changes some torque."""
    last = arm.n - 1
    return [
        column - 1 for column in acting(arm, last, link_law(arm, last, Variant())) if column > 0
    ]


def load_place(arm: ArmModel, variant: Variant) -> Float[Array, " 3"]:
    """About which place a load is laid out, in the last link's frame [m].

    A reach goes along the last joint's axis, away from the arm. The last link lies behind the
    flange, before the joint, or the reverse where frames sit at the flange: which way is away is
    seen from how the last joint is mounted.

    Args:
        arm: The arm.
        variant: Has a reach, a place, or that the load is like the last link.
    """
    if LIKE_LINK in variant.shape:
        return link_law(arm, arm.n - 1, Variant())[1:4, 0]
    if "reach_m" not in variant.shape:
        return place_of(variant)
    axis = np.asarray(arm.joint_axes[-1])
    placement = arm.model.jointPlacements[arm.n]
    inward = float(placement.translation @ (placement.rotation @ axis)) < 0.0
    return (-axis if inward else axis) * variant.shape["reach_m"]


def _acting_law(arm: ArmModel, link: int, variant: Variant) -> Float[Array, "10 k"]:
    """Change of a link's numbers, by the columns that act on some torque."""
    law = link_law(arm, link, variant)
    return law[:, acting(arm, link, law)]
