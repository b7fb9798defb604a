"""What a peer needs to enter a board: sessions in, torques and answers out. NumPy, SciPy, pyarrow and
Pinocchio alone; nothing of armgap.

    python tests/bench/peers/board_least_squares.py BOARD ANSWERS/least_squares
"""

import argparse
import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.signal import butter, sosfiltfilt

CORNER_HZ, ROWS_HZ = 10.0, 25.0  # of the filter for all signals, and rows of a fit a second
REST_RAD_S = 0.01  # width of a speed's sign
SHORTEST_S = 1.0


class Session:
    """A session of a board: its arm, its runs and the motion that is to be foretold."""

    def __init__(self, board, name, facts):
        self.board, self.name, self.joints = board, name, facts["joints"]
        self.folder = board / "sessions" / name
        self.urdf = self.folder / "robot.urdf"
        whole = pin.buildModelFromUrdf(str(self.urdf))
        locked = [k for k in range(1, whole.njoints) if whole.names[k] not in self.joints]
        self.model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
        self.unseen = board / "unseen" / f"{name}.parquet"
        self.before = board / "before" / name if facts["before"] else None

    def runs(self, folder=None):
        """(time, position, torque) of each run that is long enough, of the session or of another folder."""
        tables = [pq.read_table(path) for path in sorted((folder or self.folder).glob("*.parquet"))]
        runs = [(read(t, ["time"])[:, 0], self.channel(t, "position"), self.channel(t, "effort")) for t in tables]
        return [run for run in runs if run[0][-1] - run[0][0] > SHORTEST_S]

    def runs_of_model(self):
        """Runs that foretell the arm: as it was before, where they are given."""
        return self.runs(self.before)

    def channel(self, table, name):
        return read(table, [f"{joint}/{name}" for joint in self.joints])

    def motion(self):
        """(time, position) of the motion that is to be foretold."""
        table = pq.read_table(self.unseen)
        return read(table, ["time"])[:, 0], self.channel(table, "position")


def read(table, names):
    return np.column_stack([table[name].to_numpy().astype(float) for name in names])


def states(time, q, tau=None, rate=None):
    """Filtered q, dq, ddq and torque on an even grid, at `rate` rows a second if given."""
    grid = np.linspace(time[0], time[-1], len(time))
    step = grid[1] - grid[0]

    def smooth(x):
        even = np.column_stack([np.interp(grid, time, column) for column in x.T])
        return sosfiltfilt(butter(2, min(2.0 * CORNER_HZ * step, 0.8), output="sos"), even, axis=0)

    q = smooth(np.unwrap(q, axis=0))
    dq = np.gradient(q, step, axis=0)
    found = (grid, q, dq, smooth(np.gradient(dq, step, axis=0)), None if tau is None else smooth(tau))
    rows = slice(None, None, 1 if rate is None else max(1, round(1.0 / (step * rate))))
    return tuple(None if part is None else part[rows] for part in found)


def columns(model, q, dq, ddq):
    """Bodies (10 a link), then rotor, viscous, Coulomb and offset of each joint, shape (T, n, 14 n)."""
    data, n = model.createData(), model.nv
    bodies = np.array([pin.computeJointTorqueRegressor(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
    losses = (ddq, dq, np.tanh(dq / REST_RAD_S), np.ones_like(dq))
    own = [x[:, :, None] * np.eye(n) for x in losses]
    return np.concatenate([bodies.reshape(len(q), n, 10 * n), *own], axis=2)


def rows_of(session, runs):
    """Columns and torque of some runs, so many rows a second as a fit is given."""
    motions = [states(*run, rate=ROWS_HZ) for run in runs]
    x = np.concatenate([columns(session.model, *motion[1:4]) for motion in motions])
    return x, np.concatenate([motion[4] for motion in motions])


def weighted_fit(x, y):
    """Least squares, once plain and twice weighted by what each joint leaves."""
    noise = np.ones(y.shape[1])
    for _ in range(3):
        found = np.linalg.lstsq((x / noise[:, None]).reshape(-1, x.shape[2]), (y / noise).ravel(), rcond=1e-6)[0]
        noise = np.std(y - x @ found, axis=0) + 1e-9
    return found


def enter(answer):
    """Calls `answer(session, out)` for each session of the board that the command line names."""
    parser = argparse.ArgumentParser()
    parser.add_argument("board", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--limit", type=int)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    listed = json.loads((given.board / "board.json").read_text())["sessions"]
    for name in list(listed)[: given.limit]:
        answer(Session(given.board, name, listed[name]), given.out)
        print(name, flush=True)


def write_torque(session, out, time, torque):
    """Writes a foretold torque at the rows of the unseen motion."""
    rows = session.motion()[0]
    table = {f"{j}/effort": np.interp(rows, time, x) for j, x in zip(session.joints, torque.T, strict=True)}
    pq.write_table(pa.table(table), out / f"{session.name}.parquet")


def write_answer(session, out, named, none):
    """Writes names {(effect, joint): probability} and `none`; what is left is dealt to all answers evenly."""
    listed = json.loads((session.board / "effects.json").read_text())["effects"]
    share = (1.0 - none - sum(named.values())) / (len(listed) + 2)
    rows = [{"effect": e, "joint": j, "probability": p} for (e, j), p in named.items()]
    first = {"arm": "", "joint": session.joints[0]}
    rows += [{"effect": e, "joint": first[facts["scope"]], "probability": share} for e, facts in listed.items()]
    head = {"schema": "ident.board_answer/1", "session": session.name}
    record = {**head, "effects": rows, "none": none + share, "other": share}
    (out / f"{session.name}.json").write_text(json.dumps(record, indent=1))
