"""What a peer is given and what it gives back: plain arrays, so that it can run in a Python of its own.

A job's folder holds `job.json` (URDF, MJCF, joints, whether friction is to be sought), `train.npz` and `test.npz`; the
peer writes `out.npz`. This file needs NumPy and SciPy alone.
"""

import json
import sys
from pathlib import Path

import numpy as np

# Corner of the filter that all peers look at torque through, ours too [Hz], and what is cut off at a run's ends [s].
CORNER_HZ, BORDER_S = 10.0, 0.25


class Job:
    """One set of recordings for one peer.

    Args:
        folder: Where it lies.
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        self.facts = json.loads((self.folder / "job.json").read_text())
        self.joints = self.facts["joints"]
        self.friction = self.facts["friction"]

    @classmethod
    def given(cls):
        """The job that the command line names."""
        return cls(sys.argv[1])

    def runs(self, name):
        """(time, position, torque) of each run as it was recorded."""
        with np.load(self.folder / f"{name}.npz") as arrays:
            count = len([key for key in arrays.files if key.startswith("time")])
            return [tuple(arrays[f"{what}{k}"] for what in ("time", "q", "tau")) for k in range(count)]

    def even_runs(self, name, most_hz=250.0):
        """The same on an even grid at the median rate, or a part of it."""
        found = []
        for time, q, tau in self.runs(name):
            step = np.median(np.diff(time))
            grid = np.arange(time[0], time[-1], step * max(1, round(1.0 / step / most_hz)))
            columns = [np.stack([np.interp(grid, time, c) for c in part.T], axis=1) for part in (q, tau)]
            found.append((grid, *columns))
        return found

    def answer(self, predicted, least_eigenvalue):
        """Writes (time, torque) of each test run, and the least eigenvalue of any link's pseudo-inertia."""
        arrays = {f"time{k}": time for k, (time, _) in enumerate(predicted)}
        arrays |= {f"tau{k}": tau for k, (_, tau) in enumerate(predicted)}
        np.savez(self.folder / "out.npz", least_eigenvalue=least_eigenvalue, **arrays)


def write_job(folder, facts, runs):
    """Writes a job; runs are (time, position, torque) by `train` and `test`."""
    folder.mkdir(parents=True)
    (folder / "job.json").write_text(json.dumps(facts))
    for name, own in runs.items():
        arrays = {f"{what}{k}": run[i] for k, run in enumerate(own) for i, what in enumerate(("time", "q", "tau"))}
        np.savez(folder / f"{name}.npz", **arrays)


def lowpass(values, rate, corner=CORNER_HZ):
    """Zero-phase Butterworth filter of fourth order."""
    from scipy.signal import butter, sosfiltfilt  # half a second, and not every program filters

    if corner >= 0.45 * rate:
        return values
    return sosfiltfilt(butter(4, corner, fs=rate, output="sos"), values, axis=0)


def inner(rate, most=np.inf):
    """Rows of a run without its borders, at most so many a second."""
    border = round(BORDER_S * rate)
    return slice(border, -border, max(1, round(rate / most)))


def least_eigenvalue(numbers):
    """Least eigenvalue of the pseudo-inertias of bodies with numbers m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    least = np.inf
    for m, x, y, z, xx, xy, yy, xz, yz, zz in np.reshape(numbers, (-1, 10)):
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
        centre = np.array([[x], [y], [z]])
        least = min(least, np.linalg.eigvalsh(np.block([[second, centre], [centre.T, np.array([[m]])]])).min())
    return least
