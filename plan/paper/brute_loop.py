"""The compiled loop of the brute-force search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numba import njit

from ident.arrays import Array, Float
from ident.laws.carried import JointStates, NamedLaw
from plan.dynamics.compiled_nets import CompiledDenseNet, CompiledJointNets
from plan.dynamics.newton_euler import _rnea, inverse_dynamics
from plan.dynamics.power import ChainTorque, Metric
from plan.errors import MethodError

# Rigid torques in a table of the default net.
TABLE = 1024
KINDS: dict[Metric, int] = {"signed": 0, "positive": 1, "absolute": 2, "copper": 3}


@dataclass(frozen=True, eq=False)
class Courses:
    """The courses that single joints may take.

    Attributes:
        vias: Via angles of each joint's courses, three arrays (M, V) [rad].
        states: Position, speed, acceleration of each joint's courses at the nodes, three arrays (3, K, M).
        weights: Quadrature weights of the nodes [s].
    """

    vias: tuple[Float[Array, "M V"], ...]
    states: tuple[Float[Array, "3 K M"], ...]
    weights: Float[Array, " K"]


@njit(cache=True, fastmath=True, nogil=True)
def _coefficients(rot, off, axes, sliding, mass, com, inertia, gravity, turns, second, third):  # type: ignore[no-untyped-def]
    """τ = c₀ + c₁ a + c₂ v + c₃ v² + c₄ cos q + c₅ sin q in the first joint's state, at every node.

    Args:
        turns: Whether the first joint turns against gravity; the last two coefficients are zero if not.
        second, third: State of joints 2 and 3 at the nodes, shape (3, K).

    Returns:
        Coefficients, shape (K, 3, 6).
    """
    nodes = second.shape[1]
    out = np.zeros((nodes, 3, 6))
    q, dq, ddq, none = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    work = np.empty((3, 18))
    base, plus, minus, push, weight = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(nodes):
        q[1], dq[1], ddq[1] = second[0, k], second[1, k], second[2, k]
        q[2], dq[2], ddq[2] = third[0, k], third[1, k], third[2, k]
        g = none if turns else gravity
        q[0], dq[0], ddq[0] = 0.0, 0.0, 0.0
        _rnea(rot, off, axes, sliding, mass, com, inertia, g, q, dq, ddq, work, base)
        ddq[0] = 1.0
        _rnea(rot, off, axes, sliding, mass, com, inertia, g, q, dq, ddq, work, push)
        ddq[0], dq[0] = 0.0, 1.0
        _rnea(rot, off, axes, sliding, mass, com, inertia, g, q, dq, ddq, work, plus)
        dq[0] = -1.0
        _rnea(rot, off, axes, sliding, mass, com, inertia, g, q, dq, ddq, work, minus)
        for j in range(3):
            out[k, j, 0] = base[j]
            out[k, j, 1] = push[j] - base[j]
            out[k, j, 2] = 0.5 * (plus[j] - minus[j])
            out[k, j, 3] = 0.5 * (plus[j] + minus[j]) - base[j]
        if turns:
            # Gravity alone, with the first joint at 0, π and π/2: constant, cosine and sine part.
            dq[0] = 0.0
            for turn in range(3):
                q[0] = (0.0, np.pi, np.pi / 2)[turn]
                _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, q, none, none, work, weight)
                for j in range(3):
                    if turn == 0:
                        out[k, j, 0] += 0.5 * weight[j]
                        out[k, j, 4] += 0.5 * weight[j]
                        out[k, j, 5] -= 0.5 * weight[j]
                    elif turn == 1:
                        out[k, j, 0] += 0.5 * weight[j]
                        out[k, j, 4] -= 0.5 * weight[j]
                        out[k, j, 5] -= 0.5 * weight[j]
                    else:
                        out[k, j, 5] += weight[j]
    return out


@njit(cache=True, fastmath=True, nogil=True)
def _add_energies(c, turns, v1, a1, cos1, sin1, loss1, loss2, loss3, v2, v3, weights, kind, residual, energy):  # type: ignore[no-untyped-def]
    """Adds up the energy of all courses of the first joint, for one course of each other joint.

    Args:
        v1, a1, cos1, sin1, loss1: Of the first joint, shape (K, M).
        loss2, loss3, v2, v3: Of the other two, shape (K,).
        residual: Torque of the net, shape (K, M, 3), or (0, 0, 0) without.
        energy: Result, shape (M,).
    """
    nodes, courses = v1.shape
    net = residual.shape[0] > 0
    for m in range(courses):
        energy[m] = 0.0
    for k in range(nodes):
        w, s2, s3 = weights[k], v2[k], v3[k]
        for m in range(courses):
            v, a = v1[k, m], a1[k, m]
            square = v * v
            t1 = c[k, 0, 0] + c[k, 0, 1] * a + c[k, 0, 2] * v + c[k, 0, 3] * square + loss1[k, m]
            t2 = c[k, 1, 0] + c[k, 1, 1] * a + c[k, 1, 2] * v + c[k, 1, 3] * square + loss2[k]
            t3 = c[k, 2, 0] + c[k, 2, 1] * a + c[k, 2, 2] * v + c[k, 2, 3] * square + loss3[k]
            if turns:
                t1 += c[k, 0, 4] * cos1[k, m] + c[k, 0, 5] * sin1[k, m]
                t2 += c[k, 1, 4] * cos1[k, m] + c[k, 1, 5] * sin1[k, m]
                t3 += c[k, 2, 4] * cos1[k, m] + c[k, 2, 5] * sin1[k, m]
            if net:
                t1 += residual[k, m, 0]
                t2 += residual[k, m, 1]
                t3 += residual[k, m, 2]
            p1, p2, p3 = t1 * v, t2 * s2, t3 * s3
            if kind == 3:
                p1, p2, p3 = t1 * t1, t2 * t2, t3 * t3
            elif kind == 2:
                p1, p2, p3 = abs(p1), abs(p2), abs(p3)
            elif kind == 1:
                p1, p2, p3 = max(p1, 0.0), max(p2, 0.0), max(p3, 0.0)
            energy[m] += w * (p1 + p2 + p3)


@njit(cache=True, fastmath=True, nogil=True)
def _look_up(c, turns, v1, a1, cos1, sin1, low, step, table1, table2, table3, out):  # type: ignore[no-untyped-def]
    """Residual torque from tables over the rigid torque, linear in between.

    Args:
        c, turns, v1, a1, cos1, sin1: As in `_add_energies`.
        low, step: First rigid torque of each joint's table and its step, shape (3,) [N m].
        table1: Of the first joint, shape (K, M, G).
        table2, table3: Of the other two joints' courses, shape (K, G).
        out: Result, shape (K, M, 3).
    """
    nodes, courses = v1.shape
    last = table1.shape[2] - 2
    for k in range(nodes):
        for m in range(courses):
            v, a = v1[k, m], a1[k, m]
            for j in range(3):
                load = c[k, j, 0] + c[k, j, 1] * a + c[k, j, 2] * v + c[k, j, 3] * v * v
                if turns:
                    load += c[k, j, 4] * cos1[k, m] + c[k, j, 5] * sin1[k, m]
                place = (load - low[j]) / step[j]
                i = min(max(int(place), 0), last)
                part = place - i
                if j == 0:
                    left, right = table1[k, m, i], table1[k, m, i + 1]
                elif j == 1:
                    left, right = table2[k, i], table2[k, i + 1]
                else:
                    left, right = table3[k, i], table3[k, i + 1]
                out[k, m, j] = left + part * (right - left)


class BruteLoop:
    """Energies of all grid points of a three-joint arm, block by block.

    With the default net, a joint's residual depends on its own course and its rigid torque only: each course gets a
    table over that torque. The paper's net has to be evaluated as a whole; its first layer is a sum over the joints,
    tabled for each.
    """

    def __init__(self, model: ChainTorque, courses: Courses, metric: Metric) -> None:
        self.model, self.courses, self.metric = model, courses, metric
        first = courses.states[0]
        self.turns = turns_against_gravity(model)
        still = np.zeros_like(first[0])
        self.wheel = (np.cos(first[0]), np.sin(first[0])) if self.turns else (still, still)
        self.losses = [_loss(model, j, courses.states[j]) for j in range(3)]
        loaded = any(law.bears_load for law in model.named)
        if loaded and isinstance(model.net, CompiledDenseNet):
            what = "goes through no table that knows the paper's net and friction by load at once"
            raise MethodError("--method brute", what, "use --method reference")
        tabled = loaded or isinstance(model.net, CompiledJointNets)
        self.tables = JointTables(model, courses) if tabled else None
        self.sums = FirstLayer(model.net, courses) if isinstance(model.net, CompiledDenseNet) else None

    @property
    def exact(self) -> bool:
        """Whether nothing is read from tables by interpolation."""
        return self.tables is None

    def block(self, second: int) -> Float[Array, "M M"]:
        """Energies for one course of joint 2, every course of joint 3 (rows) and of joint 1 (columns)."""
        _, v1, a1 = self.courses.states[0]
        own = np.ascontiguousarray(self.courses.states[1][:, :, second])
        out = np.empty((v1.shape[1], v1.shape[1]))
        residual = np.empty((*v1.shape, 3) if self.model.net is not None or self.tables is not None else (0, 0, 0))
        for third in range(len(out)):
            other = np.ascontiguousarray(self.courses.states[2][:, :, third])
            c = _coefficients(*self.model.chain.dynamics, self.turns, own, other)  # type: ignore[call-arg]
            if self.tables is not None:
                low, step, first, *others = self.tables.of(second, third)
                _look_up(c, self.turns, v1, a1, *self.wheel, low, step, first, others[0], others[1], residual)
            elif self.sums is not None:
                residual = self.sums.torque(second, third)
            sums = (self.losses[0], self.losses[1][:, second].copy(), self.losses[2][:, third].copy())
            rest = (own[1], other[1], self.courses.weights, KINDS[self.metric], residual, out[third])
            _add_energies(c, self.turns, v1, a1, *self.wheel, *sums, *rest)
        return out


def turns_against_gravity(model: ChainTorque) -> bool:
    """Whether gravity's torque depends on the first joint: not if that is a vertical revolute one."""
    axis = model.chain.rotations[0, 0] @ model.chain.axes[0]
    level = np.linalg.norm(np.cross(axis, model.chain.gravity)) > 1e-9
    return bool(level or model.chain.sliding[0] > 0)


def _loss(model: ChainTorque, j: int, states: Float[Array, "3 K M"]) -> Float[Array, "K M"]:
    losses = model.losses
    width = float(losses.transition_speed[j])
    slip = np.tanh(states[1] / width) if width > 0 else np.sign(states[1])
    rate = losses.motor_inertia[j] * states[2] + losses.viscous[j] * states[1]
    found = rate + losses.coulomb[j] * slip + losses.offset[j]
    for law in _laws_of(model, j, by_load=False):
        at = JointStates(states[0].ravel(), states[1].ravel(), np.zeros(slip.size), slip.ravel())
        found = found + law.torque(at).reshape(slip.shape)
    return found


def _laws_of(model: ChainTorque, j: int, by_load: bool) -> list[NamedLaw]:
    """Named laws of a joint: those of its load, or those of its own course alone."""
    return [law for law in model.named if law.joint == j and law.bears_load == by_load]


class JointTables:
    """The default net and friction by load, joint by joint and course by course, over the rigid torque."""

    def __init__(self, model: ChainTorque, courses: Courses) -> None:
        low, high = _rigid_range(model, courses)
        self.low, self.step = low, (high - low) / (TABLE - 1)
        self.tables = [_table(model, j, courses.states[j], low[j] + self.step[j] * np.arange(TABLE)) for j in range(3)]

    def of(self, second: int, third: int) -> tuple[Array, ...]:
        """What the loop needs for one course of joints 2 and 3."""
        rows = (np.ascontiguousarray(self.tables[j][:, course]) for j, course in ((1, second), (2, third)))
        return (self.low, self.step, self.tables[0], *rows)


def _table(
    model: ChainTorque, j: int, states: Float[Array, "3 K M"], loads: Float[Array, " G"]
) -> Float[Array, "K M G"]:
    nodes, courses = states.shape[1:]
    out, laws = np.zeros((nodes, courses, len(loads))), _laws_of(model, j, by_load=True)
    width = float(model.losses.transition_speed[j])
    for k in range(nodes):
        v, a = (np.repeat(part[k], len(loads)) for part in states[1:])
        load = np.tile(loads, courses)
        if isinstance(model.net, CompiledJointNets):
            out[k] += model.net.joint_torque(j, v, a, load).reshape(courses, len(loads))
        slip = np.tanh(v / width) if width > 0.0 else np.sign(v)
        for law in laws:
            out[k] += law.torque(JointStates(np.zeros_like(v), v, load, slip)).reshape(courses, len(loads))
    return out


def _rigid_range(model: ChainTorque, courses: Courses) -> tuple[Float[Array, " 3"], Float[Array, " 3"]]:
    """Lowest and highest rigid torque of each joint over a sample of the grid, widened by a quarter.

    Beyond it a table is continued by its last slope; the grid's best are evaluated without tables anyway.
    """
    rng = np.random.default_rng(0)  # fixed: the tables are no part of the search
    count = courses.states[0].shape[2]
    chosen = rng.integers(0, count, (3, 4000))
    q, dq, ddq = (
        np.stack([courses.states[j][part][:, chosen[j]].reshape(-1) for j in range(3)], axis=1) for part in range(3)
    )
    rigid = inverse_dynamics(model.chain, q, dq, ddq)
    low, high = rigid.min(axis=0), rigid.max(axis=0)
    return low - 0.25 * (high - low) - 0.1, high + 0.25 * (high - low) + 0.1


class FirstLayer:
    """The paper's net with its first layer tabled: a sum over the joints."""

    def __init__(self, net: CompiledDenseNet, courses: Courses) -> None:
        self.net = net
        self.parts = [_first_layer(net, j, courses.states[j]) for j in range(3)]
        self.bias = torch.from_numpy(net.biases[0].astype(np.float32))

    def torque(self, second: int, third: int) -> Float[Array, "K M 3"]:
        """Residual torque at every node for every course of joint 1."""
        others = self.parts[1][:, second] + self.parts[2][:, third] + self.bias
        return self.net.after_first(self.parts[0] + others[:, None]).numpy().astype(float)


def _first_layer(net: CompiledDenseNet, j: int, states: Float[Array, "3 K M"]) -> torch.Tensor:
    """What one joint's states add to the first layer's sums, shape (K, M, width)."""
    own = torch.from_numpy(np.stack(list(states), axis=-1).astype(np.float32))
    columns = net.weights[0][:, j :: net.weights[-1].shape[0]].astype(np.float32)
    return own @ torch.from_numpy(np.ascontiguousarray(columns)).T
