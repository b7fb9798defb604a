"""filterpy on a job: its Kalman smoother for the states, and least squares by hand over Pinocchio's regressor."""

import numpy as np
import pinocchio as pin
from filterpy.kalman import KalmanFilter
from job import CORNER_HZ, Job, least_eigenvalue, lowpass

# filterpy works sample by sample: so many a second are enough for arms.
ROWS_HZ, NOISE_RAD = 100.0, 1e-4


def smooth(z, step):
    """Position, speed and acceleration of one joint on a white-jerk model whose corner is the common one."""
    tracker = KalmanFilter(dim_x=3, dim_z=1)
    tracker.F = np.array([[1, step, step**2 / 2], [0, 1, step], [0, 0, 1]])
    tracker.H, tracker.R = np.array([[1.0, 0, 0]]), np.array([[NOISE_RAD**2]])
    density = NOISE_RAD**2 * step * (2 * np.pi * CORNER_HZ) ** 6
    tracker.Q = density * np.array(
        [
            [step**5 / 20, step**4 / 8, step**3 / 6],
            [step**4 / 8, step**3 / 3, step**2 / 2],
            [step**3 / 6, step**2 / 2, step],
        ]
    )
    tracker.x, tracker.P = np.array([[z[0]], [0.0], [0.0]]), np.diag([NOISE_RAD**2, 9.0, 900.0])
    means, covariances, _, _ = tracker.batch_filter(z)
    return tracker.rts_smoother(means, covariances)[0][:, :, 0]


def columns(model, q, dq, ddq, friction):
    data = model.createData()
    rows = zip(q, dq, ddq, strict=True)
    y = np.array([pin.computeJointTorqueRegressor(model, data, *row).copy() for row in rows])
    if friction:
        diagonal = [np.einsum("tn,nm->tnm", part, np.eye(model.nv)) for part in (ddq, dq, np.sign(dq))]
        constant = np.broadcast_to(np.eye(model.nv), (len(q), model.nv, model.nv))
        y = np.concatenate([y, *diagonal, constant], axis=2)
    return y


def states(model, run, friction):
    """Filtered columns and torque of a run, a row in five kept for the fit."""
    time, q, tau = run
    step = time[1] - time[0]
    x = np.stack([smooth(z, step) for z in q.T], axis=1)
    y = columns(model, *np.moveaxis(x, -1, 0), friction)
    return time, lowpass(y, 1.0 / step), lowpass(tau, 1.0 / step), x[:, :, 1], y


def main():
    job = Job.given()
    whole = pin.buildModelFromUrdf(job.facts["urdf"])
    locked = [k for k in range(1, whole.njoints) if whole.names[k] not in job.joints]
    model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
    train = [states(model, run, job.friction) for run in job.even_runs("train", ROWS_HZ)]
    y = np.concatenate([one[1] for one in train])[::2]
    tau = np.concatenate([one[2] for one in train])[::2]
    moving = np.concatenate([np.abs(one[3]) > 0.02 for one in train])[::2]
    weight = np.ones(model.nv)
    for _ in range(2):
        rows = (moving * weight)[..., None] * y
        found = np.linalg.lstsq(rows.reshape(-1, y.shape[2]), (moving * weight * tau).ravel(), rcond=1e-10)[0]
        weight = 1.0 / np.std(np.where(moving, tau - y @ found, 0.0), axis=0)
    predicted = []
    for run in job.even_runs("test", ROWS_HZ):
        time, _, _, _, raw = states(model, run, job.friction)
        predicted.append((time, raw @ found))
    job.answer(predicted, least_eigenvalue(found[: 10 * model.nv]))


if __name__ == "__main__":
    main()
