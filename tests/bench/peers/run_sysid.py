"""MuJoCo's sysid on a job: pseudo-inertias, armature and friction by its optimiser over inverse dynamics."""

import mujoco
import mujoco.sysid as sysid
import numpy as np
from job import Job, inner, lowpass
from mujoco.sysid import InertiaType, Parameter, ParameterDict, model_modifier

# Inverse dynamics is called sample by sample for each of 80 differences: so many rows a second, in all so many.
ROWS_HZ, MOST_ROWS = 10.0, 600


def states(run, most):
    """Filtered differences of the positions, and filtered torque."""
    time, q, tau = run
    rate = 1.0 / (time[1] - time[0])
    q = lowpass(q, rate)
    dq = np.gradient(q, time, axis=0)
    ddq = lowpass(np.gradient(dq, time, axis=0), rate)
    return tuple(part[inner(rate, most)] for part in (time, q, dq, ddq, lowpass(tau, rate)))


def torque(model, run):
    data = mujoco.MjData(model)
    found = np.empty_like(run[1])
    for k, (q, dq, ddq) in enumerate(zip(*run[1:4], strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found


def body_setter(body):
    """Writes a body's pseudo-inertia as principal moments: its own way leaves zeros that MuJoCo 4.0 refuses."""

    def write(spec, parameter):
        numbers, own = model_modifier.pi_from_theta(parameter.value), spec.body(body)
        across = model_modifier.skew(numbers[1:4] / numbers[0])
        moments, axes = np.linalg.eigh(numbers[4:].reshape(3, 3) + numbers[0] * across @ across)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        own.mass, own.ipos, own.inertia = numbers[0], numbers[1:4] / numbers[0], np.maximum(moments, 1e-9)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, axes.ravel())
        own.iquat, own.explicitinertial, own.fullinertia = quaternion, True, np.full((6, 1), np.nan)

    return write


def parameters(job, spec):
    """What is sought, each with its start and its bounds."""
    model, n, unknown = spec.compile(), len(job.joints), ParameterDict()
    for joint in job.joints:
        body = model.body(model.jnt_bodyid[model.joint(joint).id]).name
        kind = {"inertia_type": InertiaType.Pseudo, "modifier": body_setter(body)}
        unknown.add(sysid.body_inertia_param(spec, model, body, **kind))
    if job.friction:
        bounds = {"armature": (0.1, 0, 20), "damping": (1, 0, 200), "coulomb": (0.5, 0, 100), "offset": (0, -20, 20)}
        for name, numbers in bounds.items():
            unknown.add(Parameter(name, *(np.full(n, float(number)) for number in numbers)))
    return unknown


def predict(job, spec, found, run):
    made = torque(sysid.apply_param_modifiers(found, spec), run)
    if job.friction:
        armature, damping, coulomb, offset = (found[key].value for key in ("armature", "damping", "coulomb", "offset"))
        made += armature * run[3] + damping * run[2] + coulomb * np.sign(run[2]) + offset
    return made


def main():
    job = Job.given()
    spec = mujoco.MjSpec.from_file(job.facts["mjcf"])
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    train = [states(run, ROWS_HZ) for run in job.even_runs("train")]
    run = [np.concatenate(parts) for parts in zip(*train, strict=True)]
    run = [part[:: -(-len(run[0]) // MOST_ROWS)] for part in run]
    unknown, weight = parameters(job, spec), 1.0 / run[4].std(axis=0)

    def residual(x, found):
        found.update_from_vector(x)
        return [((predict(job, spec, found, run) - run[4]) * weight).ravel()], None, None

    for _ in range(2):
        unknown, _ = sysid.optimize(unknown, residual, optimizer="scipy", verbose=False, max_iters=60)
        weight = 1.0 / (predict(job, spec, unknown, run) - run[4]).std(axis=0)
    tests = [states(one, 1e9) for one in job.even_runs("test")]
    # Its log-Cholesky numbers can be nothing but consistent.
    job.answer([(own[0], predict(job, spec, unknown, own)) for own in tests], 0.0)


if __name__ == "__main__":
    main()
