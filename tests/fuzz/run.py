"""`make fuzz`: spoilt files into every reader, until the time is up; a table of kinds and outcomes.

    python -m tests.fuzz.run [--seconds 60] [--seed N] [--keep out/fuzz]

Each input follows from (seed, number); what ends in a traceback, a hang or a growth is kept with its seed. A reader
may give a result or raise `InputError`; anything else is a fault of ours. Readers run in this process, libraries loaded
once, with an alarm for hangs.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import resource
import secrets
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np
import pyarrow.csv as pacsv
import pyarrow.parquet as pq

from ident.errors import InputError
from ident.model.hybrid import FitOptions, HybridModel, fit_hybrid
from ident.opening import open_sessions
from ident.patches.change import Diagnosed
from ident.recordings.load import load_session
from ident.recordings.session_toml import load_session_file
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.telemetry import inspect
from ident.trajectories.command_files import read_commands
from tests.fuzz.spoil import BY_KIND
from tests.ident.patches.diagnoses import write_diagnosis

HANG_S = 10
GROWTH_KB = 2_000_000
ROWS = 120


class Hang(BaseException):
    """A reader took too long."""


def corpus(folder: Path) -> dict[str, tuple[Path, Callable[[Path], object]]]:
    """Good files of every kind, and the reader of each."""
    run = Path(data_path("logs/tm5_900")) / "E1/01_trajectory_1.parquet"
    table = pq.read_table(run).slice(0, ROWS)
    arm = ArmModel.load("tm5-900")
    pq.write_table(table, folder / "run.parquet")
    pacsv.write_csv(table, folder / "run.csv")
    np.savez(folder / "run.npz", **{name: table[name].to_numpy() for name in table.column_names})
    settings = 'robot = "tm5-900"\nsample_rate_hz = 50.0\n[payload]\nmass_kg = 1.0\ncom_m = [0, 0, 0.1]\n'
    (folder / "session.toml").write_text(settings + '[effort_sign]\njoint_1 = -1\n[columns]\n1 = "time"\n')
    shutil.copy(data_path("urdf/tm5_900.urdf"), folder / "robot.urdf")
    write_diagnosis(folder / "diagnosis.json", arm, "stribeck_friction", "payload")
    opened = open_sessions([run.parent], "tm5-900")
    quick = FitOptions(links=3, inertia="nominal", net="none")
    fit_hybrid(opened.motions, opened.arm, quick, opened.data_records()).model.save(folder / "model")
    commands = ["time", *(f"{name}/position_command" for name in arm.joint_names)]
    held = {name: np.arange(ROWS) / 50.0 if name == "time" else np.zeros(ROWS) for name in commands}
    lines = [
        ",".join(commands),
        *(",".join(f"{value:.4f}" for value in row) for row in zip(*held.values(), strict=True)),
    ]
    (folder / "commands.csv").write_text("\n".join(lines))

    def session(path: Path) -> object:
        return inspect(load_session(path), arm)

    return {
        "parquet": (folder / "run.parquet", session),
        "csv": (folder / "run.csv", session),
        "npz": (folder / "run.npz", session),
        "session.toml": (folder / "session.toml", load_session_file),
        "urdf": (folder / "robot.urdf", lambda path: ArmModel.load(str(path))),
        "diagnosis.json": (folder / "diagnosis.json", lambda path: Diagnosed.load(path).fit_to(arm)),
        "model.toml": (folder / "model/model.toml", lambda path: HybridModel.load(path.parent)),
        "commands.csv": (folder / "commands.csv", lambda path: read_commands(path, arm)),
    }


def one_input(path: Path, original: bytes, rng: np.random.Generator, read: Callable[[Path], object]) -> tuple[str, str]:
    """Spoils a file in its place, reads it; returns the outcome and its evidence."""
    kinds = BY_KIND[path.suffix[1:]]
    data = original
    for _ in range(int(rng.integers(1, 3))):
        data = kinds[int(rng.integers(len(kinds)))](data, rng)
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.alarm(HANG_S)
    try:
        with warnings.catch_warnings(record=True) as caught, contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("always", RuntimeWarning)
            read(path)
        runtime = [one for one in caught if issubclass(one.category, RuntimeWarning)]
        outcome = ("warning", str(runtime[0].message)) if runtime else ("read", "")
    except InputError as error:
        outcome = ("told", "") if len(str(error).splitlines()) == 1 else ("many lines", str(error))
    except Hang:
        outcome = ("hang", traceback.format_exc())
    except (MemoryError, Exception):
        outcome = ("traceback", traceback.format_exc())
    finally:
        signal.alarm(0)
    if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before > GROWTH_KB:
        outcome = ("growth", outcome[1])
    return outcome


def fuzz(seconds: float, seed: int, keep: Path) -> Counter[tuple[str, str]]:
    """Goes through the kinds in turn until the time is up."""
    found: Counter[tuple[str, str]] = Counter()
    told: set[str] = set()

    def ring(number: int, frame: FrameType | None) -> None:
        raise Hang

    signal.signal(signal.SIGALRM, ring)
    with tempfile.TemporaryDirectory() as place:
        files = corpus(Path(place))
        originals = {kind: path.read_bytes() for kind, (path, _) in files.items()}
        end, number = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            kind = list(files)[number % len(files)]
            path, read = files[kind]
            outcome, evidence = one_input(path, originals[kind], np.random.default_rng([seed, number]), read)
            found[kind, outcome] += 1
            if outcome not in ("read", "told"):
                last = evidence.strip().splitlines()[-2:] or [""]
                if "".join(last) not in told:
                    told.add("".join(last))
                    keep.mkdir(parents=True, exist_ok=True)
                    shutil.copy(path, keep / f"{kind}_{seed}_{number}{path.suffix}")
                    (keep / f"{kind}_{seed}_{number}.txt").write_text(evidence)
                    print(f"{kind} {outcome} ({seed}, {number}): {last}", flush=True)
            path.write_bytes(originals[kind])
            number += 1
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=secrets.randbits(32))
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"))
    options = parser.parse_args()
    found = fuzz(options.seconds, options.seed, options.keep)
    outcomes = ["read", "told", "traceback", "hang", "growth", "many lines", "warning"]
    print(f"seed {options.seed}: {sum(found.values())} inputs")
    print(f"{'kind':<16}" + "".join(f"{outcome:>12}" for outcome in outcomes))
    for kind in dict.fromkeys(kind for kind, _ in found):
        print(f"{kind:<16}" + "".join(f"{found[kind, outcome]:>12}" for outcome in outcomes))
    print(json.dumps({f"{kind} {outcome}": count for (kind, outcome), count in found.items()}))
    sys.exit(1 if any(outcome not in ("read", "told") for _, outcome in found) else 0)


if __name__ == "__main__":
    main()
