"""The default residual net against the paper's, side by side on the shipped recordings. Run: pytest <this file> -s.

Trained on T1 and T2, scored on E1 and E2. The paper's net takes minutes.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from ident.model.evaluation import evaluate
from ident.model.hybrid import FitOptions, fit_hybrid
from ident.motion.motion import Motion, prepare
from ident.recordings.load import load_session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path


def _motions(name: str) -> tuple[Motion, ...]:
    return prepare(load_session(data_path(f"logs/tm5_900/{name}")))


@pytest.mark.parametrize("links", [3, 6])
def test_default_net_beats_the_papers(links: int) -> None:
    """Held-out torque RMSE and energy error of the default are lower, with at most 1/20 of the weights."""
    arm = ArmModel.load("tm5-900")
    training = (*_motions("T1"), *_motions("T2"))
    held_out = [(name, _motions(name)) for name in ("E1", "E2")]
    found = {}
    print(f"\nlinks {links}, {sum(len(m.time) for m in training)} training samples, held out E1 + E2")
    print(f"{'net':<9}{'weights':>10}{'fit [s]':>9}{'RMSE [N m], total and by joint':>34}{'energy error [J]':>40}")
    for preset in ("none", "default", "paper"):
        begin = time.perf_counter()
        model = fit_hybrid(training, arm, FitOptions(links=links, net=preset)).model  # type: ignore[arg-type]
        seconds = time.perf_counter() - begin
        score = evaluate(model, held_out).pooled
        weights = model.net.parameters if model.net is not None else 0
        rmse, energy = score.rmse_mean[-1], score.energy_mean[-1]
        row = f"{preset:<9}{weights:>10,}{seconds:>9.1f}{rmse[-1]:>10.3f}"
        with np.printoptions(precision=3, suppress=True, linewidth=200):
            print(f"{row}  {rmse[:-1]}  {energy[-1]:.3f}  {energy[:-1]}")
        found[preset] = (weights, rmse[-1])
    assert found["default"][1] < found["paper"][1]
    assert 20 * found["default"][0] <= found["paper"][0]
