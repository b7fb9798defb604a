"""MuJoCo's sysid on a job: pseudo-inertias, armature and friction by its optimiser over inverse dynamics."""

import mujoco
import mujoco.sysid as sysid
import numpy as np
from job import Job, lowpass
from mujoco.sysid import InertiaType, Parameter, ParameterDict, model_modifier

# Inverse dynamics is called sample by sample for each of 80 differences: so many rows a second, in all so many.
ROWS_HZ, MOST_ROWS, BORDER_S = 10.0, 600, 0.25


def states(run, most):
    """Filtered differences of the positions, and filtered torque."""
    time, q, tau = run
    rate = 1.0 / (time[1] - time[0])
    smooth = lowpass(q, rate)
    dq = np.gradient(smooth, time, axis=0)
    ddq = lowpass(np.gradient(dq, time, axis=0), rate)
    border = round(BORDER_S * rate)
    rows = slice(border, -border, max(1, round(rate / most)))
    return tuple(part[rows] for part in (time, smooth, dq, ddq, lowpass(tau, rate)))


def torque(model, run, coulomb, offset):
    data = mujoco.MjData(model)
    found = np.empty_like(run[1])
    for k, (q, dq, ddq) in enumerate(zip(*run[1:4], strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found + coulomb * np.sign(run[2]) + offset


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


def setter(joint, key):
    return lambda spec, parameter: setattr(spec.joint(joint), key, parameter.value[0])


def main():
    job = Job.given()
    spec = mujoco.MjSpec.from_file(job.facts["mjcf"])
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model, n = spec.compile(), len(job.joints)
    unknown = ParameterDict()
    for joint in job.joints:
        body = model.body(model.jnt_bodyid[model.joint(joint).id]).name
        kind = {"inertia_type": InertiaType.Pseudo, "modifier": body_setter(body)}
        unknown.add(sysid.body_inertia_param(spec, model, body, **kind))
        if job.friction:
            unknown.add(Parameter(f"armature_{joint}", 0.1, 0.0, 20.0, modifier=setter(joint, "armature")))
            unknown.add(Parameter(f"damping_{joint}", 1.0, 0.0, 200.0))
    if job.friction:
        unknown.add(Parameter("coulomb", np.full(n, 0.5), np.zeros(n), np.full(n, 100.0)))
        unknown.add(Parameter("offset", np.zeros(n), np.full(n, -20.0), np.full(n, 20.0)))
    train = [states(run, ROWS_HZ) for run in job.even_runs("train")]
    run = [np.concatenate(parts) for parts in zip(*train, strict=True)]
    run = [part[:: -(-len(run[0]) // MOST_ROWS)] for part in run]
    weight = 1.0 / run[4].std(axis=0)

    def predict(found, own):
        present = sysid.apply_param_modifiers(found, spec)
        if not job.friction:
            return torque(present, own, 0.0, 0.0)
        damping = np.array([found[f"damping_{joint}"].value[0] for joint in job.joints])
        return torque(present, own, found["coulomb"].value, found["offset"].value) + damping * own[2]

    def residual(x, found):
        found.update_from_vector(x)
        return [((predict(found, run) - run[4]) * weight).ravel()], None, None

    for _ in range(2):
        unknown, _ = sysid.optimize(unknown, residual, optimizer="scipy", verbose=False, max_iters=60)
        weight = 1.0 / (predict(unknown, run) - run[4]).std(axis=0)
    tests = [states(one, 1e9) for one in job.even_runs("test")]
    # Its log-Cholesky numbers can be nothing but consistent.
    job.answer([(own[0], predict(unknown, own)) for own in tests], 0.0)


if __name__ == "__main__":
    main()
