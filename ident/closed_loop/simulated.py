"""A simulated arm in the loop: it records, and it is what a controller is tried on in the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.closed_loop.warmth import NO_WARMTH, Warmth, put_on_a_clock
from ident.export.law_model import SimulatorModel
from ident.recordings.recording import Session
from ident.simulation.causes import ALIKE, CATALOGUE, EVENTS, find_cause
from ident.simulation.hardware import Hardware
from ident.simulation.record import Channels, draw_pauses, no_progress, record_runs
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.simulator import Simulator
from ident.trajectories.reference import TICK_S, ReferenceMotion

# The arm rests and cools while the diagnosis thinks [s].
REST_S = 600.0
# Feedback of the controller that is tried [rad/s]: soft, as where people are near; a stiff loop would hide the model.
TRACKING_BANDWIDTH = 20.0


def draw_effects(joints: Sequence[str], count: int, rng: np.random.Generator) -> tuple[EffectRequest, ...]:
    """Random effects of usual size at random joints, no two of which are one and the same torque."""
    names = sorted(set(CATALOGUE) - EVENTS)
    while True:
        ids = [str(one) for one in rng.choice(names, count, replace=False)]
        if all(len(twins & set(ids)) < 2 for twins in ALIKE):
            break
    return tuple(EffectRequest(one, "" if find_cause(one).whole_arm else str(rng.choice(joints))) for one in ids)


class SimulatedArm:
    """One arm with hidden effects, asked again and again.

    Args:
        options: What it is; its runs and motions are those that it is asked for.
    """

    def __init__(self, options: SimulationOptions) -> None:
        self.options, self.clock, self.rounds = options, 0.0, 0
        self.hardware: Hardware | None = None
        self.effects: tuple[str, ...] = ()

    def record(self, motions: Sequence[ReferenceMotion]) -> Session:
        """One run for each motion, on a clock that goes on from round to round."""
        self.rounds += 1
        if self.hardware is None:
            simulation = simulate(self.options, motions=motions)
            session, self.hardware = simulation.session, simulation.hardware
            self.effects = tuple(_describe(one) for one in simulation.answer.effects)
        else:
            rng = np.random.default_rng([self.options.seed, self.rounds])
            pauses = draw_pauses(len(motions), self.options.pause, rng)
            channels = Channels(self.options.rate, self.options.velocity, self.options.commands)
            runs, _ = record_runs(self.hardware, motions, channels, rng, pauses, no_progress)
            session = Session(f"round_{self.rounds}", tuple(runs), robot=self.options.robot)
        runs = [run.replace(time=run.time + self.clock, name=f"round_{self.rounds}_{run.name}") for run in session.runs]
        self.clock = float(runs[-1].time[-1]) + REST_S
        return session.replace(name=f"round_{self.rounds}", runs=tuple(runs))


def _describe(effect: object) -> str:
    name, joints, size = (getattr(effect, key) for key in ("effect", "joints", "size"))
    return ":".join([name, *(joints or ("arm",)), f"{size:.4g}"])


@dataclass(frozen=True, eq=False)
class Tracking:
    """How well an arm follows under one controller.

    Attributes:
        rms: Of what its encoders miss the reference by, at each joint [rad], shape (n,).
    """

    rms: Float[Array, " n"]

    @property
    def together(self) -> float:
        """Root mean square over the joints [rad]."""
        return float(np.sqrt(np.mean(self.rms**2)))


def track(
    hardware: Hardware,
    models: Mapping[str, SimulatorModel],
    motions: Sequence[ReferenceMotion],
    seed: int,
    warmth: Warmth = NO_WARMTH,
) -> dict[str, Tracking]:
    """Runs one controller on the true arm, its feed-forward designed with each model in turn.

    Computed torque of the reference, and the same soft feedback for all: proportional and derivative, for a bandwidth
    of 20 rad/s at the arm's inertia. Noise and friction's changes are the same for all.

    Args:
        hardware: The true arm.
        models: Models by their names.
        motions: What it has to follow.
        seed: Of noise.
        warmth: Which joints warm, by the models that know it; the arm is cold at first.
    """
    soft = hardware.replace(bandwidth=TRACKING_BANDWIDTH)
    offset = np.array(hardware.sensing.encoder_offset)
    found, clocked = {}, put_on_a_clock(motions, REST_S)
    for name, model in models.items():
        each = zip(warmth.rested().along(model, clocked), motions, strict=True)
        feeds = [one.joint_torque(run.q, run.dq, run.ddq, TICK_S) for one, run in each]
        simulator = Simulator(soft, np.random.default_rng([seed, 11]))
        traces = simulator.run(motions, [REST_S] * len(motions), no_progress, feeds)
        missed = np.concatenate([trace.log.angle + offset - trace.motion.q for trace in traces])
        found[name] = Tracking(np.sqrt(np.mean(missed**2, axis=0)))
    return found
