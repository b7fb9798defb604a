"""Which way gravity pulls on the base: arms hang from ceilings and walls, URDFs stand on floors.

Each joint's torque is linear in gravity's vector c (base frame),

    tau_j = s_j G_j(q) c + a_j (rnea - g) + b_j tanh(dq / eps) + d_j dq + o_j,

with a scale s_j of its own, near one, for masses and gains that are off. The likeliest direction of
c is sought, under normal residuals with a variance for each joint: the least sum of the logarithms
of what is left.

Whether the URDF's bodies lie where its links are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from ident.arrays import Array, Bool, Float
from ident.checks.effort import TRANSITION_RAD_S, States, fit_signed
from ident.checks.report import issue_of
from ident.checks.settings import ARRANGEMENT as LIMIT
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

GRAVITY = 9.81
ANY_SCALE = (-np.inf, np.inf)  # of a current, whose gain and sign are not known
EITHER_SIGN = (1.0, -1.0)
# Fewest states in which a joint moves that tell how gravity pulls on it.
FEWEST_STATES = 20
# What one joint's torque tells of gravity's direction u, each per variance of the torque: inner
# products of the torque with what each axis of gravity would ask for, b, shape (3,), and of these
# with each other, W, shape (3, 3).
Pull = tuple[Float[Array, " 3"], Float[Array, "3 3"]]


def left_of(
    pull: Pull,
    directions: Float[Array, "k 3"],
    scales: tuple[float, float] = LIMIT.scales,
) -> Float[Array, " k"]:
    """Share of the torque's variance that each direction leaves: 1 - 2 s b·u + s² u·W·u.

    Gravity that is tilted out of a planar arm's plane only scales its torque: of directions that
    leave the same the one at which gravity has its own size leaves least. Of currents of unknown
    gain every size is alike.

    Args:
        pull: What the torque tells.
        directions: Unit vectors u in the base frame.
        scales: Least and largest scale s of the torque.

    Returns:
        A share for each direction, never zero, and raised where the scale is far from one.
    """
    products, squares = pull
    along = directions @ products
    square = np.einsum("ki,ij,kj->k", directions, squares, directions)
    square = np.maximum(square, 1e-12)
    scale = np.clip(along / square, *scales)
    share = 1.0 - 2.0 * scale * along + scale**2 * square
    left = np.maximum(share, 0.0) + LIMIT.floor
    if scales == ANY_SCALE:
        return np.asarray(left)
    return np.asarray(left * np.exp(LIMIT.own_size * np.log(scale) ** 2))


def hang_by_current(states: States, arm: ArmModel) -> States:
    """The states under the gravity that currents surely follow, where it is not the URDF's.

    A mount is found before the gains, for a gain is gravity over what the column shows of it.

    Args:
        states: Of currents whose gains are not known.
        arm: As its URDF has it.

    Returns:
        The same object where the URDF's gravity stands.
    """
    pulls = pulls_of(states, arm)
    if not pulls:
        return states
    stated = arm.model.gravity.linear
    direction = find_direction(list(pulls.values()), ANY_SCALE)
    least_cosine = np.cos(np.radians(LIMIT.least_turn_deg))
    if abs(float(direction @ stated)) >= least_cosine * float(np.linalg.norm(stated)):
        return states
    explained = _explained(states, pulls)
    turned = []
    gains = []
    for downwards in (direction, -direction):
        gravity = arm.with_gravity(GRAVITY * downwards).gravity(states.q)
        under = replace(states, gravity=gravity)
        turned.append(under)
        gains.append(sum(_gains(explained, _explained(under, pulls)).values()))
    if max(gains) <= np.log(LIMIT.least_gain):
        return states
    return turned[int(np.argmax(gains))]


def _explained(
    states: States, joints: Iterable[int], signs: Sequence[float] = EITHER_SIGN
) -> dict[int, float]:
    """Share of each joint's torque that its motion explains, of the best of some signs."""
    shares = {}
    for joint in joints:
        shares[joint] = max(fit_signed(states, joint, sign).explained for sign in signs)
    return shares


def _gains(before: Mapping[int, float], after: Mapping[int, float]) -> dict[int, float]:
    """Logarithm of how many times less is left of each torque, by the shares explained."""
    gains = {}
    for joint, share in before.items():
        left_before = 1.0 - share + LIMIT.floor
        left_after = 1.0 - after[joint] + LIMIT.floor
        gains[joint] = float(np.log(left_before / left_after))
    return gains


def _spread_over_sphere() -> Float[Array, "k 3"]:
    """Unit vectors all over the sphere, on a spiral: as many as the settings say."""
    k = np.arange(LIMIT.directions) + 0.5
    polar = np.arccos(1.0 - 2.0 * k / LIMIT.directions)
    around = np.pi * (1.0 + np.sqrt(5.0)) * k
    x = np.cos(around) * np.sin(polar)
    y = np.sin(around) * np.sin(polar)
    return np.column_stack([x, y, np.cos(polar)])


def find_direction(
    pulls: list[Pull], scales: tuple[float, float] = LIMIT.scales
) -> Float[Array, " 3"]:
    """The unit vector along which gravity most likely pulls, in the base frame.

    The best of a sphere's, followed to where it is best.

    Args:
        pulls: What each joint's torque tells.
        scales: Least and largest scale of a torque.
    """

    def cost(along: Float[Array, "k 3"]) -> Float[Array, " k"]:
        unit = along / np.linalg.norm(along, axis=1)[:, None]
        return np.sum([np.log(left_of(pull, unit, scales)) for pull in pulls], axis=0)

    def cost_of(along: Float[Array, " 3"]) -> float:
        return float(cost(along[None])[0])

    places = _spread_over_sphere()
    start = places[int(np.argmin(cost(places)))]
    best = minimize(cost_of, start, method="Nelder-Mead", options={"xatol": 1e-5}).x
    return np.asarray(best / np.linalg.norm(best))


def _without(beside: Float[Array, "T k"], values: Float[Array, "T m"]) -> Float[Array, "T m"]:
    """What orthonormal columns leave of some values."""
    return values - beside @ (beside.T @ values)


def pulls_of(states: States, arm: ArmModel) -> dict[int, Pull]:
    """What each moving joint whose torque feels gravity says of gravity's direction.

    Returns:
        By index of the joint, sums b (3,) and W (3, 3) as `left_of` takes them, both over the
        torque's variance; joints with too few states are left out.
    """
    rows = slice(None, None, max(1, len(states.q) // LIMIT.states))
    q = states.q[rows]
    dq = states.dq[rows]
    tau = states.tau[rows]
    by_axis = [arm.with_gravity(GRAVITY * axis).gravity(q) for axis in np.eye(3)]
    axes = np.stack(by_axis, axis=-1)
    change = axes.std(axis=0).max(axis=1)
    settings = states.settings
    least = max(settings.heavy_Nm, settings.heavy_share * float(change.max()))
    pulls = {}
    for j in np.flatnonzero((change > least) & states.alive & states.moving):
        # While a joint stands still its friction holds it, too: its pull says little of gravity.
        moves = np.flatnonzero(np.abs(dq[:, j]) > settings.moving_rad_s)
        speed = dq[moves, j]
        # The rotor's inertia is no part of the model's.
        of_arm = states.inertial[rows, j]
        of_rotor = states.ddq[rows, j]
        inertia = [of_arm[moves], of_rotor[moves]]
        friction = [np.tanh(speed / TRANSITION_RAD_S), speed, np.ones(len(moves))]
        beside, _ = np.linalg.qr(np.column_stack([*inertia, *friction]))
        target = _without(beside, tau[moves, j])
        table = _without(beside, axes[moves, j])
        variance = float(target @ target)
        if len(moves) > FEWEST_STATES and variance > 0.0:
            score = table.T @ target / variance
            information = table.T @ table / variance
            pulls[int(j)] = (score, information)
    return pulls


def check_bodies(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Whether centres of mass lie near the joints of their links.

    One that lies far out may be a tool; several are misplaced.

    Returns:
        One issue, or none.
    """
    masses, centres, inertias = arm.chain[-3:]
    # The next joint, in the link's frame.
    after = np.vstack([arm.chain.offsets[1:], np.zeros((1, 3))])
    distance = np.linalg.norm([centres, centres - after], axis=2).min(axis=0)
    trace = np.maximum(np.trace(inertias, axis1=1, axis2=2), 1e-12)
    size = np.sqrt(trace / np.maximum(2.0 * masses, 1e-9))
    reach = np.linalg.norm(after, axis=1)
    off = distance > np.maximum(LIMIT.far * size, reach)
    if off.sum() <= 1:
        return []
    issue = issue_of(
        "misplaced",
        session,
        _named(arm.joint_names, off),
        links=", ".join(_named(arm.links, off)),
        distance=distance.max(),
        times=(distance / size)[off].min(initial=np.inf),
    )
    return [issue]


def _named(names: Sequence[str], marked: Bool[Array, " n"]) -> list[str]:
    """Those of some names that are marked."""
    return [name for name, is_marked in zip(names, marked, strict=True) if is_marked]
