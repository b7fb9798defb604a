"""How far a model is from recordings that it never saw, in each joint's noise; and whether that is sure.

A model whose friction follows warmth must know more than the motion. A diagnosis reports how much friction changes
between the coldest and the warmest moment of its recordings, and how fast a joint warms, not how warm it was when. That
follows from the motion itself: θ' = P − θ / τ with P the power that friction turns into heat, over the clock of all
runs, pauses included.

Source: the law of `thermal_friction` of the catalogue (Wolf and Iskandar 2018; Simoni 2017).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from ident.arrays import Array, Float
from ident.effects.hysteresis_thermal import warm_up
from ident.export.loaded import LawModel, SimulatorModel, log_error
from ident.motion.motion import Motion
from ident.trajectories.reference import TICK_S

# A gap within so much of the noise counts as closed.
MARGIN = 1.10
# One-sided chance that a gap reported as closed is not.
DOUBT = 0.05
CONSTANT = "time_constant_s"
# A joint of which nobody knows how warm it is.
HALF_WARM = 0.5
# Heat of less than this is none [J].
LEAST_HEAT = 1e-12


@dataclass(frozen=True, eq=False)
class GapFloors:
    """A model's torque gap in noise floors."""

    joints: Mapping[str, float]  # RMS of what is left at each joint over its noise floor, by its name
    together: float  # root mean square over the joints
    upper: float  # the same at the upper end of its one-sided interval, by how the runs differ

    @property
    def small(self) -> bool:
        """Whether hardly more than noise is left, as far as these runs say."""
        return self.together <= MARGIN

    @property
    def closed(self) -> bool:
        """Whether that is sure."""
        return self.upper <= MARGIN


def measure_floors(
    models: Sequence[SimulatorModel], motions: Sequence[Motion], floors: Float[Array, " n"]
) -> GapFloors:
    """Compares a model with the log, both through the run's own filter, where a joint slides."""
    errors = [log_error(model, run) / floors for model, run in zip(models, motions, strict=True)]
    squares = np.array([np.sum(error**2, axis=0) for error in errors])
    counts = np.array([run.settled.sum(axis=0) for run in motions], dtype=float)
    return pool_runs(squares, counts, motions[0].joints)


def pool_runs(squares: Float[Array, "R n"], counts: Float[Array, "R n"], joints: Sequence[str]) -> GapFloors:
    """Mean squares of runs of unequal length, and the upper bound of their mean over the joints.

    Neighbouring samples are copies of each other, so that a run counts as one draw; the variance is that of a ratio of
    sums. Joints that never slide are left out.

    Source: Cochran, Sampling Techniques (1977), section 6.3.
    """
    total = np.maximum(counts.sum(axis=0), 1.0)
    mean = squares.sum(axis=0) / total
    slid = counts.sum(axis=0) > 0
    runs, n = len(squares), max(int(slid.sum()), 1)
    # What each run adds to the mean over the joints, about its expectation.
    apart = ((squares - mean * counts) / total)[:, slid].sum(axis=1) / n
    together = float(mean[slid].sum() / n)
    by_joint = dict(zip(joints, map(float, np.sqrt(mean)), strict=True))
    if runs < 2:
        return GapFloors(by_joint, float(np.sqrt(together)), np.inf)
    error = np.sqrt(np.sum(apart**2) * runs / (runs - 1))
    upper = together + student.ppf(1.0 - DOUBT, runs - 1) * error
    return GapFloors(by_joint, float(np.sqrt(together)), float(np.sqrt(upper)))


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A planned motion on a clock."""

    time: Float[Array, " T"]
    dq: Float[Array, "T n"]
    interval: float = TICK_S


TimedRun = Motion | PlannedRun


def follow_warmth(
    model: SimulatorModel, learned: Sequence[TimedRun], runs: Sequence[TimedRun], cold: bool = False
) -> list[SimulatorModel]:
    """The model for each of further runs; one without a law that follows modelled warmth is the same for all.

    Args:
        model: The model.
        learned: Runs that its laws were learnt from: their least and largest heat are coldest and warmest.
        runs: All runs since, in order of time.
        cold: Whether the joints are cold before these; else they go on from where the learned ones left them.
    """
    effects = model.effects if isinstance(model, LawModel) else ()
    warming = [(j, values[CONSTANT]) for _, j, values in effects if CONSTANT in values]
    if not warming or not isinstance(model, LawModel):
        return [model] * len(runs)
    warmth = [np.full(run.dq.shape, HALF_WARM) for run in runs]
    for j, constant in warming:
        known = heat_along(model, j, constant, learned)
        coldest, warmest = min(one.min() for one in known), max(one.max() for one in known)
        courses = heat_along(model, j, constant, runs if cold else (*learned, *runs))[-len(runs) :]
        for values, heat in zip(warmth, courses, strict=True):
            values[:, j] = (heat - coldest) / max(warmest - coldest, LEAST_HEAT)
    return [replace(model, warmth=values) for values in warmth]


def heat_along(model: LawModel, joint: int, constant: float, runs: Sequence[TimedRun]) -> list[Float[Array, " T"]]:
    """Heat of a joint over each run, cold before the first [J]; it keeps its heat for a time constant [s]."""
    found: list[Float[Array, " T"]] = []
    heat, clock = 0.0, None
    coulomb, viscous = model.losses.coulomb[joint], model.losses.viscous[joint]
    for run in runs:
        rest = 0.0 if clock is None else max(float(run.time[0]) - clock, 0.0)
        speed = np.abs(run.dq[:, joint])
        power = speed * (coulomb + viscous * speed)
        found.append(warm_up(power, run.interval, constant, heat * np.exp(-rest / constant)))
        heat, clock = float(found[-1][-1]), float(run.time[-1])
    return found
