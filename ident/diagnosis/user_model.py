"""The gap against a model that the user has, none of it tuned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.diagnosis.diagnose import Analysis
from ident.model.evaluation import trace_run
from ident.model.hybrid import HybridModel


def with_own_model(analysis: Analysis, model: HybridModel) -> Analysis:
    """The analysis with the error of the user's model, on its last rung, at each of its joints (`model_rms_Nm`)."""
    squares, counts = (dict.fromkeys(model.joint_names, 0.0) for _ in range(2))
    for item in analysis.series:
        motion = item.run.motion
        trace = trace_run(model, motion.select(model.joint_names))
        left = trace.motion.tau_filtered - trace.filtered[list(trace.rungs)[-1]]
        for k, name in enumerate(model.joint_names):
            inside = item.valid[:, motion.joints.index(name)]
            squares[name] += float(np.sum(left[inside, k] ** 2))
            counts[name] += float(inside.sum())
    rms = {name: float(np.sqrt(squares[name] / counts[name])) for name in squares if counts[name]}
    gap = {name: replace(one, model_rms=rms.get(name)) for name, one in analysis.diagnosis.gap.items()}
    return replace(analysis, diagnosis=replace(analysis.diagnosis, gap=gap))
