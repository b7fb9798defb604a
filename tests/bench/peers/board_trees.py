"""Gradient-boosted trees on what plain least squares leave: all states, the load, 0.8 s of history."""

import numpy as np
from board_entry import ROWS_HZ, columns, enter, states, weighted_fit, write_torque
from sklearn.ensemble import HistGradientBoostingRegressor

LAG_S, HISTORY_S = 0.1, 0.8
ROUNDS, RATE, LEAVES, LEAST_LEAF = 200, 0.06, 15, 40


def inputs(run, load):
    """States of all joints, the load, and positions and speeds of the last 0.8 s."""
    time, q, dq, ddq = run[:4]
    lag = max(1, round(LAG_S / (time[1] - time[0])))
    found = [q, dq, ddq, load]
    for k in range(1, round(HISTORY_S / LAG_S) + 1):
        rows = np.maximum(np.arange(len(q)) - k * lag, 0)
        found += [q - q[rows], dq[rows]]
    return np.concatenate(found, axis=1)


def answer(session, out):
    if not session.unseen.is_file():
        return
    train = [states(*run, rate=ROWS_HZ) for run in session.runs_of_model()]
    parts = [columns(session.model, *run[1:4]) for run in train]
    found = weighted_fit(np.concatenate(parts), np.concatenate([run[4] for run in train]))
    loads = [part @ found for part in parts]
    x = np.concatenate([inputs(run, load) for run, load in zip(train, loads, strict=True)])
    left = np.concatenate([run[4] - load for run, load in zip(train, loads, strict=True)])
    motion = states(*session.motion(), rate=ROWS_HZ)
    torque = columns(session.model, *motion[1:4]) @ found
    seen = inputs(motion, torque)
    options = {"max_iter": ROUNDS, "learning_rate": RATE, "max_leaf_nodes": LEAVES, "random_state": 0}
    trees = [HistGradientBoostingRegressor(**options, min_samples_leaf=LEAST_LEAF).fit(x, own) for own in left.T]
    added = np.column_stack([tree.predict(seen) for tree in trees])
    write_torque(session, out, motion[0], torque + added)


if __name__ == "__main__":
    enter(answer)
