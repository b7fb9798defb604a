"""The symbolic model is the numeric one with its derivatives, and IPOPT ends where the default planner does."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from ident.laws.carried import named_torque
from plan.dynamics.torque_gradient import differentiate_torque, rounded
from plan.errors import MethodError
from plan.initial.starts import from_vias
from plan.planners import symbolic
from plan.planners.planes import make_slots
from plan.planners.reference import Reference
from plan.planners.reference_graph import _slot_function, _torque
from plan.planners.sequential import Sequential
from plan.problem.result import certify
from tests.plan.dynamics.test_named_friction import ALL, LAWS
from tests.plan.worlds import MONITOR, bounded_nets, dense_net, joint_nets, ledger, model, problem


@pytest.mark.parametrize(
    "net", [None, joint_nets(), bounded_nets(), dense_net()], ids=["bare", "default", "bounded", "paper"]
)
def test_torque_and_gradient_are_the_compiled_models(net: object) -> None:
    """Rigid body, losses and net to single precision; derivatives by angle, speed and acceleration to 1e-3 of each."""
    hybrid = rounded(model(net), 0.01)  # type: ignore[arg-type]
    parts = [ca.MX.sym(part, 3, 1) for part in ("q", "dq", "ddq")]
    torque = _torque(hybrid, *parts, ca.MX(0.0))
    function = ca.Function("tau", parts, [torque, *(ca.jacobian(torque, part) for part in parts)])
    states = np.random.default_rng(1).normal(size=(3, 7, 3))
    known = differentiate_torque(hybrid, *states)
    for t, state in enumerate(states.transpose(1, 0, 2)):
        tau, *slopes = (np.array(part) for part in function(*state))
        assert tau.reshape(-1) == pytest.approx(known.tau[t], abs=1e-3)
        for ours, theirs in zip(slopes, (known.by_position, known.by_speed, known.by_acceleration), strict=True):
            assert ours == pytest.approx(theirs[t], rel=1e-3, abs=5e-3)


@pytest.mark.parametrize("law", ALL, ids=list(LAWS))
def test_named_laws_are_smooth_at_rest(law: object) -> None:
    names = [ca.SX.sym(name) for name in ("q", "dq", "load")]
    torque = symbolic.law_symbols(law, *names, ca.tanh(names[1] / 0.02), 0.02)  # type: ignore[arg-type]
    function = ca.Function("law", names, [torque, ca.jacobian(torque, ca.vertcat(*names))])
    assert np.isfinite(np.array(function(0.3, 0.0, 0.0)[1])).all()
    exact = named_torque([law], *(np.full((1, 3), x) for x in (0.3, 1.0, 30.0)), np.full(3, 0.02))  # type: ignore
    assert float(function(0.3, 1.0, 30.0)[0]) == pytest.approx(exact[0, law.joint], rel=2e-3)  # type: ignore


def test_spline_and_slots_are_the_compiled_ones() -> None:
    """States at the nodes; and a slot's clearance is a pair's distance where its plane was chosen."""
    task = problem(MONITOR, duration=1.0, clearance=0.0)
    splines, s = task.decode(task.initial + 0.3), np.array([0.0, 0.4, 1.0])
    z = np.concatenate([splines.points[0, 1:-1].reshape(-1), splines.durations[0]])
    for ours, theirs in zip(
        symbolic.spline_function(3, 2, s)(z, task.start, task.goal), splines.states(s), strict=True
    ):
        assert pytest.approx(theirs[0], abs=1e-9) == np.array(ours).T
    slots = [slot for slot in make_slots(task, splines, 12, 0.0).T if slot[7] > -1]
    assert slots
    for slot in slots:
        q = splines.states(np.array([slot[3]]))[0][0, int(np.argmax(slot[:3]))]
        gap = float(_slot_function(task.model.chain, 2)(z, task.start, task.goal, slot)) + slot[7]
        assert np.abs(task.scene.proximity.distances(q) - gap).min() < 2e-3


@pytest.mark.parametrize("limited", [False, True], ids=["table 3", "acceleration and jerk"])
def test_ends_where_the_default_planner_does_with_named_vias(limited: bool) -> None:
    """Two programmes, one optimum: within 0.5 % of each other, on the same via points' count, both certified."""
    task = problem(vias=4 if limited else 2, duration=0.9 if limited else 0.65, grows=False)
    if limited:
        task = replace(task, limits=replace(task.limits, acceleration=np.full(3, 8.0), jerk=np.full(3, 200.0)))
    ours, known = (p.run([task], ledger(), np.random.default_rng(0)).best for p in (Reference(), Sequential()))
    assert ours.cost == pytest.approx(known.cost, rel=5e-3)
    assert ours.problem.via_count == task.via_count
    assert ours.feasible
    assert not certify(task, ours.splines).broken


def test_time_stamps_meet_a_limit_on_the_via_points_that_are_named() -> None:
    task = problem(objective="time", free="times")
    best = Reference().run([task], ledger(), np.random.default_rng(0)).best
    found = certify(task, best.splines)
    assert best.feasible
    assert best.splines.points[0, 1:-1] == pytest.approx(task.vias)
    assert max(found.torque_share.max(), found.speed_share.max()) > 0.99


def test_margins_are_kept_and_used_up() -> None:
    """With a box in the way the proven clearance is what was asked for, and no more than the planes' share above."""
    task = problem(MONITOR, duration=1.0)
    start = from_vias(task, np.radians([[40.0, 20.0, -94.0]]), "beside", 2)
    best = Reference(screening=200).run([start], ledger(), np.random.default_rng(0)).best
    found = certify(best.problem, best.splines)
    assert not found.broken
    assert found.clearance.proven < 0.02


def test_what_has_no_symbols_or_no_freedom_is_refused() -> None:
    class Other:
        n = 3

        def torque(self, q, dq, ddq):  # type: ignore[no-untyped-def]
            return 0.0 * q

    stiff = problem()
    for task in (problem(model=Other()), replace(stiff, limits=replace(stiff.limits, jerk=np.full(3, 1e3)))):
        with pytest.raises(MethodError, match=r"derivatives|nothing free"):
            Reference().run([task], ledger(), np.random.default_rng(0))
