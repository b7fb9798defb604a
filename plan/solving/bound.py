"""What no motion between start and goal can undercut, whatever its path and time law, so that a plan tells its gap.

Limits of position and obstacles are left out, which can only lower it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from ident.arrays import Array, Float
from ident.laws.carried import JointStates
from plan.dynamics.compiled_nets import CompiledJointNets
from plan.dynamics.power import differentiate_torque, without_friction
from plan.problem.problem import PlanningProblem

# Positions from which the extremes of inertia and gravity are taken, and what is granted for those in between.
POSITIONS, GRANTED = 2000, 1.05
# Speeds, accelerations and loads at which a net's power is looked at.
SPEEDS, OTHERS = 161, 9


def least_time(problem: PlanningProblem) -> float:
    """Longest of what each joint's way takes at its limits of speed and acceleration, and at what torque allows [s].

    Let w = √(dqᵀ M dq). Coriolis torques do no work, so |dw/dt| ≤ ‖M^(−1/2) u‖ with u what torque, gravity and friction
    can push, and |dq_j| ≤ w √(M⁻¹)_jj. With the largest values over the joints' range, which are taken from random
    positions and granted a twentieth, each joint's speed lies below a trapezium whose area is its way.
    """
    limits, model = problem.limits, problem.model
    rng = np.random.default_rng(0)  # fixed: the bound is a property of the task
    low, high = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    q = rng.uniform(low, high, (POSITIONS, problem.n))
    still = np.zeros_like(q)
    gravity, (_, _, inertia) = differentiate_torque(without_friction(model), q, still, still)
    inverse = np.linalg.inv(inertia)
    losses = model.losses
    drag = np.abs(losses.coulomb) + np.abs(losses.offset) + losses.viscous * limits.speed
    push = limits.torque + np.abs(gravity).max(axis=0) + np.abs(losses.offset)
    if not (model.net is None or isinstance(model.net, CompiledJointNets)):
        push = np.full(problem.n, np.inf)
    grids = [np.linspace(-top, top, SPEEDS) for top in limits.speed]
    residual = np.array([_residual_range(problem, j, grid)[0] for j, grid in enumerate(grids)])
    push, drag = push + residual, drag + residual
    reach = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2).max(axis=0)) * GRANTED
    rates = [np.sqrt(np.einsum("tij,i,j->t", np.abs(inverse), u, u).max()) * GRANTED for u in (push, push + drag)]
    way, times = np.abs(problem.goal - problem.start), [0.0]
    for j in np.flatnonzero(way > 0.0):
        rise, fall = (reach[j] * rate for rate in rates)
        if limits.acceleration is not None:
            rise, fall = min(rise, limits.acceleration[j]), min(fall, limits.acceleration[j])
        ramp = 0.5 * (1.0 / rise + 1.0 / fall)
        speed = min(float(limits.speed[j]), np.sqrt(way[j] / ramp) if ramp > 0 else np.inf)
        times.append(float(way[j] / speed + speed * ramp))
    return max(times)


def least_energy(problem: PlanningProblem) -> float | None:
    """The weight lifted, and the least that friction and net take for each joint's way in the time given [J].

    Rigid body and rotors give back what they took between rest and rest, so the signed energy is the lift and ∫ P(dq)
    dt with P the least loss at each speed; by convexity no course takes less than the steady speed on P's convex hull.
    Braking credited makes the signed energy the least of all metrics in joules.

    Returns:
        None where nothing is known: of copper's losses, and of a net of another kind than the default.
    """
    model = problem.model
    if problem.metric == "copper" or not (model.net is None or isinstance(model.net, CompiledJointNets)):
        return None
    total = float(problem.durations.sum())
    share, weight = np.polynomial.legendre.leggauss(40)
    way = problem.goal - problem.start
    q = problem.start + (share[:, None] + 1.0) / 2.0 * way
    still = np.zeros_like(q)
    lift = float(weight @ (without_friction(model).torque(q[None], still[None], still[None])[0] @ way)) / 2.0
    bound, losses = lift, model.losses
    for j, speed in enumerate(way / total):
        speeds = np.unique(np.append(np.linspace(-1.0, 1.0, SPEEDS) * problem.limits.speed[j], speed))
        # |v| - 0.28 w lies below v tanh(v / w) for every v, and is convex, which that is not.
        slip = np.maximum(np.abs(speeds) - 0.2785 * losses.transition_speed[j], 0.0)
        power = losses.viscous[j] * speeds**2 + losses.coulomb[j] * slip + losses.offset[j] * speeds
        power += _residual_range(problem, j, speeds)[1]
        # At the steady speed, on the lower convex hull of power over speed.
        lid = np.array([[speeds[0], power.max() + 1.0], [speeds[-1], power.max() + 1.0]])
        corners = ConvexHull(np.concatenate([np.column_stack([speeds, power]), lid])).vertices
        kept = np.sort(corners[corners < len(speeds)])
        bound += total * float(np.interp(speed, speeds[kept], power[kept]))
    return bound if problem.metric == "signed" else max(bound, 0.0)


def _residual_range(problem: PlanningProblem, j: int, speeds: Float[Array, " v"]) -> tuple[float, Float[Array, " v"]]:
    """Largest torque of a joint's net and named laws, and the least power that they take at each speed.

    Whatever acceleration, load and angle are.
    """
    limits, model, cases = problem.limits, problem.model, []
    width = float(model.losses.transition_speed[j])
    loads = np.linspace(-1.0, 1.0, OTHERS) * limits.torque[j]
    if isinstance(model.net, CompiledJointNets):
        most = 10.0 * limits.speed[j] if limits.acceleration is None else limits.acceleration[j]  # to top in a tenth
        v, a, load = _grid(speeds, np.linspace(-most, most, OTHERS), loads)
        cases.append((v, model.net.joint_slopes(j, v, a, load)[0]))
    for law in (law for law in model.named if law.joint == j):
        angles = np.linspace(0.0, 2.0 * np.pi / law.shape["order"], 25)[:-1] if "order" in law.shape else np.zeros(1)
        v, angle, load = _grid(speeds, angles, loads)
        slip = np.tanh(v / width) if width > 0.0 else np.sign(v)
        cases.append((v, law.torque(JointStates(angle, v, load, slip))))
    least = [(torque * v).reshape(len(speeds), -1).min(axis=1) for v, torque in cases]
    return sum(float(np.abs(torque).max()) for _, torque in cases), np.sum([np.zeros(len(speeds)), *least], axis=0)


def _grid(*axes: Float[Array, " k"]) -> list[Float[Array, " m"]]:
    """All combinations of some values, the first changing slowest."""
    return [part.reshape(-1) for part in np.meshgrid(*axes, indexing="ij")]
