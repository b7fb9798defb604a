"""Sessions that all tests of effects share, and the fit by which effects find their figures."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from smooth_motion import Recover, make_session

from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.robot.arm import ArmModel


@pytest.fixture(scope="session")
def session(arm: ArmModel) -> SessionContext:
    """Rich motion: 80 s."""
    return make_session(arm)


@pytest.fixture(scope="session")
def still(arm: ArmModel) -> SessionContext:
    """An arm that hardly moves: 20 s about one pose."""
    return make_session(arm, seconds=5.0, size=0.002)


@pytest.fixture(scope="session")
def recover() -> Recover:
    """Least squares of a torque on an effect's columns over its grid, and the figures that follow.

    Torques are filtered like a recording's, with white noise of 1 % of their size added from a seed.
    """

    def fit(effect: Effect, session: SessionContext, joint: int, torque: list[Any]) -> dict[str, Interval]:
        rng = np.random.default_rng(5)
        target = np.concatenate(
            [run.motion.filtered(tau).ravel() for run, tau in zip(session.runs, torque, strict=True)]
        )
        noise = 0.01 * np.sqrt(np.mean(target**2))
        target = target + rng.normal(0.0, noise, len(target))
        best: tuple[float, Variant, Any, Any] | None = None
        for variant in effect.variants(session, joint):
            columns = effect.columns(session, joint, variant)
            rows = [run.motion.filtered(c) for run, c in zip(session.runs, columns, strict=True)]
            x = np.concatenate([row.reshape(-1, row.shape[-1]) for row in rows])
            least = np.where(np.isin(np.arange(x.shape[1]), effect.nonnegative), 0.0, -np.inf)
            estimate = lsq_linear(x, target, (least, np.inf)).x
            misfit = float(np.sum((target - x @ estimate) ** 2))
            if best is None or misfit < best[0]:
                variance = misfit / (len(target) - x.shape[1])
                best = misfit, variant, estimate, variance * np.linalg.pinv(x.T @ x)
        return effect.parameters(session, joint, *best[1:])

    return fit
