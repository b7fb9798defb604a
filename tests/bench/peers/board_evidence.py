"""An entry on track 1 of a public board, from its README alone: numpy, scipy, pandas and Pinocchio.

    python tests/bench/peers/board_evidence.py BOARD OUT

Bodies, rotors, Coulomb and viscous friction and offsets are fitted to all runs, together with those of the arm before.
Each listed effect is then given columns of its own in the session alone; how likely it is follows from what they
explain of the rest, by BIC with as many samples as are independent of each other, from the README's shares on.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pandas
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

CORNER_HZ, ROWS_HZ = 5.0, 20.0
REST = 0.02  # speed over which friction turns round [rad/s]
SLOW, TRAVEL, STEP = 0.08, 0.02, 1e-4  # Stribeck's speed, travel of a reversal, step of a derivative
ORDERS = (8, 16, 32, 50, 64, 80, 100, 128, 160)  # of a ripple
DRAWN, PLANTED = (0.27, 0.08), (0.16, 0.10)  # of the README's table: nothing, and what is not listed
TINY, LEAST = 1e-9, 1e-3  # LEAST: size of what the usual arm leaves of a column, below which it is none
SURE = 0.9  # share of the probability that the evidence deals; the rest is dealt as before it


def motion(path, joints):
    """Time, angle, speed, acceleration and torque on an even grid, smoothed."""
    run = pandas.read_parquet(path)
    time = run["time"].to_numpy()
    grid = np.linspace(time[0], time[-1], len(time))
    step = grid[1] - grid[0]
    low = butter(2, min(2.0 * CORNER_HZ * step, 0.8), output="sos")

    def smooth(columns):
        even = np.column_stack([np.interp(grid, time, column) for column in columns.T])
        return sosfiltfilt(low, even, axis=0)

    angle = smooth(run[[f"{joint}/position" for joint in joints]].to_numpy(float))
    torque = smooth(run[[f"{joint}/effort" for joint in joints]].to_numpy(float))
    speed = np.gradient(angle, step, axis=0)
    push = np.gradient(speed, step, axis=0)
    rate = np.gradient(torque, step, axis=0)
    every = max(1, round(1.0 / (step * ROWS_HZ)))
    return [values[::every] for values in (grid[:, None], angle, speed, push, torque, rate)]


def runs_of(folder, joints):
    """All runs of a folder that are long enough, one below the other, and the first row of each."""
    paths = [path for path in sorted(folder.glob("*.parquet")) if len(pandas.read_parquet(path)) > 30]
    parts = [motion(path, joints) for path in paths]
    starts = np.cumsum([0] + [len(part[0]) for part in parts])[:-1]
    return [np.concatenate(values) for values in zip(*parts, strict=True)], starts


def torque_of(model, angle, speed, push):
    data = model.createData()
    rows = zip(angle, speed, push, strict=True)
    return np.array([pin.rnea(model, data, *row) for row in rows])


def bodies_of(model, angle, speed, push):
    """Columns of all bodies, ten a link, shape (T, n, 10 n)."""
    data = model.createData()
    rows = zip(angle, speed, push, strict=True)
    return np.array([pin.computeJointTorqueRegressor(model, data, *row) for row in rows])


def since_reversal(angle, speed):
    """Travel since a joint last turned round."""
    travel = np.abs(np.diff(angle, prepend=angle[:1]))
    turned = np.flatnonzero(np.diff(np.sign(speed), prepend=np.sign(speed[:1])))
    total = np.cumsum(travel)
    last = np.zeros(len(angle))
    last[turned] = total[turned]
    return total - np.maximum.accumulate(last)


def suspects(model, values, bodies, usual):
    """Columns (T, n, k) of each effect at each joint, by effect and number of the joint."""
    time, angle, speed, push, torque, rate = values
    n = model.nv
    rigid = torque_of(model, angle, speed, push)
    sign = np.tanh(speed / REST)
    found = {("payload", 0): bodies[:, :, -10:], ("torque_delay", 0): rate[:, :, None]}
    tilts = []
    for axis in (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        askew = model.copy()
        askew.gravity.linear = model.gravity.linear + STEP * np.cross(axis, model.gravity.linear)
        tilts.append((torque_of(askew, angle, speed, push) - rigid) / STEP)
    found["gravity_misalignment", 0] = np.stack(tilts, axis=2)
    for j in range(n):
        moved = angle.copy()
        moved[:, j] += STEP
        turned = (torque_of(model, moved, speed, push) - rigid) / STEP
        v, q, s, load = speed[:, j], angle[:, j], sign[:, j], usual[:, j]
        beside = [k for k in (j - 1, j + 1) if 0 <= k < n]
        peak = np.quantile(np.abs(torque[:, j]), 0.99)
        own = {
            "stribeck_friction": [s * np.exp(-np.abs(v) / SLOW)],
            "nonlinear_viscous_friction": [s * np.sqrt(np.abs(v))],
            "load_dependent_friction": [s * np.abs(load)],
            "thermal_friction": [s * time[:, 0], v * time[:, 0]],
            "presliding_hysteresis": [s * np.exp(-since_reversal(q, v) / TRAVEL)],
            "position_dependent_friction": [s * f(k * q) for k in (1, 2) for f in (np.cos, np.sin)],
            "asymmetric_friction": [np.abs(s), np.abs(v)],
            "joint_coupling": [column for k in beside for column in (sign[:, k], speed[:, k])],
            "spring_torque": [q],
            "torque_gain_error": [load],
            "torque_offset": [np.ones(len(q)), time[:, 0]],
            "torque_saturation": [np.sign(load) * np.maximum(np.abs(load) - peak, 0.0)],
        }
        for effect, columns in own.items():
            alone = np.zeros((len(q), n, len(columns)))
            alone[:, j] = np.column_stack(columns)
            found[effect, j] = alone
        for order in ORDERS:
            waves = np.zeros((len(q), n, 2))
            waves[:, j] = np.column_stack([np.cos(order * q), np.sin(order * q)])
            found["torque_ripple", j, order] = waves
        if j < n - 1:  # a mass that came to the last link is a payload
            found["link_inertial_error", j] = bodies[:, :, 10 * j : 10 * j + 4]
        found["encoder_offset", j] = turned[:, :, None]
        found["joint_elasticity", j] = (turned * load[:, None])[:, :, None]
        found["backlash", j] = (turned * np.sign(load)[:, None])[:, :, None]
    return found


def independent(left):
    """Samples of what is left that are independent of each other, of each joint."""
    counts = []
    for column in left.T:
        power = column @ column + TINY
        lags = [column[k:] @ column[:-k] / power for k in range(1, min(len(column), 400))]
        first = next((k for k, value in enumerate(lags) if value < 0.05), len(lags))
        counts.append(len(column) / (1.0 + 2.0 * sum(lags[:first])))
    return np.array(counts)


class Usual:
    """What an arm without anything wrong explains of all torques, and what is left of them."""

    def __init__(self, sides, bodies):
        columns = np.concatenate([ordinary(*side) for side in zip(sides, bodies, strict=True)])
        torque = np.concatenate([values[4] for values in sides])
        self.noise = np.std(torque, axis=0)
        for _ in range(3):
            flat = unit((columns / self.noise[:, None]).reshape(-1, columns.shape[2]))
            base, sizes, _ = np.linalg.svd(flat, full_matrices=False)
            self.base = base[:, sizes > 1e-6 * sizes[0]]
            left = self.without((torque / self.noise).ravel()).reshape(torque.shape)
            self.torque = torque - left * self.noise  # without what is left
            self.noise = self.noise * np.std(left, axis=0) + TINY
        left = left / np.std(left, axis=0)
        counts = independent(left)
        self.samples = np.sum(counts)
        self.share = np.sqrt(counts / len(left))  # by which each sample of a joint counts
        self.left = (left * self.share).ravel()
        self.rows = torque.shape

    def without(self, values):
        return values - self.base @ (self.base.T @ values)

    def gain(self, columns):
        """Log of how much likelier columns of the session alone make what is left, by BIC."""
        felt = np.zeros((*self.rows, columns.shape[2]))
        felt[: len(columns)] = columns / self.noise[:, None]
        new = self.without(unit(felt.reshape(-1, columns.shape[2]))).reshape(felt.shape)
        flat = (new * self.share[:, None]).reshape(-1, columns.shape[2])
        axes, sizes, _ = np.linalg.svd(flat, full_matrices=False)
        axes = axes[:, sizes > LEAST]
        explained = np.sum((axes.T @ self.left) ** 2)
        return 0.5 * float(explained - axes.shape[1] * np.log(self.samples))


def unit(columns):
    return columns / (np.linalg.norm(columns, axis=0) + TINY)


def ordinary(values, bodies):
    """Bodies, rotors, viscous and Coulomb friction and offsets, shape (T, n, 14 n)."""
    _, _, speed, push, _, _ = values
    losses = (push, speed, np.tanh(speed / REST), np.ones_like(speed))
    own = [column[:, :, None] * np.eye(speed.shape[1]) for column in losses]
    return np.concatenate([bodies, *own], axis=2)


def pushes(values, starts):
    """A constant torque at one joint in one run."""
    rows, n = values[1].shape
    found = {}
    for k, (start, end) in enumerate(zip(starts, [*starts[1:], rows], strict=True)):
        for joint in range(n):
            push = np.zeros((rows, n, 1))
            push[start:end, joint] = 1.0
            found["external_contact", joint, k] = push
    return found


def evidence(board, name, facts):
    """Log of how much likelier each effect at each joint makes the session than none does."""
    joints = facts["joints"]
    folder = board / "sessions" / name
    whole = pin.buildModelFromUrdf(str(folder / "robot.urdf"))
    locked = [k for k in range(1, whole.njoints) if whole.names[k] not in joints]
    model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
    after, starts = runs_of(folder, joints)
    sides = [after] + ([runs_of(board / "before" / name, joints)[0]] if facts["before"] else [])
    bodies = [bodies_of(model, *values[1:4]) for values in sides]
    usual = Usual(sides, bodies)
    found = {**suspects(model, after, bodies[0], usual.torque[: len(after[0])]), **pushes(after, starts)}
    return {key: usual.gain(columns) for key, columns in found.items()}


def shares_of(said, effects, none, other):
    """Probability of each effect, none and other."""
    before = {effect: (1.0 - none - other) / len(effects) for effect in effects}
    before |= {"none": none, "other": other}
    logs = {label: np.log(share) for label, share in before.items()}
    for effect in effects:
        gains = [gain for key, gain in said.items() if key[0] == effect]
        if gains:
            logs[effect] += np.logaddexp.reduce(gains) - np.log(len(gains))
    top = max(logs.values())
    likely = {label: np.exp(value - top) for label, value in logs.items()}
    total = sum(likely.values())
    return {label: SURE * likely[label] / total + (1.0 - SURE) * before[label] for label in before}


def answer(board, name, facts, effects):
    """An answer as README.md of the board says."""
    none, other = PLANTED if facts["before"] else DRAWN
    try:
        said = evidence(board, name, facts)
    except (ValueError, np.linalg.LinAlgError):  # too short to be filtered
        said = {}
    share = shares_of(said, effects, none, other)
    rows = []
    for effect, about in effects.items():
        keys = [key for key in said if key[0] == effect]
        best = max(keys, key=lambda key: said[key], default=(effect, 0))
        place = "" if about["scope"] == "arm" else facts["joints"][best[1]]
        rows.append({"effect": effect, "joint": place, "probability": float(share[effect])})
    head = {"schema": "ident.board_answer/1", "session": name, "effects": rows}
    return {**head, "none": float(share["none"]), "other": float(share["other"])}


def main(folder, out):
    board, place = Path(folder), Path(out)
    place.mkdir(parents=True, exist_ok=True)
    effects = json.loads((board / "effects.json").read_text())["effects"]
    for name, facts in json.loads((board / "board.json").read_text())["sessions"].items():
        path = place / f"{name}.json"
        if not path.is_file():
            path.write_text(json.dumps(answer(board, name, facts, effects)))
            print(name, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
