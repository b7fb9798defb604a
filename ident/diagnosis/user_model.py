"""The gap against a model that the user has, none of it tuned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.diagnosis.diagnose import Analysis
from ident.model.evaluation import trace_run
from ident.model.hybrid import HybridModel


def with_own_model(analysis: Analysis, model: HybridModel) -> Analysis:
    """The analysis with the error of the user's model at each of its joints (`model_rms_Nm`).

    The model is taken on its last rung.

    Args:
        analysis: The diagnosis with its intermediate results.
        model: The user's model of this arm.
    """
    names = model.joint_names
    squares = dict.fromkeys(names, 0.0)
    counts = dict.fromkeys(names, 0.0)
    for item in analysis.series:
        motion = item.run.motion
        trace = trace_run(model, motion.select(names))
        last_rung = list(trace.rungs)[-1]
        left = trace.motion.tau_filtered - trace.filtered[last_rung]
        for k, name in enumerate(names):
            inside = item.valid[:, motion.joints.index(name)]
            squares[name] += float(np.sum(left[inside, k] ** 2))
            counts[name] += float(inside.sum())
    rms = {}
    for name in names:
        if counts[name]:
            rms[name] = float(np.sqrt(squares[name] / counts[name]))
    diagnosis = analysis.diagnosis
    gap = {}
    for name, of_joint in diagnosis.gap.items():
        gap[name] = replace(of_joint, model_rms=rms.get(name))
    return replace(analysis, diagnosis=replace(diagnosis, gap=gap))
