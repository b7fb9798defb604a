"""Lower bounds of the cost."""

import numpy as np
import pytest

from plan.dynamics.power import power_integral, section_nodes
from plan.planners.sequential import Sequential
from plan.solving.bound import lower_bound
from tests.plan.worlds import joint_nets, ledger, model, problem


@pytest.mark.parametrize("net", [None, joint_nets()], ids=["no net", "net"])
def test_no_random_motion_takes_less_energy(net) -> None:  # type: ignore[no-untyped-def]
    """Of many motions between the ends none lies below the bound, in any metric that counts joules."""
    rng = np.random.default_rng(0)
    for metric in ("signed", "positive", "absolute"):
        task = problem(model=model(net), metric=metric, duration=1.0)
        bound = lower_bound(task)
        motions = task.decode(task.initial + 0.3 * rng.normal(size=(200, task.dimension)))
        s, w = section_nodes(40)
        q, dq, ddq = motions.states(s)
        weights = (motions.durations[:, :, None] * w).reshape(200, -1)
        costs = power_integral(task.model.torque(q, dq, ddq), dq, weights, metric)
        assert costs.min() >= bound


def test_the_energy_bound_is_what_steady_motion_needs() -> None:
    """Without a net the signed bound is lift, viscous loss at steady speed and friction, by hand."""
    task = problem(metric="signed", duration=2.0)
    way, losses = task.goal - task.start, task.model.losses
    arm = task.scene.arm
    q = task.start + np.linspace(0, 1, 2001)[:, None] * way
    lift = float(np.trapezoid(arm.inverse_dynamics(q, 0 * q, 0 * q) @ way, dx=1 / 2000))
    friction = losses.coulomb @ (np.abs(way) - 0.2785 * 0.01 * 2.0) + losses.viscous @ way**2 / 2.0
    assert lower_bound(task) == pytest.approx(lift + friction + losses.offset @ way, rel=1e-3)


def test_no_plan_is_faster_than_the_bound() -> None:
    """A time plan lies above the bound, and a task limited by speed alone takes its way by its speed."""
    task = problem(objective="time", free="both")
    best = Sequential(starts=1, kept=(1,), levels=1).run([task], ledger(), np.random.default_rng(0)).best
    bound = lower_bound(task)
    assert bound <= best.cost
    assert bound >= np.max(np.abs(task.goal - task.start) / task.limits.speed)


def test_copper_has_no_bound() -> None:
    """Where nothing is known nothing is claimed."""
    assert lower_bound(problem(metric="copper")) is None
