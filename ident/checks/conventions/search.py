"""The search: from the log as it is, change after change, the likeliest readings first.

A reading costs, over the joints, the logarithm of the share of torque that it leaves, and its
changes the length of their description. Order, direction, zero and unit make another motion, and
are tried one by one and two by two, from the log as it is and from what all columns may share:
another unit, another usual order. Few states tell which readings are worth more: those are compared
by more states, with masses and bodies, and the next changes are sought from the likeliest.

One change alone may explain nothing as long as another is not made: where the first changes leave
much, every change is tried from each of the starts, and every two of the log as it is. The search
ends where many readings in a row were none the likelier.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ident.checks.conventions.closely import CloseLook, Scored
from ident.checks.conventions.description import BODY_PARAMETERS, Prices
from ident.checks.conventions.hypothesis import AS_STATED, COMPENSATED, Hypothesis
from ident.checks.conventions.masses import guessed_masses
from ident.checks.conventions.model import Model
from ident.checks.conventions.motions import Motions, Place, motion_of, place_of
from ident.checks.conventions.readings import Log, evidence_of_columns, telling, usual_orders
from ident.checks.conventions.screening import Body, Screening
from ident.checks.conventions.settings import SEARCH
from ident.checks.conventions.torques import Columns
from ident.robot.arm import ArmModel


class Search:
    """Readings of one log, scored as they are asked for."""

    def __init__(self, log: Log, model: Model) -> None:
        log = log.thinned(SEARCH.states)
        columns = Columns(evidence_of_columns(log), telling(log))
        prices = Prices(usual_orders(log, model))
        self.log = log
        self.model = model
        self.motions = Motions(log, model)
        self.screening = Screening(log.thinned(SEARCH.screened), model, columns, prices)
        self.closely = CloseLook(log, model, columns, prices)
        # Motions from which changes were sought, and whether beside a body.
        self._expanded: set[tuple[tuple[object, ...], bool]] = set()
        # From how many readings of each order and unit changes were sought.
        self._sought: Counter[tuple[object, ...]] = Counter()
        # Cost of the likeliest reading so far, and how many were tried when it was found.
        self._least = np.inf
        self._tried_at_least = 0

    def run(self) -> list[Scored]:
        """The readings that were looked at closely, the likeliest first.

        That the URDF's masses are guesses is asked last: no change of the log is sought from there.
        """
        self._search()
        guess = guessed_masses(self.log, self.model)
        if guess is not None:
            self.closely.take(guess)
        return self.closely.ranked

    def _search(self) -> None:
        """Change after change, until none is left that is worth it."""
        starts = self.motions.starts()
        self.screening.ask(starts, self.model, None)
        self._look(len(starts))
        is_wide = False
        while self._has_time:
            scored = self._next()
            if scored is None:
                return
            self._expand(scored)
            self._compare()
            if not is_wide and self.closely.ranked[0].explains <= SEARCH.well_explained:
                self._widen(starts)
                self._compare()
            is_wide = True

    def _compare(self) -> None:
        """Looks closely at the likeliest of what was screened, and notes whether that gained."""
        self._look(SEARCH.refined)
        self._settle()
        least = self.closely.ranked[0].cost
        if least < self._least:
            self._least = least
            self._tried_at_least = len(self.screening.seen)

    def _widen(self, starts: Sequence[Hypothesis]) -> None:
        """Screens every change of each start, and every two of the log as it is.

        What it takes is no sign that nothing is to be found.
        """
        for start in starts:
            self.screening.ask(list(self.motions.neighbours(start)), self.model, None, start)
        plain = self.motions.plain
        for pairs in self.motions.all_pairs(plain):
            self.screening.ask(pairs, self.model, None, plain)
        self._tried_at_least = len(self.screening.seen)

    @property
    def _is_settled(self) -> bool:
        """Whether the log's own motion explains well: no other is likelier to lead to a better
        reading.
        """
        best = self.closely.ranked[0]
        is_own = best.hypothesis.motion == self.motions.plain.motion
        return is_own and best.explains > SEARCH.well_explained

    @property
    def _has_time(self) -> bool:
        """Whether more readings of the motion may be tried: not many were since the last gain."""
        return len(self.screening.seen) - self._tried_at_least < int(SEARCH.most_readings)

    def _expand(self, scored: Scored) -> None:
        """Screens what is one change away from a reading, and its likeliest changes two by two.

        What is changed is seen beside the body, where there is one.
        """
        reading = motion_of(scored.hypothesis)
        body = scored.hypothesis.body
        model = self._model_with(scored.hypothesis)
        self._expanded.add((reading.motion, body is not None))
        self._sought[self._shared(reading)] += 1
        self.screening.ask([reading], model, body)
        changed = list(self.motions.neighbours(reading))
        self.screening.ask(changed, model, body, reading)
        places = self._by_place(reading, changed, body)
        together = [*self.motions.pairs(reading, places), *self.motions.of_joints(reading, places)]
        if not self._is_settled:
            together += self.motions.other_values(reading, places)
        self.screening.ask(together, model, body, reading)

    def _model_with(self, reading: Hypothesis) -> Model:
        """The robot with the body that a reading has at its end."""
        if reading.body is None:
            return self.model
        return Model(with_body(self.model.arm, reading))

    def _by_place(
        self, reading: Hypothesis, changed: Sequence[Hypothesis], body: Body
    ) -> list[list[Hypothesis]]:
        """A reading's changes by the place where it is changed, the likeliest first."""
        places: dict[Place, list[Hypothesis]] = {}
        costs = self.screening.seen
        for each in sorted(changed, key=lambda each: costs[each.motion, body]):
            places.setdefault(place_of(reading, each), []).append(each)
        places.pop((), None)  # the reading itself
        return list(places.values())

    def _look(self, count: int) -> None:
        """Looks closely at so many of the likeliest readings: all states, masses and bodies, any
        gravity.
        """
        self.closely.look(self.motions.plain)
        for screened in self.screening.likeliest(count):
            for torque in screened.torques:
                self.closely.look(self.screening.with_torque(screened.reading, torque))
            turned = self.screening.turned(screened.reading, screened.torques[0])
            if turned is not None:
                self.closely.look(turned)

    def _settle(self) -> None:
        """Asks for the likeliest reading's torques anew beside its masses, as long as it gains.

        Signs, columns and gravity were sought beside other masses than those that they ask for: a
        heavy body may carry what gravity does not, or turn the sign of what it hangs on.
        """
        best = self.closely.ranked[0]
        while best.hypothesis.body is not None or best.hypothesis.mass_factor != 1.0:
            for reading in self._with_other_torques(best.hypothesis):
                self.closely.look(reading)
            before = best
            best = self.closely.ranked[0]
            if best is before:
                return

    def _with_other_torques(self, reading: Hypothesis) -> Iterator[Hypothesis]:
        """A reading's motion with the torques that are likeliest beside its body, all of the other
        sign, and without gravity.
        """
        motion = motion_of(reading)
        if reading.body is not None:
            yield from self.screening.torques_of(motion, self._model_with(reading))
        opposite = tuple(-sign for sign in reading.effort_sign)
        of_torque = replace(motion, effort_order=reading.effort_order)
        gravities = dict.fromkeys((reading.gravity, AS_STATED, COMPENSATED))
        for gravity, signs in product(gravities, (reading.effort_sign, opposite)):
            yield replace(of_torque, gravity=gravity, effort_sign=signs)

    def _next(self) -> Scored | None:
        """The reading from which changes are sought next; None where none is left that is worth it.

        The likeliest, where it explains well, without a body and with it: a body may stand for the
        change that is missing. Else the log's own, and then of the likeliest orders and units of
        all columns the one from which changes were sought least.
        """
        best = self.closely.ranked[0]
        plain = self.motions.plain.motion
        fresh = [scored for scored in self.closely.ranked if self._is_open(scored)]
        if self._is_settled:
            return next((each for each in fresh if each.hypothesis.motion == plain), None)
        if best.explains > SEARCH.well_explained:
            return self._of_best_motion(fresh)
        if self._expanded:
            unchanged = [scored for scored in fresh if scored.hypothesis.motion == plain]
            if unchanged and (plain, False) not in self._expanded:
                return unchanged[0]
            # What explains nothing leads nowhere, once another explains something.
            fresh = [scored for scored in fresh if scored.explains > 0.0] or fresh[:1]
        classes: dict[tuple[object, ...], Scored] = {}
        for scored in fresh:
            classes.setdefault(self._shared(scored.hypothesis), scored)
        likeliest = list(classes.values())[: SEARCH.beam]
        return min(likeliest, key=self._times_sought, default=None)

    def _of_best_motion(self, fresh: Sequence[Scored]) -> Scored | None:
        """The likeliest of some readings with the best one's motion: without a body, then with its
        own; None where there is none.
        """
        best = self.closely.ranked[0].hypothesis
        of_motion = [scored for scored in fresh if scored.hypothesis.motion == best.motion]
        bodiless = [scored for scored in of_motion if scored.hypothesis.body is None]
        beside_body = of_motion if best.body is not None else []
        return next(iter([*bodiless, *beside_body]), None)

    def _times_sought(self, scored: Scored) -> int:
        """From how many readings of the same order and unit changes were sought."""
        return self._sought[self._shared(scored.hypothesis)]

    def _is_open(self, scored: Scored) -> bool:
        """Whether no change was sought yet from a reading's motion, and one may be.

        A body under a reading that explains little mends what another change would: none is sought
        beside it.
        """
        has_body = scored.hypothesis.body is not None
        is_sought = scored.explains > SEARCH.well_explained or not has_body
        return is_sought and (scored.hypothesis.motion, has_body) not in self._expanded

    def _shared(self, hypothesis: Hypothesis) -> tuple[object, ...]:
        """What all columns of a reading share: an order, a unit."""
        unit = hypothesis.unit[0] if len(set(hypothesis.unit)) == 1 else ""
        return hypothesis.order, unit


def with_body(arm: ArmModel, hypothesis: Hypothesis) -> ArmModel:
    """The arm with the body that a hypothesis has at its end."""
    parameters = np.array(arm.inertial_parameters)
    parameters[-10 : BODY_PARAMETERS - 10] += np.array(hypothesis.body)
    return arm.with_inertial_parameters(parameters)
