"""Friction laws that a diagnosis named, in what planners make of them: torque, slopes, tables, bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ident.laws.carried import NamedLaw, named_torque
from plan.dynamics.power import ChainTorque
from plan.solving.bound import lower_bound
from tests.plan.worlds import model, problem, three_joints


def _figures(*values: float) -> tuple[tuple[float, float, float], ...]:
    return tuple((value, 0.9 * value, 1.1 * value) for value in values)


LAWS = {
    "stribeck": NamedLaw(
        "stribeck_friction", 0, {"stribeck_velocity_rad_s": 0.3, "exponent": 1.3}, figures=_figures(4.0)
    ),
    "curved": NamedLaw("nonlinear_viscous_friction", 1, {"exponent": 0.6}, figures=_figures(3.0)),
    "curved, with a knee": NamedLaw(
        "nonlinear_viscous_friction", 1, {"exponent": 0.3, "knee_rad_s": 0.2}, figures=_figures(3.0)
    ),
    "load": NamedLaw("load_dependent_friction", 1, {"terms": 2, "load_Nm": 1.0}, figures=_figures(0.08, 0.03)),
    "load, four terms": NamedLaw(
        "load_dependent_friction", 2, {"terms": 4, "load_Nm": 9.0}, figures=_figures(0.08, 0.03, 0.02, 0.05)
    ),
    "position": NamedLaw("position_dependent_friction", 2, {"order": 3.0}, figures=_figures(0.7, -0.4)),
    "asymmetric": NamedLaw("asymmetric_friction", 0, {}, figures=_figures(0.8, 0.3)),
}
ALL = tuple(LAWS.values())


def _with(*laws: NamedLaw) -> ChainTorque:
    return replace(model(), named=laws)


@pytest.mark.parametrize("law", ALL, ids=list(LAWS))
def test_torque_is_the_laws_own_beside_the_rest(law: NamedLaw) -> None:
    """To 1e-9 N m, whatever the state."""
    rng, arm = np.random.default_rng(3), three_joints()
    q, dq, ddq = (rng.normal(size=(200, 3)) * scale for scale in (1.0, 1.0, 5.0))
    own = named_torque([law], q, dq, arm.inverse_dynamics(q, dq, ddq), model().losses.transition_speed)
    whole, bare = (one.torque(q[None], dq[None], ddq[None])[0] for one in (_with(law), model()))
    assert np.abs(own).max() > 0.1
    assert whole == pytest.approx(bare + own, abs=1e-9)


@pytest.mark.parametrize("metric", ["signed", "absolute"])
def test_the_bound_stays_below_what_motions_cost(metric: str) -> None:
    """Friction that only takes raises it; no trajectory undercuts it."""
    task = problem(metric=metric, duration=1.5, model=_with(*ALL))
    bound, bare = lower_bound(task), lower_bound(problem(metric=metric, duration=1.5))
    rng = np.random.default_rng(6)
    drawn = task.initial + 0.2 * rng.standard_normal((40, len(task.initial)))
    assert bound <= task.evaluate(np.concatenate([task.initial[None], drawn])).cost.min()
    passive = lower_bound(problem(metric=metric, duration=1.5, model=_with(LAWS["stribeck"], LAWS["curved"])))
    assert passive > bare
