"""A body on a link: what it does to the link's ten inertial numbers, and where tuning says that one
sits.

A mass m at c has the first moment m c and second moments that grow with c². Columns are straight
lines about a place known beforehand: a link's own density, a tool a reach off the flange. A body a
distance d beside that lacks second moments of about m d², for which the tuned inertias of every
link would have to make up. So each body is also laid out about a place that a first look found for
it, where what a straight line lacks is of second order in the error of c. Links near an upright
base are left as they are: there a mass shows by its moments alone, where it is stays open.

Source: Atkeson, An and Hollerbach 1986 (inertial parameters of a load, in which the torque is
linear); Nocedal and Wright 2006, chapter 10 (Gauss–Newton).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.effects.base import Interval, SessionContext, Variant
from ident.effects.intervals import amplitude_interval
from ident.effects.session_context import arm_mass, arm_reach, rated_torque, sampled_states
from ident.effects.settings import ADDED_BODY as LIMIT
from ident.laws.acting import moment_change, point_mass
from ident.robot.arm import ArmModel

PLACE = ("x_m", "y_m", "z_m")
# Distance of a tool's centre from the flange, as a share of the arm's reach.
LARGEST_TOOL_SHARE = 0.5

Places = Mapping[int, Float[Array, " 3"]]
"""Of each link of the arm by its number, where a body was found on it, in its joint's frame [m]."""


def link_law(arm: ArmModel, link: int, variant: Variant) -> Float[Array, "10 4"]:
    """Change of a link's ten inertial numbers per kilogram, and per shift of its first moment.

    Of a body at the variant's place, or, where it has none, of more of the link's own density.

    Args:
        arm: The arm.
        link: Index of the link.
        variant: Its shape may have the place.
    """
    parameters = arm.inertial_parameters[10 * link : 10 * link + 10]
    mass = float(parameters[0])
    placed_there = all(name in variant.shape for name in PLACE)
    if placed_there or mass <= 0.0:
        place = place_of(variant) if placed_there else np.zeros(3)
        return np.column_stack([point_mass(place), moment_change(place)])
    return np.column_stack([parameters / mass, moment_change(parameters[1:4] / mass)])


def acting(arm: ArmModel, link: int, law: Float[Array, "10 k"]) -> list[int]:
    """Indices of the columns of a law that act on some torque: a matter of the arm, not of the
    motion.

    Args:
        arm: The arm.
        link: Index of the link.
        law: Change of the link's ten numbers by each coefficient.
    """
    size = np.sqrt(np.mean((_structure(arm, link) @ law) ** 2, axis=0))
    least = LIMIT.least_column * max(float(size.max()), 1e-12)
    return [int(column) for column in np.flatnonzero(size > least)]


def moment_about_axis(
    arm: ArmModel, link: int, law: Float[Array, "10 k"], coefficients: Array, covariance: Array
) -> Interval:
    """Size of a body's first moment about its joint's axis [kg m], with a 95 % interval.

    It is what gravity shows of the body, whatever it weighs.

    Args:
        arm: The arm.
        link: Index of the link that has the body.
        law: Change of the link's ten numbers by each coefficient.
        coefficients, covariance: Estimates.
    """
    axis = arm.joint_axes[link]
    across = (np.eye(3) - np.outer(axis, axis)) @ law[1:4]
    return amplitude_interval(across @ coefficients, across @ covariance @ across.T)


def place_of(variant: Variant) -> Float[Array, " 3"]:
    """Where a variant has its body, in the link's frame [m].

    Raises:
        KeyError: It has no place.
    """
    return np.array([variant.shape[name] for name in PLACE])


def placed(places: Places, arm: ArmModel, link: int) -> tuple[Variant, ...]:
    """The variant of a body about the place that was found for it on a link.

    Empty where none was found, where the link's mass can't be told, or the body turns no joint.

    Args:
        places: The places by index of the link.
        arm: The arm.
        link: Index of the link.
    """
    if link not in places or not weighs(arm, link):
        return ()
    variant = _at_place(places[link])
    law = link_law(arm, link, variant)
    return (variant,) if acting(arm, link, law) else ()


def _at_place(place: Float[Array, " 3"]) -> Variant:
    """The variant that has its body at a place [m]."""
    return Variant(shape=dict(zip(PLACE, map(float, place), strict=True)))


def centre_of(arm: ArmModel, mass: float, moment: Float[Array, " 3"]) -> Float[Array, " 3"] | None:
    """Where a body is, in the link's frame, no farther out than a tool's centre [m].

    Args:
        arm: The arm.
        mass: The body's [kg].
        moment: Its first moment [kg m].

    Returns:
        None of a body that weighs nothing.
    """
    if abs(mass) < LIMIT.least_mass_share * arm_mass(arm):
        return None
    place = moment / mass
    far = LARGEST_TOOL_SHARE * arm_reach(arm)
    distance = max(float(np.linalg.norm(place)), 1e-12)
    return np.asarray(place * min(1.0, far / distance))


def places_of_tuning(session: SessionContext, links: Iterable[int]) -> Places:
    """On each of some links the place of the one body there that explains best what tuning changed
    of all inertias.

    Args:
        session: The runs, with the tuned change of inertias.
        links: Indices of the links.

    Returns:
        By index of the link [m]; empty where nothing was tuned or a place can't be told.
    """
    if session.tuned is None or not session.tuned.any():
        return {}
    arm = session.runs[0].arm
    rated = np.array([rated_torque(session, j) for j in range(session.n)])
    regressor = arm.regressor(*sampled_states(session)) / rated[:, None]
    changed = (regressor @ session.tuned).ravel()
    places = {}
    for link in links:
        of_link = regressor[:, :, 10 * link : 10 * link + 10].reshape(-1, 10)
        variant = Variant()
        for _ in range(LIMIT.place_steps):
            law = link_law(arm, link, variant)
            coefficients = np.linalg.lstsq(of_link @ law, changed, rcond=1e-9)[0]
            mass, *moment = law[:4] @ coefficients
            place = centre_of(arm, float(mass), np.array(moment))
            if place is None:
                break
            variant = _at_place(place)
        else:
            places[link] = place_of(variant)
    return places


@lru_cache(maxsize=64)
def weighs(arm: ArmModel, link: int) -> bool:
    """Whether a mass on a link does what no moments and no inertia of that link do.

    A matter of the arm: of a link that turns about a fixed point gravity tells the first moment
    alone, and how heavy it is hangs on how it is spread, which nobody knows.
    """
    structure = _structure(arm, link)
    mass = structure[:, 0]
    others = structure[:, 1:]
    left = mass - others @ np.linalg.lstsq(others, mass, rcond=None)[0]
    whole = max(float(np.linalg.norm(structure)), 1e-12)
    return bool(np.linalg.norm(left) > LIMIT.least_column * whole)


@lru_cache(maxsize=64)
def _structure(arm: ArmModel, link: int) -> Float[Array, "M 10"]:
    """What a link's numbers do to all torques in some states."""
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, LIMIT.structure_states, arm.n))
    columns = range(10 * link, 10 * link + 10)
    return freeze(arm.regressor(q, dq, ddq, columns).reshape(-1, 10))
