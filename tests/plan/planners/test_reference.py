"""The gradient reference: its torque is Pinocchio's and the compiled one; it ends where the default planner does."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from plan.planners.reference import Reference, rigid_torque, torque
from plan.planners.sequential import Sequential
from plan.problem.certificate import certify
from plan.problem.rules import WayRules
from tests.ident.made_up import sliding_arm
from tests.plan.dynamics.test_power import ALL
from tests.plan.worlds import MONITOR, bounded_nets, dense_net, joint_nets, ledger, model, problem


@pytest.mark.parametrize("name", ["tm5-900", "panda", "sliding"])
def test_rigid_torque_is_pinocchios(name: str) -> None:
    arm = sliding_arm() if name == "sliding" else ArmModel.load(name)
    states = np.random.default_rng(0).normal(size=(3, 50, arm.n))
    symbols = [ca.SX.sym(part, arm.n) for part in "qva"]
    function = ca.Function("tau", symbols, [ca.vertcat(*rigid_torque(arm.chain, *symbols))])
    ours = np.array(function.map(50)(*(part.T for part in states))).T
    assert np.abs(ours - arm.inverse_dynamics(*states)).max() < 1e-11


@pytest.mark.parametrize("net", [None, joint_nets(), bounded_nets()], ids=["bare", "net", "bounded"])
def test_torque_is_the_compiled_one_and_smooth_at_rest(net: object) -> None:
    """Losses, named laws and nets, but for rounded corners; slopes are finite where every law has its corner."""
    hybrid = replace(model(net), named=ALL)  # type: ignore[arg-type]
    symbols = [ca.SX.sym(part, 3) for part in "qva"]
    tau = ca.vertcat(*torque(hybrid, *symbols, 0.0))
    function = ca.Function("tau", symbols, [tau, ca.jacobian(tau, ca.vertcat(*symbols))])
    for state in np.random.default_rng(4).normal(size=(20, 3, 1, 1, 3)) + 0.3:  # whatever other tests have drawn
        assert np.array(function(*state[:, 0, 0])[0])[:, 0] == pytest.approx(hybrid.torque(*state)[0, 0], abs=2e-2)
    assert np.isfinite(np.array(function(0.3, 0.0, 0.0)[1])).all()


@pytest.mark.parametrize("case", ["energy", "copper", "acceleration and jerk"])
def test_ends_where_the_default_planner_does(case: str) -> None:
    """Two programmes on the same via points, one optimum: within 0.3 % of each other, and certified."""
    task = problem(vias=4, duration=0.9, grows=False, metric="copper" if case == "copper" else "absolute")
    if case == "acceleration and jerk":
        task = replace(task, limits=replace(task.limits, acceleration=np.full(3, 8.0), jerk=np.full(3, 200.0)))
    ours, known = (p.run([task], ledger(), np.random.default_rng(0)).best for p in (Reference(starts=2), Sequential()))
    assert ours.cost == pytest.approx(known.cost, rel=3e-3)
    assert ours.problem.via_count == task.via_count
    assert not certify(task, ours.splines).broken


def test_shortest_time_is_the_default_planners_and_meets_a_limit() -> None:
    """By time stamps alone; the via points stay where they are named."""
    task = problem(objective="time", free="times", grows=False)
    ours, known = (p.run([task], ledger(), np.random.default_rng(0)).best for p in (Reference(), Sequential()))
    assert ours.cost == pytest.approx(known.cost, rel=3e-3)
    assert ours.splines.points[0, 1:-1] == pytest.approx(task.vias)
    assert max(certify(task, ours.splines).torque_share.max(), ours.splines.top_speed.max() / np.pi) > 0.99


def test_what_has_no_symbols_is_refused() -> None:
    cases = {
        "obstacles": problem(MONITOR),
        "rules": replace(problem(), way=WayRules(speed=1.0)),
        "net": problem(model=model(dense_net())),
    }
    for word, task in cases.items():
        with pytest.raises(InputError, match=word):
            Reference().run([task], ledger(), np.random.default_rng(0))
