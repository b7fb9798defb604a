"""The compiled loop of the brute-force search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numba import njit

from ident.arrays import Array, Float
from plan.network import DenseNet
from plan.power import ChainTorque, Metric
from plan.rigid import _rnea

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


def energies_of_block(model: ChainTorque, courses: Courses, second: int, metric: Metric) -> Float[Array, "M M"]:
    """Energies for one course of joint 2, every course of joint 3 (rows) and of joint 1 (columns)."""
    first = courses.states[0]
    count = first.shape[2]
    losses = [_loss(model, j, courses.states[j]) for j in range(3)]
    turns = turns_against_gravity(model)
    still = np.zeros_like(first[0])
    wheel = (np.cos(first[0]), np.sin(first[0])) if turns else (still, still)
    own = np.ascontiguousarray(courses.states[1][:, :, second])
    net = None if model.net is None else _NetBlock(model.net, courses, second)
    empty = np.empty((0, 0, 0), dtype=np.float32)
    out = np.empty((count, count))
    for third in range(count):
        other = np.ascontiguousarray(courses.states[2][:, :, third])
        c = _coefficients(*model.chain.dynamics, turns, own, other)
        sums = (losses[0], losses[1][:, second].copy(), losses[2][:, third].copy())
        residual = empty if net is None else net.torque(third)
        rest = (own[1], other[1], courses.weights, KINDS[metric], residual, out[third])
        _add_energies(c, turns, first[1], first[2], *wheel, *sums, *rest)
    return out


def turns_against_gravity(model: ChainTorque) -> bool:
    """Whether gravity's torque depends on the first joint: not if that is a vertical revolute one."""
    axis = model.chain.rotations[0, 0] @ model.chain.axes[0]
    level = np.linalg.norm(np.cross(axis, model.chain.gravity)) > 1e-9
    return bool(level or model.chain.sliding[0] > 0)


def _loss(model: ChainTorque, j: int, states: Float[Array, "3 K M"]) -> Float[Array, "K M"]:
    losses = model.losses
    width = losses.transition_speed
    slip = np.tanh(states[1] / width) if width > 0 else np.sign(states[1])
    rate = losses.motor_inertia[j] * states[2] + losses.viscous[j] * states[1]
    return rate + losses.coulomb[j] * slip + losses.offset[j]


class _NetBlock:
    """The net for one course of joint 2: its first layer is a sum over the joints, each tabled beforehand."""

    def __init__(self, net: DenseNet, courses: Courses, second: int) -> None:
        self.net = net
        tables = [_first_layer(net, j, courses.states[j]) for j in range(3)]
        bias = torch.from_numpy(net.biases[0].astype(np.float32))
        self.base = tables[0] + (tables[1][:, second] + bias)[:, None]
        self.third = tables[2]

    def torque(self, third: int) -> Float[Array, "K M 3"]:
        """Residual torque at every node for every course of joint 1."""
        return self.net.after_first(self.base + self.third[:, third][:, None]).numpy()


def _first_layer(net: DenseNet, j: int, states: Float[Array, "3 K M"]) -> torch.Tensor:
    """What one joint's states add to the first layer's sums, shape (K, M, width)."""
    n = net.weights[-1].shape[0]
    q, dq, ddq = (torch.from_numpy(part.astype(np.float32))[:, :, None] for part in states)
    own = net.features(q.numpy(), dq.numpy(), ddq.numpy())
    columns = net.weights[0][:, j::n].astype(np.float32)
    return own @ torch.from_numpy(np.ascontiguousarray(columns)).T
