"""The search on a session: the readings that explain most, best first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.checks.conventions.closely import Scored
from ident.checks.conventions.description import Orders, price
from ident.checks.conventions.hypothesis import COMPENSATED, Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log, usual_orders
from ident.checks.conventions.search import Search
from ident.checks.conventions.settings import DESCRIPTION, SEARCH
from ident.checks.filtered_run import filter_run
from ident.checks.settings import USUAL_EFFORT
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

# What is said of the URDF's masses alone: a factor of all of them may be the effort's unit as well.
OF_MASSES = frozenset({"body", "masses"})
# Links that must be alike for their numbers to be placeholders: two are alike in small arms.
FEWEST_ALIKE = 3
# Changes that are told by fitted numbers.
OF_NUMBERS = OF_MASSES | {"mass_factor"}


@dataclass(frozen=True)
class Conventions:
    """What the search found."""

    as_it_is: Scored  # log and URDF as they say
    best: Scored
    second: Scored | None
    # What of the best leaves the log as it says.
    of_urdf: Scored | None = None
    guess: Scored | None = None  # the log as it says, the URDF's masses being guesses
    of_masses: Scored | None = None  # the likeliest that changes the URDF's masses alone
    has_placeholders: bool = False  # whether the URDF's masses are surely guesses

    def led_by(self, reading: Scored) -> Conventions:
        """The findings with another reading as the best, and the best as the second."""
        if reading is self.best:
            return self
        return replace(self, best=reading, second=self.best)

    @property
    def is_told_apart(self) -> bool:
        """Whether the log tells the best reading from the second: by odds of as much as is sure.

        Readings that foretell the same torque cost the same but for their descriptions.
        """
        if self.second is None:
            return True
        odds = DESCRIPTION.observations * (self.second.cost - self.best.cost)
        return bool(odds > math.log(SEARCH.sure_odds))

    @property
    def has_doubtful_change(self) -> bool:
        """Whether what the best reading changes of the log is not told from what the second does.

        Whether there is one more change is open of any log: those that both have stand.
        """
        if self.second is None or self.is_told_apart or is_of_masses(self.best):
            return False
        return not {*self.best.hypothesis.changes} < {*self.second.hypothesis.changes}

    @property
    def gain(self) -> float:
        """By how much the best explains more than log and URDF as they say [nats].

        Its changes' costs are taken off. By all joints, or by those that move alone: whichever is
        less.
        What changes more than the URDF's masses must explain more than these would, too.
        """
        others = [self.as_it_is]
        if self.of_masses is not None and not is_of_masses(self.best):
            others.append(self.of_masses)
        gain = min(other.cost for other in others) - self.best.cost
        by_moving = min(other.cost_of_moving for other in others) - self.best.cost_of_moving
        return min(gain, by_moving)


def is_of_masses(reading: Scored) -> bool:
    """Whether a reading changes the URDF's masses alone."""
    return set(reading.hypothesis.changes) <= OF_MASSES


def is_of_urdf(reading: Scored) -> bool:
    """Whether a reading leaves the log as it says: masses, and where the URDF's base stands."""
    beside = set(reading.hypothesis.changes) - OF_MASSES
    return beside <= {"gravity"} and reading.hypothesis.gravity != COMPENSATED


def log_of(session: Session) -> Log | None:
    """The filtered states of a session, its joints in the robot's order.

    None where every run is too short.
    """
    filtered = [filter_run(run) for run in session.runs]
    motions = [motion for motion in filtered if motion is not None]
    if not motions:
        return None
    return Log(
        q=np.concatenate([motion.q for motion in motions]),
        dq=np.concatenate([motion.dq for motion in motions]),
        ddq=np.concatenate([motion.ddq for motion in motions]),
        tau=np.concatenate([motion.tau for motion in motions]),
    )


def find_conventions(session: Session, arm: ArmModel) -> Conventions | None:
    """Searches a session's conventions; None where it is too short to tell anything."""
    log = log_of(session)
    return None if log is None else search_conventions(log, Model(arm))


def search_conventions(log: Log, model: Model) -> Conventions:
    """Searches the conventions of some states."""
    search = Search(log, model)
    ranked = search.run()
    plain = Hypothesis.as_it_is(log.q.shape[1])
    as_it_is = next(scored for scored in ranked if scored.hypothesis == plain)
    best = ranked[0]
    guess = next((scored for scored in ranked if scored.hypothesis.parameters is not None), None)
    of_masses = next((scored for scored in ranked if _changes_masses(scored)), None)
    second = second_of(ranked, usual_orders(log, model))
    of_urdf = _part_of_urdf(ranked)
    is_guessed = has_placeholders(model.arm)
    return Conventions(as_it_is, best, second, of_urdf, guess, of_masses, is_guessed)


def has_placeholders(arm: ArmModel) -> bool:
    """Whether all of three or more links have the same mass, centre and inertia.

    An arm grows thinner towards its tip: numbers that nobody looked up are alike.
    """
    links = arm.inertial_parameters.reshape(arm.n, -1)
    return arm.n >= FEWEST_ALIKE and bool(np.allclose(links, links[0]))


def _changes_masses(reading: Scored) -> bool:
    """Whether a reading changes the URDF's masses, and nothing else."""
    return bool(reading.hypothesis.changes) and is_of_masses(reading)


def second_of(ranked: Sequence[Scored], usual_orders: Orders) -> Scored | None:
    """The likeliest rival of the best.

    What changes more than the best is a rival where its further changes explain anything of what
    they cost, and otherwise the best once more, of which less is known. Numbers that are fitted
    explain a part of any log.

    Args:
        ranked: Readings, the likeliest first.
        usual_orders: Orders in which logs have all columns otherwise than the robot has its joints.

    Returns:
        The rival, or None where there is none.
    """
    best = ranked[0]
    changes = set(best.hypothesis.changes)
    paid = price(best.hypothesis, usual_orders)
    for scored in ranked[1:]:
        others = set(scored.hypothesis.changes)
        if is_alike(scored.hypothesis, best.hypothesis):
            continue
        is_more = bool(changes) and changes < others
        further = price(scored.hypothesis, usual_orders) - paid
        is_fitted = bool((others - changes) & OF_NUMBERS)
        is_paid = not is_fitted and scored.cost - best.cost < further
        if not is_more or is_paid:
            return scored
    return None


def is_alike(reading: Hypothesis, other: Hypothesis) -> bool:
    """Whether two readings say the same but for fitted numbers: masses, sizes, gravity's angle."""
    if reading.changes != other.changes or _axis_of(reading) != _axis_of(other):
        return False
    same_motion = reading.motion == other.motion
    same_effort = reading.effort_order == other.effort_order
    return same_motion and same_effort and reading.effort_sign == other.effort_sign


def _axis_of(reading: Hypothesis) -> tuple[int, bool] | None:
    """Axis of the base that gravity is nearest to and whether along it; None where it has none."""
    if isinstance(reading.gravity, str):
        return None
    axis = int(np.argmax(np.abs(reading.gravity)))
    return axis, reading.gravity[axis] > 0.0


def _part_of_urdf(ranked: Sequence[Scored]) -> Scored | None:
    """The likeliest reading of some of the best's changes that leaves the log as it says."""
    changes = set(ranked[0].hypothesis.changes)
    for scored in ranked[1:]:
        some = set(scored.hypothesis.changes)
        if some and some <= changes and is_of_urdf(scored):
            return scored
    return None


def is_changed(searched: Conventions, least: float = USUAL_EFFORT.sign_explains) -> bool:
    """Whether log or URDF is surely to be read otherwise than it says: then what is read explains
    so much at least.

    Joints that stand are held by friction at a level that nobody knows: those that move must say as
    much alone. A factor of all masses leaves the log as it is: it only has to be likely; so do
    other masses where the URDF's are placeholders.
    """
    changes = searched.best.hypothesis.changes
    needed = SEARCH.sure_gain
    is_expected = changes == ("masses",) and searched.has_placeholders
    if changes == ("mass_factor",) or is_expected:
        needed = math.log(SEARCH.sure_odds) / DESCRIPTION.observations
    return bool(changes) and searched.gain > needed and searched.best.explains >= least


def what_is_sure(
    searched: Conventions, least: float = USUAL_EFFORT.sign_explains
) -> Conventions | None:
    """The best reading where it is surely right; else what of it leaves the log as it says, or that
    the URDF's masses are guesses, where that is; else None.

    A mount that each of the likeliest readings has is sure where what they have beside it is not.
    Guesses explain nearly all that a mount does, with more numbers: the likelier of both is taken.
    By masses that are surely guesses no convention is sure.
    """
    readings = [searched.guess]
    if not searched.has_placeholders:
        readings = [searched.best, searched.of_urdf, searched.guess]
    for reading in readings:
        if reading is None:
            continue
        candidate = searched.led_by(reading)
        if not is_changed(candidate, least):
            continue
        mount = None
        if reading is searched.guess and not searched.has_placeholders:
            mount = likelier_mount(searched, least)
        return candidate if mount is None else mount
    return None


def likelier_mount(
    searched: Conventions, least: float = USUAL_EFFORT.sign_explains
) -> Conventions | None:
    """The likeliest reading that changes gravity's direction and leaves the log as it says.

    None where log and URDF as they say are likelier.

    Args:
        searched: What the search found.
        least: Share of the torque that the reading must explain at least.

    Returns:
        The findings with this reading as the best.
    """
    for reading in (searched.best, searched.of_urdf):
        if reading is None or not is_of_urdf(reading):
            continue
        candidate = searched.led_by(reading)
        is_mount = "gravity" in reading.hypothesis.changes
        if is_mount and candidate.gain > 0.0 and reading.explains >= least:
            return candidate
    return None
