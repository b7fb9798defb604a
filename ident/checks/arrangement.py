"""Which way gravity pulls on the base: arms hang from ceilings and walls, and URDFs stand on floors.

Each joint's torque is linear in gravity's vector c (base frame),

    tau_j = s_j G_j(q) c + a_j (rnea - g) + b_j tanh(dq / eps) + d_j dq + o_j,

with a scale s_j of its own, near one, for masses and gains that are off. The likeliest direction of c is sought, under
normal residuals with a variance for each joint: the least sum of the logarithms of what is left.

Columns that stand under another joint's name: which torque, and which position, follows which joint's model.

A joint's torque is made of its own gravity, inertia and friction. Under a permutation of the positions the model gives
each joint what its torque would be made of, and a table of how much of each recorded torque that explains; the best
assignment of torques to joints (Kuhn-Munkres) is compared with the one of the file, by logarithms of residuals.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize, nnls

from ident.arrays import Array, Float
from ident.checks.effort import TRANSITION_RAD_S, States, collect_states, fit_signed, joint_terms
from ident.checks.filtered_run import ARRANGEMENT as LIMIT
from ident.checks.report import issue_of
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

GRAVITY = 9.81
ANY_SCALE = (-np.inf, np.inf)  # of a current, whose gain and sign are not known
EITHER_SIGN = (1.0, -1.0)
# What one joint's torque tells of gravity's direction u, each per variance of the torque: inner products of the torque
# with what each axis of gravity would ask for, b, shape (3,), and of these with each other, W, shape (3, 3).
Pull = tuple[Float[Array, " 3"], Float[Array, "3 3"]]


def left_of(
    pull: Pull, directions: Float[Array, "k 3"], scales: tuple[float, float] = LIMIT.scales
) -> Float[Array, " k"]:
    """Share of the torque's variance that each direction leaves: 1 - 2 s b·u + s² u·W·u, s within `scales`.

    Gravity that is tilted out of a planar arm's plane only scales its torque: of directions that leave the same the one
    at which gravity has its own size leaves least. Of currents of unknown gain every size is alike.
    """
    along = directions @ pull[0]
    square = np.maximum(np.einsum("ki,ij,kj->k", directions, pull[1], directions), 1e-12)
    scale = np.clip(along / square, *scales)
    left = np.maximum(1.0 - 2.0 * scale * along + scale**2 * square, 0.0) + LIMIT.floor
    return np.asarray(left if scales == ANY_SCALE else left * np.exp(LIMIT.own_size * np.log(scale) ** 2))


def mend_mount(session: Session, arm: ArmModel) -> tuple[ArmModel, list[TelemetryIssue]]:
    """The arm as it is mounted: under the gravity that its torque follows, where that is surely not the URDF's.

    What the session states stands; that the torque follows another gravity is a warning then.
    """
    states = collect_states(session, arm) if session.effort_kind != "gravity_compensated" else None
    pulls = {} if states is None else _pulls(states, arm)
    if states is None or not pulls:
        return arm, []
    now = arm.model.gravity.linear / max(float(np.linalg.norm(arm.model.gravity.linear)), 1e-12)
    best = find_direction(list(pulls.values()))
    angle = float(np.degrees(np.arccos(np.clip(best @ now, -1.0, 1.0))))
    turned = arm.with_gravity(GRAVITY * best)
    there = replace(states, gravity=turned.gravity(states.q))
    # A torque of the wrong sign follows gravity upside down, and inertia and friction too: that is no mount.
    as_it_is, explained = _explained(states, pulls, EITHER_SIGN), _explained(there, pulls, (1.0,))
    gains = _gains(as_it_is, explained)
    most = max(gains, key=lambda j: gains[j])
    unsure = sum(gains.values()) < np.log(LIMIT.least_gain) or explained[most] < LIMIT.least_explained
    if unsure or (angle < LIMIT.least_turn_deg and (_is_misread(there) or not _is_misread(states))):
        return arm, []
    share = f"{explained[most]:.0%} of the effort of {session.joints[most]}, not {max(as_it_is[most], 0.0):.0%}"
    axis = np.cross(best, now)
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-6 else np.eye(3)[0]
    named = [name for name, one in zip(("x", "y", "z", "-x", "-y", "-z"), (*axis, *-axis), strict=True) if one > 0.99]
    words = named[0] if named else f"({', '.join(f'{one:.2f}' for one in axis)})"
    line = f"gravity_mps2 = [{', '.join(f'{GRAVITY * one:.2f}' for one in best)}]"
    stated = session.gravity is not None
    kind = "mounted_otherwise" if stated else "mounted"
    return arm if stated else turned, [issue_of(kind, session, turn=angle, axis=words, share=share, line=line)]


def hang_by_current(states: States, arm: ArmModel) -> States:
    """The states under the gravity that currents of unknown gains follow, where they surely don't follow the URDF's.

    A mount is found before the gains, for a gain is gravity over what the column shows of it.
    """
    pulls = _pulls(states, arm)
    if not pulls:
        return states

    now, best = arm.model.gravity.linear, find_direction(list(pulls.values()), ANY_SCALE)
    if abs(float(best @ now)) >= np.cos(np.radians(LIMIT.least_turn_deg)) * float(np.linalg.norm(now)):
        return states
    turned = [replace(states, gravity=arm.with_gravity(GRAVITY * one).gravity(states.q)) for one in (best, -best)]
    as_it_is = _explained(states, pulls, EITHER_SIGN)
    gains = [sum(_gains(as_it_is, _explained(there, pulls, EITHER_SIGN)).values()) for there in turned]
    return turned[int(np.argmax(gains))] if max(gains) > np.log(LIMIT.least_gain) else states


def _explained(states: States, joints: Iterable[int], signs: Sequence[float]) -> dict[int, float]:
    """Share of each joint's torque that gravity, inertia and friction explain, of the best of some signs."""
    return {j: max(fit_signed(states, j, sign).explained for sign in signs) for j in joints}


def _gains(before: Mapping[int, float], after: Mapping[int, float]) -> dict[int, float]:
    """Logarithm of how many times less is left of each joint's torque, by the shares explained."""
    return {j: float(np.log((1.0 - one + LIMIT.floor) / (1.0 - after[j] + LIMIT.floor))) for j, one in before.items()}


def find_direction(pulls: list[Pull], scales: tuple[float, float] = LIMIT.scales) -> Float[Array, " 3"]:
    """The unit vector along which gravity most likely pulls: the best of a sphere's, followed to where it is best."""
    k = np.arange(LIMIT.directions) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * k / LIMIT.directions), np.pi * (1.0 + np.sqrt(5.0)) * k
    places = np.column_stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)])

    def cost(along: Float[Array, "k 3"]) -> Float[Array, " k"]:
        unit = along / np.linalg.norm(along, axis=1)[:, None]
        return np.sum([np.log(left_of(pull, unit, scales)) for pull in pulls], axis=0)

    start = places[int(np.argmin(cost(places)))]
    best = minimize(lambda along: float(cost(along[None])[0]), start, method="Nelder-Mead", options={"xatol": 1e-5}).x
    return np.asarray(best / np.linalg.norm(best))


def _is_misread(states: States) -> bool:
    """Whether a joint that carries much follows gravity at no size of a torque: it would be refused."""
    joints = map(int, np.flatnonzero(states.heavy & states.alive & states.moving))
    sizes = [max(fit_signed(states, j, sign) for sign in (1.0, -1.0)).gravity for j in joints]
    return any(not states.settings.scale_low < size < states.settings.scale_high for size in sizes)


def _pulls(states: States, arm: ArmModel) -> dict[int, Pull]:
    """What each moving joint says that feels some gravity, in whichever direction."""
    rows = slice(None, None, max(1, len(states.q) // LIMIT.states))
    q, dq, tau = states.q[rows], states.dq[rows], states.tau[rows]
    axes = np.stack([arm.with_gravity(GRAVITY * axis).gravity(q) for axis in np.eye(3)], axis=-1)
    change = axes.std(axis=0).max(axis=1)
    least = max(states.settings.heavy_Nm, states.settings.heavy_share * float(change.max()))
    found = {}
    for j in np.flatnonzero((change > least) & states.alive & states.moving):
        # While a joint stands still its friction holds it, too: how it pulls there says little of gravity.
        moves = np.flatnonzero(np.abs(dq[:, j]) > states.settings.moving_rad_s)
        friction = [np.tanh(dq[moves, j] / TRANSITION_RAD_S), dq[moves, j], np.ones(len(moves))]
        inertia = [states.inertial[rows, j][moves], states.ddq[rows, j][moves]]  # the rotor's is no part of the model's
        beside, _ = np.linalg.qr(np.column_stack([*inertia, *friction]))
        target, table = (one - beside @ (beside.T @ one) for one in (tau[moves, j], axes[moves, j]))
        variance = float(target @ target)
        if len(moves) > 20 and variance > 0.0:
            found[int(j)] = table.T @ target / variance, table.T @ table / variance
    return found


class Order(NamedTuple):
    """One order of the columns."""

    cost: float  # sum of the logarithms of the residuals
    positions: tuple[int, ...]  # column of the file that is each joint's position
    torques: tuple[int, ...]  # column of the file that is each joint's torque
    left: Float[Array, " n"]  # share of each joint's torque that the model leaves in this order


def check_bodies(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Whether centres of mass lie near joints of their links: one far out may be a tool, several are misplaced."""
    masses, centres, inertias = arm.chain[-3:]
    after = np.vstack([arm.chain.offsets[1:], np.zeros((1, 3))])  # the next joint, in the link's frame
    distance = np.linalg.norm([centres, centres - after], axis=2).min(axis=0)
    size = np.sqrt(np.maximum(np.trace(inertias, axis1=1, axis2=2), 1e-12) / np.maximum(2.0 * masses, 1e-9))
    off = distance > np.maximum(LIMIT.far * size, np.linalg.norm(after, axis=1))
    joints, links = (np.array(names)[off].tolist() for names in (arm.joint_names, arm.links))
    seen = {"links": ", ".join(links), "distance": distance.max(), "times": (distance / size)[off].min(initial=np.inf)}
    return [issue_of("misplaced", session, joints, **seen)] if off.sum() > 1 else []


def check_order(session: Session, arm: ArmModel, states: States) -> list[TelemetryIssue]:
    """Whether another order of the columns explains the torque far better than the file's."""
    n = arm.n
    if n < 2 or not states.alive.any():
        return []
    step = slice(None, None, max(1, len(states.q) // LIMIT.order_states))
    thin = replace(states, **{name: getattr(states, name)[step] for name in STATE_NAMES})
    own = tuple(range(n))
    table = _left(thin, arm, own)
    here, best = Order(float(np.log(np.diag(table)).sum()), own, own, np.diag(table)), _assigned(own, table)
    # Where every torque follows its own joint, positions stand where they belong.
    for _ in range(n - 1 if here.left[states.alive].max() > LIMIT.well else 0):
        orders = []
        for i, j in combinations(range(n), 2):
            order = list(best.positions)
            order[i], order[j] = order[j], order[i]
            orders.append(tuple(order))
        found = min((_assigned(order, _left(thin, arm, order)) for order in orders), key=lambda order: order.cost)
        if found.cost > best.cost - 2.0 * np.log(LIMIT.least_factor):
            break
        best = found
    moved = [j for j in own if best.positions[j] != j or best.torques[j] != j]
    if not moved or here.cost - best.cost < len(moved) * np.log(LIMIT.least_factor):
        return []
    if min(1.0 - best.left[j] for j in moved) < LIMIT.order_explains:
        return []
    parts = [
        ", ".join(
            f"{what} of {session.joints[j]} stands under {session.joints[order[j]]}" for j in moved if order[j] != j
        )
        for what, order in (("the effort", best.torques), ("the position", best.positions))
    ]
    worst = max(moved, key=lambda j: here.left[j] / best.left[j])
    reported = "; ".join(filter(None, parts))
    return [issue_of("swapped", session, moved, worst, best=1.0 - best.left, here=1.0 - here.left, parts=reported)]


STATE_NAMES = ("q", "dq", "ddq", "tau", "gravity", "inertial")


def _assigned(positions: tuple[int, ...], table: Float[Array, "n n"]) -> Order:
    rows, torques = linear_sum_assignment(np.log(table))
    left = table[rows, torques]
    return Order(float(np.log(left).sum()), positions, tuple(int(t) for t in torques), left)


def _left(states: States, arm: ArmModel, positions: tuple[int, ...]) -> Float[Array, "n n"]:
    """Share of each recorded torque (column) that each joint's model (row) leaves, of whichever sign."""
    order = list(positions)
    q, dq, ddq = (values[:, order] for values in (states.q, states.dq, states.ddq))
    if order != sorted(order):
        gravity = arm.gravity(q)
        inertial = arm.inverse_dynamics(q, dq, ddq) - gravity
        states = replace(states, q=q, dq=dq, ddq=ddq, gravity=gravity, inertial=inertial)
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
    return np.asarray(np.clip(found, LIMIT.order_floor, 1.0))
