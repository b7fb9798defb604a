"""The laws of effects evaluated beside the written module: by their columns, or by the arm changed as they say."""

from collections.abc import Callable
from unittest.mock import patch

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ident.arrays import Array
from ident.effects import optional
from ident.effects.base import Effect, RunContext, SessionContext, Variant
from ident.effects.catalogue import find_effect
from ident.export.identified import Change, untuned
from ident.laws import elastic
from ident.laws.acting import acting_torque, read_log
from ident.laws.motion import Losses, MovingArm
from ident.model.carried import describe_arm
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import COULOMB, VISCOUS
from tests.ident.effects.test_effect_sentences import JOINT, draw

SECONDS, LONGEST_S = 2.0, 1e-3  # of an elastic joint, over which it is integrated, and the longest step
GEAR = ("stiffness_Nm_rad", "damping_Nms_rad")
Figures = dict[str, float]


def states_of(run: RunContext, losses: Losses | None = None) -> MovingArm:
    """A run as the module sees it."""
    zero = np.zeros(run.n)
    known = losses or Losses(zero, VISCOUS, COULOMB, np.full(run.n, 0.01), zero)
    motion = run.motion
    return MovingArm(describe_arm(run.arm), known, motion.q, motion.dq, motion.ddq, run.interval, run.direction)


def predicted(effect: tuple[str, int, Figures], motion: MovingArm) -> Array:
    """Extra torque of one effect, of the log's own effects too."""
    model = motion.rigid + motion.losses.torque(motion.dq, motion.ddq, motion.direction)
    return np.asarray(read_log([effect], model + acting_torque([effect], motion), motion.interval) - model)


def bodies(run: RunContext, arm: ArmModel, q: Array | None = None) -> Array:
    """What another arm's torque is above the model's [N m]."""
    motion = run.motion
    return arm.inverse_dynamics(motion.q if q is None else q, motion.dq, motion.ddq) - run.rigid


def carried(run: RunContext, p: Figures) -> Array:
    """The arm with a point mass at the payload's centre."""
    mass, x, y, z = p["mass_kg"], *(p[f"com_{axis}_m"] for axis in "xyz")
    point = [1.0, x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
    links = np.array(run.arm.inertial_parameters)
    links[-10:] += mass * np.array(point)
    return bodies(run, run.arm.with_inertial_parameters(links))


def tilted(run: RunContext, p: Figures) -> Array:
    """The arm on a base that is turned about x and y."""
    turn = Rotation.from_rotvec([-p["tilt_x_rad"], -p["tilt_y_rad"], 0.0])
    return bodies(run, run.arm.with_gravity(turn.apply(run.arm.model.gravity.linear)))


def late(run: RunContext, p: Figures) -> Array:
    """Rigid torque later by a delay; friction that turns round within a sample is in no one's samples."""
    time = run.motion.time
    return np.asarray(CubicSpline(time, run.rigid)(np.maximum(time - p["delay_s"], time[0])) - run.rigid)


def give_way(run: RunContext, p: Figures) -> Array:
    """An elastic joint by the link's own equation of motion, over the first seconds.

    How it came into its run no recording knows: it begins as the module has it.
    """
    arm, j, rows = run.arm, JOINT, slice(round(SECONDS / run.interval))
    stiffness, damping = (p[name] for name in GEAR)
    time = run.motion.time[rows] - run.motion.time[0]
    states = CubicSpline(time, np.stack([run.motion.q[rows], run.motion.dq[rows], run.motion.ddq[rows]], axis=1))

    def link(t: float, twist: Array) -> Array:
        """Torque of all joints where the motor's motion is the log's and the link's is a twist behind."""
        q, dq, ddq = np.repeat(states(t)[:, None], len(twist), axis=1)
        q[:, j], dq[:, j], ddq[:, j] = (now[:, j] - behind for now, behind in zip((q, dq, ddq), twist.T, strict=True))
        return arm.inverse_dynamics(q, dq, ddq)

    def rate(t: float, state: Array) -> tuple[float, float]:
        free, less = link(t, np.array([[*state, 0.0], [*state, 1.0]]))[:, j]
        return state[1], float((free - stiffness * state[0] - damping * state[1]) / (free - less))

    with patch.object(elastic, "_deflect", wraps=elastic._deflect) as deflect:
        elastic.elasticity(states_of(run, untuned(run.n)[0]), JOINT, p)
    start = deflect(*deflect.call_args.args)[:2, 0]
    found = solve_ivp(rate, (0.0, time[-1]), start, "RK45", time, max_step=LONGEST_S, rtol=1e-6).y.T
    felt = [link(t, np.array([[*one, rate(t, one)[1]]]))[0] for t, one in zip(time, found, strict=True)]
    return np.array(felt) - run.rigid[rows]


EXACT: dict[str, Callable[[RunContext, Figures], Array]] = {
    "torque_gain_error": lambda run, p: p["gain"] * run.total * np.eye(run.n)[JOINT],
    "payload": carried,
    "gravity_misalignment": tilted,
    "encoder_offset": lambda run, p: bodies(run, run.arm, run.motion.q + p["offset_rad"] * np.eye(run.n)[JOINT]),
    "torque_delay": late,
    "joint_elasticity": give_way,
}


def drawn(effect: Effect, session: SessionContext, rng: np.random.Generator) -> tuple[Variant, Change, Array]:
    """A point of an effect's grid, what a diagnosis reports of it, and its law's coefficients."""
    (variant, beta), place = draw(effect, session, rng), JOINT if effect.scope == "joint" else -1
    reported = effect.parameters(session, max(place, 0), variant, beta, np.diag((0.05 * beta) ** 2))
    left = optional.without_dry_friction(effect, beta, variant)[0] if effect.open_law else beta
    law = {"coefficients": list(left), "shape": {**variant.shape, **variant.inner}}
    known = law if optional.tells_law(effect, variant) else None
    return variant, Change(effect.id, place, (), reported, known, effect), left


def in_module(session: SessionContext, change: Change, variant: Variant, beta: Array) -> tuple[Array, Array]:
    """The module's torque over the second run, and the reference's [N m]."""
    run, name, p = session.runs[1], change.effect, change.values
    motion, zero = states_of(run, untuned(run.n)[0]) if name == "torque_delay" else states_of(run), np.zeros(run.n)
    if name == "backlash":  # by the columns of its own width and teeth
        variant, beta = Variant({"gap_rad": p["gap_rad"]}, shape=variant.shape), np.array([p["gap_rad"]])
    columns = find_effect(name).columns(session, JOINT, variant)[1]
    if name == "thermal_friction":  # how its joint is when cold, and how warm it is, are given
        mean, slip = variant.shape["mean"], run.direction[:, JOINT]
        cold = Losses(zero, VISCOUS + mean * beta[0], COULOMB - mean * beta[1], zero + 0.01, zero)
        warmth = columns[:, 1] / np.where(slip == 0.0, 1.0, slip)
        motion = MovingArm(motion.arm, cold, motion.q, motion.dq, motion.ddq, motion.interval, motion.slip, warmth)
    if name == "torque_offset":  # its drift is left out, as the module says
        beta = beta * np.eye(len(beta))[0]
    found, torque = predicted((name, change.joint, p), motion), columns @ beta
    if name in EXACT:
        wanted = EXACT[name](run, p)
        return found[: len(wanted)], wanted
    return found, torque if torque.ndim == 2 else torque[:, None] * np.eye(run.n)[JOINT]
