"""armgap beside figaroh, MuJoCo's sysid and filterpy on the same recordings: one command, one table.

    pip install -e .[bench]     # or, kept apart: V/bin/pip install figaroh==1.0.2 mujoco[sysid]==4.0.0 filterpy
    python -m tests.bench.peers.bench_peers [--peer-python V/bin/python] [--only UR10,TM5] [--without sysid] [--seeds 1]
        [--patience 900]

Every peer is a program of its own (`run_*.py`) that is given positions and torque of the training runs and tells the
torque of the test runs from their positions. Torque is scored through one zero-phase filter of 10 Hz, borders of 0.7 s
left out, where a joint moves; against the truth without noise, and unfiltered, where that is known. Processor time and
peak memory are the whole program's, imports included, on one thread. `lines` counts what a user has to write: of the
peers' programs all that is neither comment nor import; armgap is one command. Recordings: IDENT_REAL_DATA.
"""

import argparse
import ast
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import write_mjcf
from ident.laws.motion import Losses
from ident.robot.arm import ArmModel
from tests.bench.peers.job import lowpass, write_job
from tests.bench.peers.sets import Recorded, fixture_sets, real_sets, shipped_set

HERE = Path(__file__).parent
BORDER_S, REST_RAD_S = 0.7, 0.02
# Processor time after which a program is stopped, unless another is asked for [s].
PATIENCE_S = 900
# A pseudo-inertia's eigenvalue this far below zero is rounding [kg m²].
ROUNDING = -1e-7


@dataclass(frozen=True)
class Peer:
    """A program, and what it is told beside the job."""

    name: str
    script: str
    own_python: bool = False
    net: str = "none"
    physical: bool = True

    @property
    def lines(self) -> int:
        if self.script == "run_armgap.py":
            return 1
        tree = ast.parse((HERE / self.script).read_text())
        kept = [node for node in tree.body if not isinstance(node, ast.Import | ast.ImportFrom | ast.Expr)]
        return sum(len(ast.unparse(node).splitlines()) for node in kept)


PEERS = (
    Peer("armgap", "run_armgap.py"),
    Peer("armgap + net", "run_armgap.py", net="default"),
    Peer("figaroh", "run_figaroh.py", own_python=True),
    Peer("figaroh, free", "run_figaroh.py", own_python=True, physical=False),
    Peer("sysid", "run_sysid.py", own_python=True),
    Peer("filterpy", "run_filterpy.py", own_python=True),
)


@dataclass(frozen=True)
class Row:
    """A peer on a set: NaN and the reason where it failed."""

    peer: str
    rmse: float = float("nan")
    worst_joint: float = float("nan")
    worst_r2: float = float("nan")
    cpu_s: float = float("nan")
    memory_mb: float = float("nan")
    consistent: str = ""
    failed: str = ""


def run_peer(peer: Peer, recorded: Recorded, mjcf: Path, place: Path, python: str, patience: int) -> Row:
    """Runs one peer on one set in a process of its own, for so many seconds of processor time at most."""
    facts = {
        "urdf": str(recorded.urdf),
        "mjcf": str(mjcf),
        "joints": list(recorded.joints),
        "friction": recorded.friction,
        "corner": recorded.corner,
        "net": peer.net,
        "physical": peer.physical,
    }
    folder = place / peer.name.replace(" ", "")
    write_job(folder, facts, {"train": recorded.train, "test": recorded.test})
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    paths = os.pathsep.join([str(HERE), str(HERE.parents[2])])
    environment = {**os.environ, **one, "PYTHONPATH": "" if peer.own_python else paths}
    line = [python if peer.own_python else sys.executable, str(HERE / peer.script), str(folder)]
    # A shell's child alone is waited for here, so that peak memory is that of the peer.
    watched = subprocess.run(
        [sys.executable, "-c", WATCH, str(patience), *line], capture_output=True, text=True, env=environment
    )
    cpu, memory = (float(word) for word in (watched.stdout.split() or ["nan", "nan"])[-2:])
    if not (folder / "out.npz").is_file():
        if cpu >= patience:
            return Row(peer.name, cpu_s=cpu, memory_mb=memory, failed=f"not done in {patience} s")
        return Row(peer.name, cpu_s=cpu, failed=(watched.stderr.strip().splitlines() or ["no answer"])[-1][:80])
    with np.load(folder / "out.npz") as arrays:
        found = [(arrays[f"time{k}"], arrays[f"tau{k}"]) for k in range(len(recorded.test))]
        consistent = "yes" if float(arrays["least_eigenvalue"]) > ROUNDING else "no"
    rmse, worst, r2 = score(recorded, found)
    return Row(peer.name, rmse, worst, r2, cpu, memory, consistent)


# Runs a program, the system ends it after its processor time; prints what it took of that [s] and of memory [MB].
WATCH = """
import resource, subprocess, sys
resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[1]), int(sys.argv[1]) + 5))
subprocess.run(sys.argv[2:], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


def score(recorded: Recorded, found: list[tuple[Array, Array]]) -> tuple[float, float, float]:
    """Torque RMSE over all joints, of the worst joint [N m], and the worst R²."""
    left, measured, moving = [], [], []
    for k, ((time, q, tau), (at, predicted)) in enumerate(zip(recorded.test, found, strict=True)):
        rate = 1.0 / float(np.median(np.diff(time)))
        grid = np.arange(time[0] + BORDER_S, time[-1] - BORDER_S, 1.0 / min(rate, 250.0))
        wanted = tau if recorded.truth is None else recorded.truth[k]
        seen, asked, angle = (_at(grid, *one) for one in ((at, predicted), (time, wanted), (time, q)))
        if recorded.truth is None:
            seen, asked = (lowpass(part, min(rate, 250.0)) for part in (seen, asked))
        speed = np.gradient(lowpass(angle, min(rate, 250.0), 5.0), grid, axis=0)
        left.append(seen - asked)
        measured.append(asked)
        moving.append((np.abs(speed) > REST_RAD_S) | (recorded.truth is not None))
    off, torque, counts = np.concatenate(left), np.concatenate(measured), np.concatenate(moving)
    squares = np.sum(np.where(counts, off, 0.0) ** 2, axis=0) / counts.sum(axis=0)
    spread = np.array([np.var(column[own]) for column, own in zip(torque.T, counts.T, strict=True)])
    return float(np.sqrt(squares.mean())), float(np.sqrt(squares.max())), float(np.min(1.0 - squares / spread))


def _at(grid: Array, time: Array, values: Array) -> Array:
    return np.stack([np.interp(grid, time, column) for column in values.T], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python", default=sys.executable, help="a Python that has the peers")
    parser.add_argument("--only", default="", help="parts of sets' names, with commas")
    parser.add_argument("--without", default="", help="peers that are left out, with commas")
    parser.add_argument("--seeds", type=int, default=5, help="noise seeds of the known truth")
    parser.add_argument("--patience", type=int, default=PATIENCE_S, help="processor time of one program [s]")
    asked = parser.parse_args()
    only, without = ([part for part in text.split(",") if part] for text in (asked.only, asked.without))
    peers = [peer for peer in PEERS if peer.name not in without]
    print(f"{'':<20}{'':<14}{'RMSE':>8}{'worst':>8}{'worst R²':>10}{'cpu s':>8}{'MB':>7}{'lines':>7}  consistent")
    with tempfile.TemporaryDirectory() as folder:
        real = real_sets(Path(os.environ.get("IDENT_REAL_DATA", "../shared/real")))
        for recorded in chain(real, [shipped_set()], fixture_sets(Path(folder), asked.seeds)):
            if only and not any(part in recorded.name for part in only):
                continue
            place = Path(folder) / recorded.name.replace(" ", "_")
            place.mkdir()
            mjcf = _mjcf(recorded, place)
            for peer in peers:
                row = run_peer(peer, recorded, mjcf, place, asked.peer_python, asked.patience)
                seen = f"{row.rmse:8.4f}{row.worst_joint:8.4f}{row.worst_r2:10.4f}{row.cpu_s:8.1f}{row.memory_mb:7.0f}"
                print(
                    f"{recorded.name:<20}{row.peer:<14}{seen}{peer.lines:>7}  {row.consistent}{row.failed}", flush=True
                )
    print(f"peak memory of this program itself: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


def _mjcf(recorded: Recorded, place: Path) -> Path:
    """The same arm for MuJoCo, without losses."""
    whole = ArmModel.load(recorded.urdf)
    arm = whole if whole.joint_names == recorded.joints else whole.keeping(recorded.joints)
    path = place / "arm.xml"
    losses = Losses(*np.zeros((3, arm.n)), np.full(arm.n, 1e-6), np.zeros(arm.n))
    path.write_text(write_mjcf(IdentifiedArm.with_losses(arm, losses)))
    return path


if __name__ == "__main__":
    main()
