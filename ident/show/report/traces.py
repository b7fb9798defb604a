"""Measured against modelled curves over time, at the worst joint and at each named one: numbers
that a page draws.

Three models stand beside the measurement: the URDF as a simulator loads it, the arm as tuned, and
the arm with the named effects. The last two were fitted without the part of the recording that they
are shown on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ident.arrays import Array, Float
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.next_experiment import joints_shown
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.robot.urdf_elements import COULOMB, VISCOUS, stated_friction
from ident.show.palette import FLEXIBLE, MEASURED, NAMED, TUNED
from ident.show.report.figures import WIDE, make_panel, thin, to_svg
from ident.units import TORQUE, unit_for

# As much as a page holds: joints, runs, and samples of a run.
MOST_JOINTS = 6
MOST_RUNS = 12
MOST_SAMPLES = 1500
# Steps that a curve's range is divided into: a screen has no more.
STEPS = 4000
# Curves of torque, then of a servo's angle, in the order in which they are drawn: what each is, and
# its colour.
CURVES = {
    "measured": ("measured", MEASURED),
    "URDF": ("your URDF, as a simulator loads it", FLEXIBLE),
    "tuned": ("with your arm's numbers", TUNED),
    "named": ("with the named effects, too", NAMED),
    "fitted": ("the fitted model", TUNED),
    "net": ("with its net, too", NAMED),
    "goal": ("the goal", FLEXIBLE),
    "told": ("where these figures put it", TUNED),
}
COLOURS = {name: colour for name, (_, colour) in CURVES.items()}


@dataclass(frozen=True, eq=False)
class RunTraces:
    """Curves of one run."""

    name: str
    time: Float[Array, " t"]  # from its start [s]
    # By curve, what was measured first; a model's is no number where the joint rests or turns
    # round, for there it is not judged.
    values: dict[str, Float[Array, "t n"]]


@dataclass(frozen=True, eq=False)
class Traces:
    """Curves of the runs that are shown, the worst run and joint first."""

    joints: tuple[str, ...]  # all joints of the arm
    shown: tuple[int, ...]  # which of them are shown
    units: tuple[str, ...]  # of each joint
    runs: tuple[RunTraces, ...]
    quantity: str = "torque"

    @property
    def curves(self) -> tuple[str, ...]:
        """Names of a run's curves, the same in every run."""
        return tuple(self.runs[0].values)

    def to_json(self) -> Markup:
        """All numbers for a script within a page."""
        record = {
            "quantity": self.quantity,
            "joints": [{"name": self.joints[j], "unit": self.units[j]} for j in self.shown],
            "curves": [{"name": name, "label": label(name)} for name in self.curves],
            "runs": [self._run_record(run) for run in self.runs],
        }
        text = as_json(record, None)
        return Markup(text.replace("<", "\\u003c").replace("&", "\\u0026"))

    def _run_record(self, run: RunTraces) -> dict[str, Any]:
        """A run's curves as whole steps of each joint's range, None where there is no number."""
        stride = max(1, -(-len(run.time) // MOST_SAMPLES))
        rows = slice(None, None, stride)
        joints = []
        for j in self.shown:
            values = np.stack([run.values[name][rows, j] for name in self.curves])
            low = float(np.nanmin(values))
            high = float(np.nanmax(values))
            step = max(high - low, 1e-9) / STEPS
            scaled = np.nan_to_num((values - low) / step, nan=-1.0)
            steps = np.rint(scaled).astype(int).astype(object)
            steps[~np.isfinite(values)] = None
            record = {
                "low": round(low, 6),
                "step": float(f"{step:.6g}"),
                "values": steps.tolist(),
            }
            joints.append(record)
        time = np.round(run.time[rows], 4)
        return {"name": run.name, "time": time.tolist(), "joints": joints}

    def static(self) -> list[Markup]:
        """Curves and errors of the worst run at the worst joint, for who prints the page or runs no
        scripts.
        """
        run = self.runs[0]
        j = self.shown[0]
        joint = self.joints[j]
        first = self.curves[0]
        measured = run.values[first][:, j]
        pictures = []
        for what in (self.quantity, "error"):
            labels = f"time in {run.name} [s]", f"{what} [{self.units[j]}]"
            figure, axes = make_panel(*labels, WIDE, left=0.65)
            for name in self.curves:
                values = run.values[name][:, j]
                values = values if what == self.quantity else measured - values
                if what == "error" and name == first:
                    continue
                axes.plot(*thin(run.time, values), color=COLOURS[name], linewidth=0.9)
            words = f"{what} of {joint} in {run.name}, measured and modelled"
            pictures.append(to_svg(figure, words))
        return pictures


def label(curve: str) -> str:
    """What a curve is, in words."""
    return CURVES[curve][0]


def gather_traces(analysis: Analysis) -> Traces | None:
    """The curves of a diagnosis; None where nothing was fitted or no joint moves."""
    diagnosis = analysis.diagnosis
    if not analysis.series or not diagnosis.gap:
        return None
    arm = analysis.baseline.nominal
    shown = _shown_joints(analysis)
    order = sorted(analysis.series, key=lambda item: -_error(item, shown[0]))
    named = bool(diagnosis.findings)
    return Traces(
        joints=diagnosis.joints,
        shown=tuple(shown),
        units=tuple(unit_for(TORQUE, bool(sliding)) for sliding in arm.sliding_joints),
        runs=tuple(_traces_of(item, arm, named) for item in order[:MOST_RUNS]),
    )


def _shown_joints(analysis: Analysis) -> list[int]:
    """The worst joint, then those of the names."""
    diagnosis = analysis.diagnosis
    beyond = {}
    for joint, gap in diagnosis.gap.items():
        beyond[joint] = gap.rms**2 - gap.noise_floor**2
    worst = max(beyond, key=lambda joint: beyond[joint])
    if diagnosis.verdict == "no_gap" and diagnosis.details is not None:
        errors = diagnosis.details.identified.urdf_rms
        worst = max(errors, key=lambda joint: errors[joint])
    names = [diagnosis.where[0].joint if diagnosis.where else worst]
    for finding in diagnosis.findings:
        names += joints_shown(finding.to_dict())
    names += sorted(beyond, key=lambda joint: -beyond[joint])
    return [diagnosis.joints.index(name) for name in dict.fromkeys(names)][:MOST_JOINTS]


def _error(item: RunResidual, joint: int) -> float:
    """What the tuned model leaves of a run at a joint, root mean square [N m]."""
    left = item.unseen_before[item.valid[:, joint], joint]
    return float(np.sqrt(np.mean(left**2))) if len(left) else 0.0


def _traces_of(item: RunResidual, arm: ArmModel, named: bool) -> RunTraces:
    """A run's curves of torque [N m].

    Args:
        item: What is left of the run.
        arm: The arm as its URDF describes it.
        named: Whether there are named effects.
    """
    motion = item.run.motion
    measured = np.asarray(motion.tau_filtered)
    torque = {
        "measured": measured,
        "URDF": urdf_torque(item, arm),
        "tuned": measured - item.unseen_before,
    }
    if named:
        torque["named"] = measured - item.unseen_after
    judged = {name: np.where(item.valid, values, np.nan) for name, values in torque.items()}
    judged["measured"] = measured
    return RunTraces(motion.name, np.asarray(item.time - item.time[0]), judged)


def urdf_torque(item: RunResidual, arm: ArmModel) -> Float[Array, "t n"]:
    """Torque of a run by the URDF as a simulator loads it, through the run's filter [N m]."""
    motion = item.run.motion
    stated = stated_friction(arm)
    damping = np.array([stated[joint].get(VISCOUS, 0.0) for joint in arm.joint_names])
    friction = np.array([stated[joint].get(COULOMB, 0.0) for joint in arm.joint_names])
    with_payload = arm.with_payload(motion.payload)
    rigid = with_payload.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    loaded = rigid + damping * motion.dq + friction * item.run.direction
    return np.asarray(motion.filtered(loaded))


def legend_of(curves: Sequence[str]) -> list[tuple[str, str]]:
    """Words and colour of each curve."""
    return [(label(name), COLOURS[name]) for name in curves]


def section_values(traces: Traces, words: str) -> dict[str, Any]:
    """What the template of curves gets.

    Args:
        traces, words: The curves, and what they are.
    """
    return {
        "data": traces.to_json(),
        "static": traces.static(),
        "legend": legend_of(traces.curves),
        "quantity": traces.quantity,
        "words": words,
    }
