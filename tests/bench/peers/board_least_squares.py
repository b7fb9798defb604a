"""Plain least squares on a board: bodies, rotor, viscous and Coulomb friction, offset; no prior."""

from board_entry import columns, enter, rows_of, states, weighted_fit, write_torque


def answer(session, out):
    if not session.unseen.is_file():
        return
    found = weighted_fit(*rows_of(session, session.runs_of_model()))
    time, *motion, _ = states(*session.motion())
    write_torque(session, out, time, columns(session.model, *motion) @ found)


if __name__ == "__main__":
    enter(answer)
