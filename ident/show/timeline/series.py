"""The curves of one run, and moments worth looking at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.model.evaluation import trace_run
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.show.palette import FLEXIBLE, MEASURED, rung_colours, rung_name


@dataclass(frozen=True)
class Mark:
    """One stretch of one run."""

    run: int  # index of the run among the motions
    start_s: float  # start, from the run's first sample [s]
    end_s: float  # end [s]
    joint: str  # the joint concerned
    text: str  # what is there


MARK_COLOUR = "#d00000"


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of one joint over a run's filtered samples."""

    joint: str  # the joint
    # Group (`torque`, `residual`, `power`, `energy`, `motion`) and name within it.
    path: tuple[str, str]
    label: str  # its name in the legend
    colour: str  # its colour
    values: Float[Array, " t"]  # one value a filtered sample


def run_curves(motion: Motion, model: HybridModel | None) -> Iterator[Curve]:
    """All curves of a run.

    Power of the last rung only, the others' can be read off torque and speed.
    """
    coarse = motion.coarse
    measured = (
        ("torque", motion.tau_filtered),
        ("power", motion.filtered(motion.tau * motion.dq)),
        ("energy", _work(motion, motion.tau)[coarse]),
    )
    for j, joint in enumerate(motion.joints):
        for group, table in measured:
            yield Curve(joint, (group, "measured"), "measured", MEASURED, table[:, j])
        yield Curve(joint, ("motion", "position"), "position [rad]", "#444444", motion.q[coarse, j])
        yield Curve(
            joint, ("motion", "velocity"), "velocity [rad/s]", FLEXIBLE, motion.dq[coarse, j]
        )
    if model is None:
        return
    trace = trace_run(model, motion)
    motion = trace.motion  # of the model's joints
    colours = rung_colours(tuple(trace.rungs))
    last = tuple(trace.rungs)[-1]
    for rung, torque in trace.rungs.items():
        tables = [
            ("torque", trace.filtered[rung]),
            ("residual", motion.tau_filtered - trace.filtered[rung]),
            ("energy", _work(motion, torque)[coarse]),
        ]
        if rung == last:
            tables.append(("power", motion.filtered(torque * motion.dq)))
        for j, joint in enumerate(motion.joints):
            for group, table in tables:
                yield Curve(joint, (group, rung), rung_name(rung), colours[rung], table[:, j])


def _work(motion: Motion, torque: Float[Array, "T n"]) -> Float[Array, "T n"]:
    """Work since the run's start [J], of the unfiltered torque.

    Its end is what the energy error compares.
    """
    power = torque * motion.dq
    steps = motion.interval * (power[1:] + power[:-1]) / 2.0
    return np.concatenate([np.zeros_like(power[:1]), np.cumsum(steps, axis=0)])


def marked(curve: Curve, time: Float[Array, " t"], start: float, end: float) -> Curve:
    """The part of a curve within a mark, red.

    Not a number elsewhere, so that nothing is drawn there.
    """
    inside = (time >= start) & (time <= end)
    values = np.where(inside, curve.values, np.nan)
    return Curve(curve.joint, (curve.path[0], "mark"), "mark", MARK_COLOUR, values)
