"""The nonlinear programme of the reference planner, built once for a model and a number of via points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ident.arrays import Array
from plan.dynamics.chain import Chain
from plan.dynamics.power import ChainTorque, Metric, section_nodes
from plan.planners import symbolic
from plan.problem.problem import Free, Objective

# Clearance constraints that a programme may have room for; the ones not needed are switched off.
SLOTS = (12, 24, 48)
# Nodes a section at which a time optimum's limits are kept.
LIMIT_NODES = 13
# Rounds off |x| in the extents of boxes, on the safe side [-].
EDGE = 1e-4
# Above this many multiplications a net's second derivatives cost more than they save.
EXACT_BELOW = 20_000


@dataclass(frozen=True, eq=False)
class Transcription:
    """A solver and what it needs to be fed.

    Attributes:
        solver: CasADi's interface to IPOPT.
        nodes: Number of nodes at which limits are kept; none if 0.
        slots: Number of clearance constraints.
    """

    solver: Any
    nodes: int
    slots: int


@lru_cache(maxsize=64)
def build(
    model: ChainTorque, vias: int, sought: tuple[Objective, Metric, Free], limited: bool, slots: int
) -> Transcription:
    """Builds the graph and the solver.

    Variables: the free ones of via angles and section durations. Parameters: the others, start, goal, width of the
    rounded sign [rad/s], of the rounded |power| [W], and the slots.

    Args:
        model: Torque model.
        vias: Number of via points.
        sought: The objective, how energy is counted, and which variables are free.
        limited: Whether limits of position, speed, torque, acceleration and jerk are constraints.
        slots: Number of clearance constraints.
    """
    n, (objective, metric, free) = model.n, sought
    angles, durations = ca.MX.sym("angles", vias * n), ca.MX.sym("durations", vias + 1)
    z, x, fixed = ca.vertcat(angles, durations), *_share_out(angles, durations, free)
    start, goal, widths = ca.MX.sym("start", n), ca.MX.sym("goal", n), ca.MX.sym("widths", 2)
    places = ca.MX.sym("slots", slot_size(n, vias), slots)
    s, w = section_nodes()
    if not limited:
        s, w = s[w > 0], w[w > 0]
    elif objective == "time":
        s = np.linspace(0.0, 1.0, LIMIT_NODES)
    q, dq, ddq = symbolic.spline_function(n, vias, s)(z, start, goal)
    tau: Any = _torque(model, q, dq, ddq, widths[0]) if limited or objective == "energy" else None
    cost = ca.sum1(durations)
    if objective == "energy":
        cost = ca.dot(ca.vec(ca.DM(w) @ durations.T), ca.sum1(_power(tau, dq, metric, widths[1])).T)
    constraints: list[Any] = [ca.vec(part) for part in (q, dq, tau, *_rates(ddq, durations))] if limited else []
    if slots:
        parts = (ca.repmat(part, 1, slots) for part in (z, start, goal))
        constraints.append(_slot_function(model.chain, vias).map(slots)(*parts, places).T)
    if objective == "energy" and free != "vias":
        constraints.append(ca.sum1(durations))
    parameters = ca.vertcat(fixed, start, goal, widths, ca.vec(places))
    programme = {"x": x, "p": parameters, "f": cost, "g": ca.vertcat(*constraints) if constraints else ca.MX(0, 1)}
    return Transcription(
        ca.nlpsol("reference", "ipopt", programme, _options(model)), q.shape[1] if limited else 0, slots
    )


def _rates(ddq: Any, durations: Any) -> tuple[Any, Any]:
    """Acceleration at both ends of every section, where a cubic's is largest, and each section's jerk."""
    sections, n = durations.shape[0], ddq.shape[0]
    each = ddq.shape[1] // sections
    first, last = ddq[:, ::each], ddq[:, each - 1 :: each]
    return ca.horzcat(first, last), (last - first) / ca.repmat(durations.T, n, 1)


def _share_out(angles: Any, durations: Any, free: Free) -> tuple[Any, Any]:
    """What is free, and what is not."""
    if free == "both":
        return ca.vertcat(angles, durations), ca.MX(0, 1)
    return (angles, durations) if free == "vias" else (durations, angles)


def _options(model: ChainTorque) -> dict[str, Any]:
    large = model.net is not None and model.net.products > EXACT_BELOW
    ipopt = {
        "print_level": 0,
        "sb": "yes",
        "max_iter": 60,
        "max_cpu_time": 10.0,
        "tol": 1e-6,
        "acceptable_tol": 1e-4,
        "acceptable_iter": 4,
        "mu_strategy": "adaptive",
        "hessian_approximation": "limited-memory" if large else "exact",
    }
    return {"ipopt": ipopt, "print_time": False, "error_on_fail": False}


def _torque(model: ChainTorque, q: Any, dq: Any, ddq: Any, width: Any) -> Any:
    """Eq. 1 at all nodes: rigid body, losses with a rounded sign, net."""
    n, nodes = model.n, q.shape[1]
    parts = [ca.SX.sym(name, n) for name in ("q", "dq", "ddq")]
    rigid = ca.Function("rigid", parts, [symbolic.inverse_dynamics(model.chain, *parts)])
    losses = model.losses
    widths = [ca.sqrt(width**2 + v**2) for v in losses.transition_speed]
    slip = ca.vertcat(*(ca.tanh(dq[j, :] / widths[j]) for j in range(n)))

    def rows(values: Array) -> Any:
        return ca.repmat(ca.DM(np.array(values, dtype=float)), 1, nodes)

    torque = rigid.map(nodes)(q, dq, ddq)
    tau = torque + rows(losses.motor_inertia) * ddq + rows(losses.viscous) * dq
    tau += rows(losses.coulomb) * slip + rows(losses.offset)
    for law in model.named:
        j = law.joint
        own = symbolic.law_symbols(law, q[j, :], dq[j, :], torque[j, :], slip[j, :], widths[j])
        tau += ca.vertcat(*(own if i == j else ca.MX.zeros(1, nodes) for i in range(n)))
    if model.net is not None:
        tau += symbolic.residual_torque(model.net, q, dq, ddq, torque)
    return tau


def _power(tau: Any, dq: Any, metric: Metric, width: Any) -> Any:
    power = tau * dq
    if metric == "copper":
        return tau * tau
    if metric == "signed":
        return power
    rounded = ca.sqrt(power * power + width * width) - width
    return rounded if metric == "absolute" else 0.5 * (power + rounded)


def slot_size(n: int, vias: int) -> int:
    """Numbers that describe a slot: section weights, local time, plane normal, margin, and two boxes."""
    return (vias + 1) + 1 + 3 + 1 + 2 * (n + 1 + 15)


def _slot_function(chain: Chain, vias: int) -> Any:
    """Clearance along a plane's normal, less the margin: what a slot keeps above zero [m].

    Two boxes are at least d apart if there is a unit vector a with aᵀ(c₂ − c₁) − Σ h₁|aᵀe₁| − Σ h₂|aᵀe₂| ≥ d, and the
    largest such d over all a is their distance. With a held fixed this is smooth in the joints but for the moduli,
    which are rounded upwards.
    """
    n = chain.n
    z, start, goal = ca.SX.sym("z", vias * n + vias + 1), ca.SX.sym("start", n), ca.SX.sym("goal", n)
    slot = ca.SX.sym("slot", slot_size(n, vias))
    which, rest = slot[: vias + 1], slot[vias + 1 :]
    s, normal, margin, boxes = rest[0], rest[1:4], rest[4], rest[5:]
    points, h = symbolic.split(z, start, goal, n, vias)
    slopes = symbolic.knot_slopes(points, h)

    def chosen(values: list[Any]) -> Any:
        return sum(which[k] * values[k] for k in range(vias + 1))

    q0, q1, v0, v1 = (chosen(part) for part in (points[:-1], points[1:], slopes[:-1], slopes[1:]))
    q, _, _ = symbolic.section_state(q0, q1, v0, v1, chosen(h), s)
    frames = symbolic.placements(chain, q)
    size = n + 1 + 15
    first, second = (_extent(frames, boxes[i * size : (i + 1) * size], normal) for i in range(2))
    gap = second[0] - first[0] - first[1] - second[1] - margin
    return ca.Function("gap", [z, start, goal, slot], [gap])


def _extent(frames: list[Any], box: Any, normal: Any) -> tuple[Any, Any]:
    """Centre of a box along the normal, and how far it reaches to each side of that [m]."""
    carrier, turn, centre, half = box[: len(frames)], box[len(frames) :][:9], box[-6:-3], box[-3:]
    r = sum(carrier[k] * frames[k][0] for k in range(len(frames)))
    p = sum(carrier[k] * frames[k][1] for k in range(len(frames)))
    edges = (r @ ca.reshape(turn, 3, 3)).T @ normal
    reach = ca.dot(half, ca.sqrt(edges * edges + EDGE**2))
    return ca.dot(normal, p + r @ centre), reach
