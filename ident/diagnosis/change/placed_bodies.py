"""Bodies with the inertia that they have where they were found, whatever the link on which they sit.

A mass m at c has the first moment m c and second moments that grow with c². The catalogue's columns are straight lines
about a place known beforehand: a link's own density, a tool a reach off the flange. A body a distance d beside that
lacks second moments of about m d², which a second body elsewhere makes up for, and is then told beside the true one.
Between two sets nothing of that is hidden by the model's own errors. So each body is laid out once more about the place
c that a first look found for it, where what a straight line lacks is of second order in the error of c. These are the
steps of Gauss and Newton for the four figures of a body. Links near an upright base are left as they are: there a mass
shows by its moments alone, and where it is can't be told.

Source: Atkeson, An and Hollerbach 1986 (inertial parameters of a load, in which the torque is linear); Nocedal and
Wright 2006, chapter 10 (Gauss–Newton).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import MASS, changes
from ident.diagnosis.change.readings import BODIES
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.least_squares import project
from ident.diagnosis.selection.search import Search
from ident.effects.base import Effect, Interval, SessionContext, Variant, delta_interval, linear_interval
from ident.effects.plausible import arm_reach
from ident.effects.rigid_body import LARGEST_TOOL_SHARE, LinkInertialError, UnknownPayload, moment_change, point_mass
from ident.robot.arm import ArmModel

PLACE = ("x_m", "y_m", "z_m")
# A body's mass that is this share of the arm's is none: its place can't be told [1].
LEAST_MASS_SHARE = 1e-4
# States at which it is asked which columns act on a torque, and what share of the largest is nothing.
STATES, LEAST_COLUMN = 30, 1e-6

Places = Mapping[int, Float[Array, " 3"]]
"""Of each link of the arm by its number, where a body was found on it, in its joint's frame [m]."""


class PlacedPayload(UnknownPayload):
    """A load at the last link whose inertia is that of a point mass at a place that was found."""

    def __init__(self, places: Places) -> None:
        self.places = places

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        placed = _placed(self.places, session, session.n - 1)
        usual = super().variants(session, joint)
        # As many points as before: the place was found, not chosen among more.
        return (*usual[: len(usual) - len(placed)], *placed)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        if "reach_m" in variant.shape:
            return super().columns(session, joint, variant)
        return _columns(session, session.n - 1, variant)

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        if "reach_m" in variant.shape:
            return super().parameters(session, joint, variant, coefficients, covariance)
        change, place = _law(session.runs[0].arm, session.n - 1, variant)[:4], _place(variant)
        least = LEAST_MASS_SHARE * _weight(session.runs[0].arm)
        found = {MASS: linear_interval(change[0], coefficients, covariance)}
        for k, axis in enumerate("xyz", start=1):
            moments = change[k]
            if not moments[1:].any():  # a shift along this axis acts on nothing
                far = LARGEST_TOOL_SHARE * arm_reach(session.runs[0].arm)
                found[f"com_{axis}_m"] = Interval(place[k - 1], place[k - 1] - far, place[k - 1] + far)
                continue
            found[f"com_{axis}_m"] = delta_interval(
                lambda c, moments=moments: (moments @ c) / max(float(change[0] @ c), least), coefficients, covariance
            )
        return found


class PlacedLinkError(LinkInertialError):
    """A link of another mass: of its own density, or of a body at a place that was found on it."""

    def __init__(self, places: Places) -> None:
        self.places = places

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return (*super().variants(session, joint), *_placed(self.places, session, joint))

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return _columns(session, joint, variant) if variant.shape else super().columns(session, joint, variant)

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        if not variant.shape:
            return super().parameters(session, joint, variant, coefficients, covariance)
        change = _law(session.runs[0].arm, joint, variant)[:4]
        found = {"mass_change_kg": linear_interval(change[0], coefficients, covariance)}
        for k, axis in enumerate("xyz", start=1):
            found[f"moment_change_{axis}_kgm"] = linear_interval(change[k], coefficients, covariance)
        return found


def place_bodies(search: Search, others: Sequence[Group], session: SessionContext) -> tuple[Effect, ...]:
    """All changes that are asked for, each body about the place at which it alone would explain most.

    Args:
        search: A search over a first look.
        others: What changed beside the body.
        session: The runs.
    """
    model = project(search.evidence.gram(), search.evidence, search.prior, others)
    best = [group for _, group in search.best_by_key(model).values() if group.effect.id in BODIES]
    places: dict[str, dict[int, Float[Array, " 3"]]] = {name: {} for name in BODIES}
    arm = session.runs[0].arm
    for group in best:
        _, scaled = model.gain(group)
        beta = scaled / search.evidence.scale[group.columns]
        place = _centre(group, session, beta)
        if place is not None:
            link = arm.n - 1 if group.effect.scope == "arm" else group.joint
            places[group.effect.id][link] = place
    payload, link_error = places[UnknownPayload.id], places[LinkInertialError.id]
    placed = {UnknownPayload.id: PlacedPayload(payload), LinkInertialError.id: PlacedLinkError(link_error)}
    return tuple(placed.get(effect.id, effect) for effect in changes())


def _centre(group: Group, session: SessionContext, beta: Float[Array, " k"]) -> Float[Array, " 3"] | None:
    """Where a body is by its estimate, no farther out than a tool's centre; None of what weighs nothing."""
    arm = session.runs[0].arm
    asked = group.effect.asked(session)
    figures = group.effect.parameters(asked, group.joint, group.variant, beta, np.zeros((len(beta), len(beta))))
    if group.effect.id == UnknownPayload.id:
        mass = figures[MASS].value
        moment = abs(mass) * np.array([figures[f"com_{axis}_m"].value for axis in "xyz"])
        mass = abs(mass)
    else:
        mass = figures["mass_change_kg"].value
        moment = np.array([figures[f"moment_change_{axis}_kgm"].value for axis in "xyz"])
    if abs(mass) < LEAST_MASS_SHARE * _weight(arm):
        return None
    place = moment / mass
    far = LARGEST_TOOL_SHARE * arm_reach(arm)
    return np.asarray(place * min(1.0, far / max(float(np.linalg.norm(place)), 1e-12)))


def _placed(places: Places, session: SessionContext, link: int) -> tuple[Variant, ...]:
    """A body about its place, if it was found and turns any joint there."""
    if link not in places or not _weighs(session.runs[0].arm, link):
        return ()
    variant = Variant(shape=dict(zip(PLACE, map(float, places[link]), strict=True)))
    return (variant,) if _law(session.runs[0].arm, link, variant).size else ()


def _place(variant: Variant) -> Float[Array, " 3"]:
    return np.array([variant.shape[name] for name in PLACE])


def _columns(session: SessionContext, link: int, variant: Variant) -> list[Float[Array, "T ..."]]:
    change = _law(session.runs[0].arm, link, variant)
    return [run.regressor[:, :, 10 * link : 10 * link + 10] @ change for run in session.runs]


def _law(arm: ArmModel, link: int, variant: Variant) -> Float[Array, "10 k"]:
    """Change of a link's parameters per kilogram at a place, and per shift of its moment; what acts on a torque."""
    place = _place(variant)
    change = np.column_stack([point_mass(place), moment_change(place)])
    size = np.sqrt(np.mean((_random_regressor(arm, link) @ change) ** 2, axis=0))
    return np.asarray(change[:, size > LEAST_COLUMN * max(float(size.max()), 1e-12)])


def _weighs(arm: ArmModel, link: int) -> bool:
    """Whether a mass on a link does what no moments and no inertia of that link do; a matter of the arm."""
    own = _random_regressor(arm, link)
    mass, others = own[:, 0], own[:, 1:]
    left = mass - others @ np.linalg.lstsq(others, mass, rcond=None)[0]
    return bool(np.linalg.norm(left) > LEAST_COLUMN * max(float(np.linalg.norm(own)), 1e-12))


def _random_regressor(arm: ArmModel, link: int) -> Float[Array, "M 10"]:
    """What a link's parameters do to all torques in some states."""
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, STATES, arm.n))
    return arm.regressor(q, dq, ddq)[:, :, 10 * link : 10 * link + 10].reshape(-1, 10)


def _weight(arm: ArmModel) -> float:
    """Mass of the whole arm [kg]."""
    return float(arm.inertial_parameters[::10].sum())
