"""A simulated arm with hidden effects in the loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.recordings.recording import Session
from ident.simulation.causes import ALIKE, CATALOGUE, EVENTS, find_cause
from ident.simulation.hardware import Hardware
from ident.simulation.record import Channels, draw_pauses, record_runs
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import SimulationOptions, simulate
from ident.trajectories.reference import ReferenceMotion

# The arm rests and cools while the diagnosis thinks [s].
REST_S = 600.0


def draw_effects(joints: Sequence[str], count: int, rng: np.random.Generator) -> tuple[EffectRequest, ...]:
    """Random effects of usual size at random joints, no two of which are one and the same torque."""
    names = sorted(set(CATALOGUE) - EVENTS)
    while True:
        ids = [str(one) for one in rng.choice(names, count, replace=False)]
        if all(len(twins & set(ids)) < 2 for twins in ALIKE):
            break
    return tuple(EffectRequest(one, "" if find_cause(one).whole_arm else str(rng.choice(joints))) for one in ids)


class SimulatedArm:
    """One arm with hidden effects, which records again and again.

    Args:
        options: What it is; its runs and motions are those that it is given.
    """

    def __init__(self, options: SimulationOptions) -> None:
        self.options, self.clock, self.rounds = options, 0.0, 0
        self.hardware: Hardware | None = None
        self.effects: tuple[str, ...] = ()

    def record(self, motions: Sequence[ReferenceMotion]) -> Session:
        """One run for each motion, on a clock that goes on from round to round."""
        self.rounds += 1
        name = f"round_{self.rounds}"
        if self.hardware is None:
            made = simulate(self.options, motions=motions)
            session, self.hardware = made.session, made.hardware
            truth = made.answer.effects
            self.effects = tuple(":".join([one.effect, *(one.joints or ("arm",)), f"{one.size:.4g}"]) for one in truth)
        else:
            rng = np.random.default_rng([self.options.seed, self.rounds])
            pauses = draw_pauses(len(motions), self.options.pause, rng)
            channels = Channels(self.options.rate, self.options.velocity, self.options.commands)
            recorded, _ = record_runs(self.hardware, motions, channels, rng, pauses)
            session = Session(name, tuple(recorded), robot=self.options.robot)
        runs = [run.replace(time=run.time + self.clock, name=f"{name}_{run.name}") for run in session.runs]
        self.clock = float(runs[-1].time[-1]) + REST_S
        return session.replace(name=name, runs=tuple(runs))
