"""Columns that stand under another joint's name: which torque, and which position, follows which joint's model.

A joint's torque is made of its own gravity, inertia and friction. Under a permutation of the positions the model gives
each joint what its torque would be made of, and a table of how much of each recorded torque that explains; the best
assignment of torques to joints (Kuhn-Munkres) is compared with the one of the file, by logarithms of residuals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment, nnls

from ident.arrays import Array, Float
from ident.checks.effort import States, joint_terms
from ident.checks.report import joints_at
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

# Residuals of the joints that change places must shrink by this factor each, and so much must be explained then.
LEAST_FACTOR, LEAST_EXPLAINED = 3.0, 0.6
# Part of a torque's variance that no order explains; states that are compared.
FLOOR, STATES = 0.01, 400
# A torque of which its joint's model leaves less is where it belongs.
WELL = 0.4


@dataclass(frozen=True, eq=False)
class Order:
    """One order of the columns.

    Attributes:
        positions: Column of the file that is each joint's position.
        torques: Column of the file that is each joint's torque.
        left: Share of each joint's torque that the model leaves in this order.
    """

    positions: tuple[int, ...]
    torques: tuple[int, ...]
    left: Float[Array, " n"]

    @property
    def cost(self) -> float:
        """Sum of the logarithms of the residuals."""
        return float(np.log(self.left).sum())


def check_order(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Whether another order of the columns explains the torque far better than the file's.

    Args:
        session: The recordings, mended.
        arm: The robot with the session's payload, mounted as it is.
        states: The recordings' motion.
    """
    n = arm.n
    if n < 2 or not states.alive.any():
        return []
    step = slice(None, None, max(1, len(states.q) // STATES))
    thin = replace(states, **{name: getattr(states, name)[step] for name in STATE_NAMES})
    own = tuple(range(n))
    table = _left(thin, arm, own)
    here = Order(own, own, np.diag(table))
    best = _assigned(own, table)
    # Where every torque follows its own joint, positions stand where they belong.
    for _ in range(n - 1 if here.left[states.alive].max() > WELL else 0):
        orders = []
        for i, j in combinations(range(n), 2):
            order = list(best.positions)
            order[i], order[j] = order[j], order[i]
            orders.append(tuple(order))
        found = min((_assigned(order, _left(thin, arm, order)) for order in orders), key=lambda order: order.cost)
        if found.cost > best.cost - 2.0 * np.log(LEAST_FACTOR):
            break
        best = found
    moved = [j for j in own if best.positions[j] != j or best.torques[j] != j]
    if not moved or here.cost - best.cost < len(moved) * np.log(LEAST_FACTOR):
        return []
    if min(1.0 - best.left[j] for j in moved) < LEAST_EXPLAINED:
        return []
    return [_tell(session, here, best, moved)]


STATE_NAMES = ("q", "dq", "ddq", "tau", "gravity", "inertial")


def _assigned(positions: tuple[int, ...], table: Float[Array, "n n"]) -> Order:
    _, torques = linear_sum_assignment(np.log(table))
    return Order(positions, tuple(int(t) for t in torques), table[np.arange(len(table)), torques])


def _left(states: States, arm: ArmModel, positions: tuple[int, ...]) -> Float[Array, "n n"]:
    """Share of each recorded torque (column) that each joint's model (row) leaves, of whichever sign."""
    order = list(positions)
    q, dq, ddq = (values[:, order] for values in (states.q, states.dq, states.ddq))
    if order != sorted(order):
        gravity = arm.gravity(q)
        states = replace(
            states, q=q, dq=dq, ddq=ddq, gravity=gravity, inertial=arm.inverse_dynamics(q, dq, ddq) - gravity
        )
    tau = states.tau - states.tau.mean(axis=0)
    found = np.ones((arm.n, arm.n))
    for j in range(arm.n):
        terms = joint_terms(states, j)
        terms = terms - terms.mean(axis=0)
        size = np.linalg.norm(terms, axis=0)
        terms = terms / np.where(size > 1e-6 * max(float(size.max()), 1e-12), size, np.inf)
        triangle = np.asarray(np.linalg.qr(np.column_stack([terms, tau]), mode="r"))
        for k in np.flatnonzero(states.alive):
            target = triangle[:, 4 + k]
            left = min(nnls(triangle[:, :4], sign * target)[1] for sign in (1.0, -1.0))
            found[j, k] = (left / max(float(np.linalg.norm(target)), 1e-300)) ** 2
    return np.asarray(np.clip(found, FLOOR, 1.0))


def _tell(session: Session, here: Order, best: Order, moved: list[int]) -> TelemetryIssue:
    names = session.joints
    parts = [
        ", ".join(f"{what} of {names[j]} stands under {names[order[j]]}" for j in moved if order[j] != j)
        for what, order in (("the effort", best.torques), ("the position", best.positions))
    ]
    worst = max(moved, key=lambda j: here.left[j] / best.left[j])
    evidence = (
        f"{session.name}: {'; '.join(part for part in parts if part)}: the model then explains "
        f"{1.0 - best.left[worst]:.0%} of the effort of {names[worst]}, {1.0 - here.left[worst]:.0%} as the file has it"
    )
    remedy = "give the columns their joints' names, in the file or in [columns] of session.toml"
    return TelemetryIssue("columns_swapped", joints_at(session, moved), "fatal", evidence, remedy)
