"""What no motion between start and goal can undercut, whatever its path and time law.

So a plan tells its gap. Limits of position and obstacles are left out, which can only lower it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull

from ident.arrays import Array, Float
from ident.laws.carried import JointStates
from plan.dynamics.compiled_nets import CompiledJointNets
from plan.dynamics.power import ChainTorque, differentiate_torque, without_friction
from plan.problem.problem import PlanningProblem

# Positions from which the extremes of inertia and gravity are taken.
POSITIONS = 2000
# What is granted for the positions in between, as a factor.
GRANTED = 1.05
# Speeds at which a net's power is looked at.
SPEEDS = 161
# Accelerations and loads at which it is looked at, each.
OTHERS = 9
# Angles of a period at which a named law is looked at.
ANGLES = 24
# Nodes of the quadrature of the weight that is lifted.
NODES = 40
# |v| - SLIP w lies below v tanh(v / w) for every v, and is convex, which that is not.
SLIP = 0.2785
# Without a limit, a joint is at its top speed after a tenth of a second at the earliest [1/s].
TO_TOP = 10.0


def least_time(problem: PlanningProblem) -> float:
    """Longest of what each joint's way takes at its limits, and at what torque allows [s].

    Let w = √(dqᵀ M dq). Coriolis torques do no work, so |dw/dt| ≤ ‖M^(−1/2) u‖ with u what torque,
    gravity and friction can push, and |dq_j| ≤ w √(M⁻¹)_jj. With the largest values over the
    joints' range, which are taken from random positions and granted a twentieth, each joint's speed
    lies below a trapezium whose area is its way.
    """
    limits = problem.limits
    losses = problem.model.losses
    gravity, inverse = _extremes(problem)
    drag = np.abs(losses.coulomb) + np.abs(losses.offset) + losses.viscous * limits.speed
    push = limits.torque + gravity + np.abs(losses.offset)
    if not _has_bounded_net(problem.model):
        push = np.full(problem.n, np.inf)
    residual = np.zeros(problem.n)
    for j, top in enumerate(limits.speed):
        residual[j] = _residual_range(problem, j, np.linspace(-top, top, SPEEDS))[0]
    push = push + residual
    drag = drag + residual
    reach = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2).max(axis=0)) * GRANTED
    rises = reach * _largest_rate(inverse, push)
    falls = reach * _largest_rate(inverse, push + drag)
    if limits.acceleration is not None:
        rises = np.minimum(rises, limits.acceleration)
        falls = np.minimum(falls, limits.acceleration)
    way = np.abs(problem.goal - problem.start)
    longest = 0.0
    for joint in np.flatnonzero(way > 0.0):
        needs = _trapezium_time(way[joint], limits.speed[joint], rises[joint], falls[joint])
        longest = max(longest, needs)
    return longest


def _extremes(problem: PlanningProblem) -> tuple[Float[Array, " n"], Float[Array, "p n n"]]:
    """Largest torque of gravity [N m], and inverses of the inertia at random positions."""
    limits = problem.limits
    rng = np.random.default_rng(0)  # fixed: the bound is a property of the task
    low = np.maximum(limits.lower, -np.pi)
    high = np.minimum(limits.upper, np.pi)
    q = rng.uniform(low, high, (POSITIONS, problem.n))
    still = np.zeros_like(q)
    gravity, slopes = differentiate_torque(without_friction(problem.model), q, still, still)
    return np.abs(gravity).max(axis=0), np.linalg.inv(slopes[2])


def _has_bounded_net(model: ChainTorque) -> bool:
    """Whether the model has no net, or one of the default kind, whose range is known."""
    return model.net is None or isinstance(model.net, CompiledJointNets)


def _largest_rate(inverse: Float[Array, "p n n"], push: Float[Array, " n"]) -> float:
    """Largest |dw/dt| of a push, whatever the signs of its joints' torques."""
    squares = np.einsum("tij,i,j->t", np.abs(inverse), push, push)
    return float(np.sqrt(squares.max()) * GRANTED)


def _trapezium_time(way: float, top: float, rise: float, fall: float) -> float:
    """Shortest time of a way at a top speed and accelerations of getting going and braking [s]."""
    ramp = 0.5 * (1.0 / rise + 1.0 / fall)
    speed = top
    if ramp > 0.0:
        speed = min(top, float(np.sqrt(way / ramp)))
    return float(way / speed + speed * ramp)


def least_energy(problem: PlanningProblem) -> float | None:
    """The weight lifted, and the least that friction and net take in the time given [J].

    Rigid body and rotors give back what they took between rest and rest, so the signed energy is
    the lift and ∫ P(dq) dt with P the least loss at each speed; by convexity no course takes less
    than the steady speed on P's convex hull. Braking credited makes the signed energy the least of
    all metrics in joules.

    Returns:
        None where nothing is known: of copper's losses, and of a net of another kind.
    """
    if problem.metric == "copper" or not _has_bounded_net(problem.model):
        return None
    total = float(problem.durations.sum())
    steady = (problem.goal - problem.start) / total
    bound = _lift(problem)
    for j, speed in enumerate(steady):
        bound += total * _least_power(problem, j, float(speed))
    return bound if problem.metric == "signed" else max(bound, 0.0)


def _lift(problem: PlanningProblem) -> float:
    """Work against gravity from start to goal, by quadrature along the straight line [J]."""
    share, weight = np.polynomial.legendre.leggauss(NODES)
    way = problem.goal - problem.start
    q = problem.start + (share[:, None] + 1.0) / 2.0 * way
    still = np.zeros_like(q)
    gravity = without_friction(problem.model).torque(q[None], still[None], still[None])[0]
    return float(weight @ (gravity @ way)) / 2.0


def _least_power(problem: PlanningProblem, j: int, speed: float) -> float:
    """What a joint's losses take at a steady speed, on the lower hull of power over speed [W]."""
    losses = problem.model.losses
    even = np.linspace(-1.0, 1.0, SPEEDS) * problem.limits.speed[j]
    speeds = np.unique(np.append(even, speed))
    slip = np.maximum(np.abs(speeds) - SLIP * losses.transition_speed[j], 0.0)
    power = losses.viscous[j] * speeds**2
    power = power + losses.coulomb[j] * slip
    power = power + losses.offset[j] * speeds
    power += _residual_range(problem, j, speeds)[1]
    above = power.max() + 1.0
    lid = np.array([[speeds[0], above], [speeds[-1], above]])
    corners = ConvexHull(np.concatenate([np.column_stack([speeds, power]), lid])).vertices
    lower = np.sort(corners[corners < len(speeds)])
    return float(np.interp(speed, speeds[lower], power[lower]))


def _residual_range(
    problem: PlanningProblem, j: int, speeds: Float[Array, " v"]
) -> tuple[float, Float[Array, " v"]]:
    """Largest torque of a joint's net and named laws, and the least power they take at each speed.

    Whatever acceleration, load and angle are.
    """
    largest = 0.0
    least = np.zeros(len(speeds))
    for speed, torque in _residual_cases(problem, j, speeds):
        power = (torque * speed).reshape(len(speeds), -1)
        largest += float(np.abs(torque).max())
        least = least + power.min(axis=1)
    return largest, least


def _residual_cases(
    problem: PlanningProblem, j: int, speeds: Float[Array, " v"]
) -> Iterator[tuple[Float[Array, " m"], Float[Array, " m"]]]:
    """Speeds and torques of a joint's net, then of each of its named laws, in all their cases."""
    limits = problem.limits
    model = problem.model
    loads = np.linspace(-1.0, 1.0, OTHERS) * limits.torque[j]
    if isinstance(model.net, CompiledJointNets):
        most = TO_TOP * limits.speed[j]
        if limits.acceleration is not None:
            most = limits.acceleration[j]
        speed, acceleration, load = _grid(speeds, np.linspace(-most, most, OTHERS), loads)
        yield speed, model.net.joint_slopes(j, speed, acceleration, load)[0]
    width = float(model.losses.transition_speed[j])
    for law in model.named:
        if law.joint != j:
            continue
        angles = np.zeros(1)
        if "order" in law.shape:
            angles = np.linspace(0.0, 2.0 * np.pi / law.shape["order"], ANGLES + 1)[:-1]
        speed, angle, load = _grid(speeds, angles, loads)
        slip = np.tanh(speed / width) if width > 0.0 else np.sign(speed)
        yield speed, law.torque(JointStates(angle, speed, load, slip))


def _grid(*axes: Float[Array, " k"]) -> list[Float[Array, " m"]]:
    """All combinations of some values, the first changing slowest."""
    return [values.reshape(-1) for values in np.meshgrid(*axes, indexing="ij")]
