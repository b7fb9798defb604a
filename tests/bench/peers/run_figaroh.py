"""figaroh 1.0.2 on a job: filtered differences, weighted base least squares with friction, physical fit of the effort.

Runs in a Python that has figaroh, its own Pinocchio and nothing of ours but `job.py`.
"""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
from figaroh.identification.identification_tools import calculate_first_second_order_differentiation
from figaroh.identification.parameter import get_standard_parameters
from figaroh.identification.physical_fit import FixedExtras, build_problem, solve_direct_effort_fit
from figaroh.tools.regressor import build_regressor_basic
from job import CORNER_HZ, Job, inner, least_eigenvalue, lowpass
from scipy.signal import decimate

# Rows that the fit is given a second: figaroh's own examples decimate tenfold.
ROWS_HZ = 10.0


def load(job):
    """The arm with the joints of the job, others locked."""
    whole = pin.buildModelFromUrdf(job.facts["urdf"])
    locked = [k for k in range(1, whole.njoints) if whole.names[k] not in job.joints]
    return pin.buildReducedModel(whole, locked, pin.neutral(whole))


def states(model, run, corner):
    """Filtered states and torque of a run, borders cut off."""
    time, q, tau = run
    step = time[1] - time[0]
    smooth = lowpass(q, 1.0 / step, corner)
    q, dq, ddq = calculate_first_second_order_differentiation(model, smooth, {"ts": step})
    # Its speeds and accelerations stand half a step late.
    dq, ddq = (0.5 * (part + np.vstack([part[:1], part[:-1]])) for part in (dq, ddq))
    rows = inner(1.0 / step)
    tau = lowpass(tau[: len(q)], 1.0 / step, corner)
    return time[: len(q)][rows], q[rows], dq[rows], lowpass(ddq, 1.0 / step, corner)[rows], tau[rows]


def columns(robot, run, config):
    return build_regressor_basic(robot, *run[1:4], config)


def decimated(values, run):
    """Rows and torque through one filter, a part of them kept: what figaroh's own examples do."""
    factor = max(1, round(1.0 / (run[0][1] - run[0][0]) / ROWS_HZ))
    return values if factor == 1 else decimate(values, factor, axis=-2, zero_phase=True)


def main():
    job = Job.given()
    model = load(job)
    robot, n = SimpleNamespace(model=model, data=model.createData()), model.nv
    config = {"is_joint_torques": True, "is_external_wrench": False, "force_torque": None, "act_idxv": list(range(n))}
    config |= dict.fromkeys(("has_friction", "has_actuator_inertia", "has_joint_offset"), job.friction)
    names = list(model.names)[1:]
    corner = job.facts.get("corner", CORNER_HZ)
    train = [states(model, run, corner) for run in job.even_runs("train")]
    parts = [columns(robot, run, config) for run in train]
    parts = [decimated(part.reshape(n, len(run[0]), -1), run) for part, run in zip(parts, train, strict=True)]
    # Stacked joint by joint, as figaroh has it, over all runs.
    y = np.concatenate(parts, axis=1).reshape(-1, parts[0].shape[2])
    tau = np.concatenate([decimated(run[4], run) for run in train]).T.ravel()
    prior = np.array(list(get_standard_parameters(model, config).values()))
    weight = np.ones_like(tau)
    for _ in range(2):  # once plain, once weighted by what each joint leaves
        found = np.linalg.lstsq(weight[:, None] * y, weight * tau, rcond=1e-10)[0]
        left = (tau - y @ found).reshape(n, -1)
        weight = np.repeat(1.0 / left.std(axis=1), left.shape[1])
    extras = [f"{kind}_{joint}" for kind in ("fv", "fs", "ia", "off") for joint in names][: y.shape[1] - 10 * n]
    keys = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    standard = [f"{key}_{joint}" for joint in names for key in keys]
    fixed = FixedExtras(tuple(extras), tuple(found[10 * n :]), "declared")
    start = np.concatenate([prior[: 10 * n], found[10 * n :]])
    theta = found[: 10 * n]
    # Its solver gives up on some weights: first those of what is left, then those of its own benchmark.
    by_effort = np.repeat(1.0 / tau.reshape(n, -1).std(axis=1), len(tau) // n)
    for rows in (weight / weight.max(), by_effort, np.ones_like(tau)) if job.facts["physical"] else ():
        problem = build_problem(y, tau, standard + extras, names, prior=start, extras=fixed, row_weight=rows)
        solved = solve_direct_effort_fit(problem)
        if solved.theta is not None:
            theta = solved.theta
            break
    numbers = np.concatenate([theta, found[10 * n :]])
    predicted = []
    for run in job.even_runs("test"):
        own = states(model, run, corner)
        predicted.append((own[0], (columns(robot, own, config) @ numbers).reshape(n, -1).T))
    job.answer(predicted, least_eigenvalue(theta))


if __name__ == "__main__":
    main()
