"""The search on a session: the readings that explain most, best first."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ident.checks.conventions.description import DESCRIPTION
from ident.checks.conventions.hypothesis import Hypothesis
from ident.checks.conventions.readings import Log, Model
from ident.checks.conventions.search import LIMIT, Scored, Search
from ident.checks.filtered_run import USUAL_EFFORT, filter_run
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel


@dataclass(frozen=True)
class Conventions:
    """What the search found."""

    as_it_is: Scored  # log and URDF as they say
    best: Scored
    second: Scored | None
    gain_of_moving: float  # what of the gain the joints that move tell, all costs taken off [nats]

    @property
    def gain(self) -> float:
        """By how much the best explains more than log and URDF as they say, its changes' costs
        taken off [nats].
        """
        return self.as_it_is.cost - self.best.cost


def log_of(session: Session) -> Log | None:
    """The filtered states of a session, its joints in the robot's order; None where every run is
    too short.
    """
    motions = [motion for run in session.runs if (motion := filter_run(run)) is not None]
    if not motions:
        return None
    return Log(*(np.concatenate([getattr(motion, name) for motion in motions]) for name in ("q", "dq", "ddq", "tau")))


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
    # What changes more than the best explains the same for more: a rival leaves some of its changes
    # out.
    changes = set(best.hypothesis.changes)
    rivals = [scored for scored in ranked[1:] if not changes or not changes <= set(scored.hypothesis.changes)]
    second = next((rival for rival in rivals if rival.hypothesis.changes != best.hypothesis.changes), None)
    moving = search.cost_of_moving(as_it_is) - search.cost_of_moving(best)
    return Conventions(as_it_is, best, second, moving)


def is_changed(found: Conventions, least: float = USUAL_EFFORT.sign_explains) -> bool:
    """Whether log or URDF is surely to be read otherwise than it says: then what is read explains
    so much at least.

    Joints that stand are held by friction at a level that nobody knows: those that move must say as
    much alone. A factor of all masses leaves the log as it is: it only has to be likely.
    """
    changes = found.best.hypothesis.changes
    needed = LIMIT.sure_gain
    if changes == ("mass_factor",):
        needed = math.log(LIMIT.sure_odds) / DESCRIPTION.observations
    gain = min(found.gain, found.gain_of_moving)
    return bool(changes) and gain > needed and found.best.explains >= least
