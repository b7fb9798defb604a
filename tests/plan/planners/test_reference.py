"""The symbolic model equals the numeric one, and the reference is where no other method gets below."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from ident.robot.arm import ArmModel
from plan.dynamics.chain import Chain
from plan.dynamics.power import METRICS, ChainTorque
from plan.initial.starts import from_vias
from plan.planners import symbolic
from plan.planners.brute_force import BruteForce
from plan.planners.evolution import Evolution
from plan.planners.planes import make_slots
from plan.planners.reference import Reference
from plan.planners.reference_graph import _slot_function, _torque, slot_size
from plan.problem.result import certify
from tests.plan.worlds import MONITOR, bounded_nets, dense_net, joint_nets, ledger, losses, model, problem, three_joints


@pytest.mark.parametrize("name", ["tm5-900", "panda"])
def test_newton_euler_equals_pinocchio(name: str) -> None:
    """The symbolic recursion equals Pinocchio to 1e-11 N m."""
    arm = ArmModel.load(name)
    parts = [ca.SX.sym(part, arm.n) for part in ("q", "dq", "ddq")]
    function = ca.Function("tau", parts, [symbolic.inverse_dynamics(Chain.from_arm(arm), *parts)])
    for state in np.random.default_rng(0).normal(size=(20, 3, arm.n)):
        known = arm.inverse_dynamics(*state[:, None])[0]
        assert np.array(function(*state)).reshape(-1) == pytest.approx(known, abs=1e-11)


@pytest.mark.parametrize(
    "net", [None, joint_nets(), bounded_nets(), dense_net()], ids=["no net", "default", "bounded", "paper"]
)
def test_symbolic_torque_equals_numeric(net: object) -> None:
    """Rigid body, losses and net in CasADi equal the compiled model to single precision."""
    hybrid = model(net)  # type: ignore[arg-type]
    parts = [ca.MX.sym(part, 3, 7) for part in ("q", "dq", "ddq")]
    function = ca.Function("tau", parts, [_torque(hybrid, *parts, ca.MX(0.01))])
    states = np.random.default_rng(1).normal(size=(3, 7, 3))
    found = np.array(function(*(part.T for part in states))).T
    assert found == pytest.approx(hybrid.torque(*states), abs=1e-4)


def test_symbolic_spline_equals_numeric() -> None:
    """States at the nodes from the symbolic spline equal the compiled one's."""
    task = problem(vias=3)
    s = np.array([0.0, 0.4, 1.0])
    function = symbolic.spline_function(3, 3, s)
    durations = np.array([0.1, 0.3, 0.2, 0.15])
    found = function(np.concatenate([task.vias.reshape(-1), durations]), task.start, task.goal)
    known = replace(task, durations=durations).decode(task.initial).states(s)
    for ours, theirs in zip(found, known, strict=True):
        assert pytest.approx(theirs[0], abs=1e-9) == np.array(ours).T


def test_slots_bound_distances() -> None:
    """A slot's clearance is the distance at the place where its plane was chosen, to the rounding of edges."""
    task = problem(MONITOR, duration=1.0)
    splines = task.decode(task.initial + 0.3)
    slots = make_slots(task, splines, 12, 0.0)
    function = _slot_function(task.model.chain, task.via_count)
    z = np.concatenate([splines.points[0, 1:-1].reshape(-1), splines.durations[0]])
    seen = 0
    for slot in slots.T:
        assert len(slot) == slot_size(3, 2)
        if slot[7] < -1:  # switched off
            continue
        section, s = int(np.argmax(slot[:3])), slot[3]
        q = splines.states(np.array([s]))[0][0, section]
        gap = float(function(z, task.start, task.goal, slot))
        distances = task.scene.proximity.distances(q)
        assert np.abs(distances - gap).min() < 2e-3
        seen += 1
    assert seen > 0


@pytest.mark.parametrize("metric", METRICS)
def test_at_or_below_the_grid(metric: str) -> None:
    """The gradient optimum is at or below the best point of a 6⁶ grid, by every metric."""
    task = problem(metric=metric)
    best = Reference().run([task], ledger(), np.random.default_rng(0)).best
    grid = BruteForce(levels=6).run([task], ledger(), np.random.default_rng(0)).best
    assert best is not None
    assert grid is not None
    assert best.feasible
    assert best.cost <= grid.cost * (1 + 1e-6)


@pytest.mark.parametrize("net", [joint_nets(), dense_net()], ids=["default", "paper"])
def test_with_a_net(net: object) -> None:
    """With a net inside, CMA-ES finds nothing more than 0.1 % better."""
    task = problem(model=model(net))  # type: ignore[arg-type]
    best = Reference().run([task], ledger(), np.random.default_rng(0)).best
    other = Evolution(most=3000).run([task], ledger(), np.random.default_rng(0)).best
    assert best is not None
    assert other is not None
    assert best.cost <= other.cost * 1.001


def test_first_order_optimality() -> None:
    """At the reference's optimum the cost's slope, by finite differences, is near zero in every direction."""
    task = problem()
    best = Reference().run([task], ledger(), np.random.default_rng(0)).best
    assert best is not None
    steps = np.concatenate([np.eye(6), -np.eye(6)]) * np.radians(0.5)
    around = task.evaluate(best.x + steps).cost
    assert np.all(around >= best.cost - 2e-3)


def test_time_keeps_the_limits_and_meets_one() -> None:
    """The time optimum breaks nothing, and some joint is at its speed or torque limit."""
    task = problem(objective="time", free="times")
    best = Reference(screening=300).run([task], ledger(), np.random.default_rng(0)).best
    assert best is not None
    assert best.feasible
    found = certify(task, best.splines)
    assert max(found.torque_share.max(), found.speed_share.max()) > 0.99
    assert best.cost < 0.6 * 0.65


def test_clearance_constraint_binds() -> None:
    """With a box in the way the result keeps the clearance, proven by Coal, and uses it up."""
    task = problem(MONITOR, duration=1.0)
    start = from_vias(task, np.radians([[40.0, 20.0, -94.0]]), "beside", 2)
    best = Reference(screening=200).run([start], ledger(), np.random.default_rng(0)).best
    assert best is not None
    assert best.feasible
    proof = certify(best.problem, best.splines).clearance
    assert 0.004 < proof.proven < 0.02


def test_unknown_model_is_refused() -> None:
    """A torque model that is not a chain's has no symbols."""
    from plan.errors import MethodError

    class Other:
        n = 3

        def torque(self, q, dq, ddq):  # type: ignore[no-untyped-def]
            return 0.0 * q

    with pytest.raises(MethodError, match="derivatives"):
        Reference().run([problem(model=Other())], ledger(), np.random.default_rng(0))


def test_graph_is_built_once() -> None:
    """The same model and shape of task use one programme."""
    from plan.planners.reference_graph import build

    hybrid = ChainTorque(Chain.from_arm(three_joints()), losses())
    first = build(hybrid, 2, "energy", "absolute", "vias", False, 0)
    assert build(hybrid, 2, "energy", "absolute", "vias", False, 0) is first
