"""The gap against a model that the user has, as it is: nothing of it is tuned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.residuals import RunResidual
from ident.model.evaluation import trace_run
from ident.model.hybrid import HybridModel


def model_rms(series: Sequence[RunResidual], model: HybridModel) -> dict[str, float]:
    """RMS of what a model's last rung leaves of the filtered torque, where each joint counts [N m].

    Args:
        series: Residuals of all runs, for the runs and for what counts.
        model: The user's model; joints that it doesn't speak of are left out.
    """
    squares: dict[str, float] = dict.fromkeys(model.joint_names, 0.0)
    counts: dict[str, int] = dict.fromkeys(model.joint_names, 0)
    for item in series:
        motion = item.run.motion
        trace = trace_run(model, motion.select(model.joint_names))
        left = trace.motion.tau_filtered - trace.filtered[list(trace.rungs)[-1]]
        for k, name in enumerate(model.joint_names):
            inside = item.counts[:, motion.joints.index(name)]
            squares[name] += float(np.sum(left[inside, k] ** 2))
            counts[name] += int(inside.sum())
    return {name: float(np.sqrt(squares[name] / counts[name])) for name in squares if counts[name]}


def with_own_model(analysis: Analysis, model: HybridModel) -> Analysis:
    """The analysis with `model_rms_Nm` beside the other numbers of each joint's gap."""
    diagnosis = analysis.diagnosis
    rms = model_rms(analysis.series, model)
    gap = {name: replace(one, model_rms=rms.get(name)) for name, one in diagnosis.gap.items()}
    return replace(analysis, diagnosis=replace(diagnosis, gap=gap))
