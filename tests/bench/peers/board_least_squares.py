"""Plain least squares on a board: bodies, rotor, viscous and Coulomb friction, offset; no prior."""

import numpy as np
from board_entry import ROWS_HZ, columns, enter, states, weighted_fit, write_torque


def answer(session, out):
    if not session.unseen.is_file():
        return
    train = [states(*run, rate=ROWS_HZ) for run in session.runs()]
    x = np.concatenate([columns(session.model, *run[1:4]) for run in train])
    found = weighted_fit(x, np.concatenate([run[4] for run in train]))
    time, *motion, _ = states(*session.motion())
    write_torque(session, out, time, columns(session.model, *motion) @ found)


if __name__ == "__main__":
    enter(answer)
