"""Which way gravity pulls on the base: arms hang from ceilings and walls, and URDFs stand on floors.

Each joint's torque is linear in gravity's vector c (base frame),

    tau_j = s_j G_j(q) c + a_j (rnea - g) + b_j tanh(dq / eps) + d_j dq + o_j,

with a scale s_j of its own, near one, for masses and gains that are off. The likeliest direction of c is sought, under
normal residuals with a variance for each joint: the least sum of the logarithms of what is left.

Whether the URDF's bodies lie where its links are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.checks.effort import TRANSITION_RAD_S, States, fit_signed
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


def hang_by_current(states: States, arm: ArmModel) -> States:
    """The states under the gravity that currents of unknown gains follow, where they surely don't follow the URDF's.

    A mount is found before the gains, for a gain is gravity over what the column shows of it.
    """
    pulls = pulls_of(states, arm)
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

    from scipy.optimize import minimize  # slow to load, and hardly ever needed

    start = places[int(np.argmin(cost(places)))]
    best = minimize(lambda along: float(cost(along[None])[0]), start, method="Nelder-Mead", options={"xatol": 1e-5}).x
    return np.asarray(best / np.linalg.norm(best))


def pulls_of(states: States, arm: ArmModel) -> dict[int, Pull]:
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
