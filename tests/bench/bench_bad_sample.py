"""One bad sample anywhere: what a session is after mending, and what it is diagnosed as, against the clean session.

    python tests/bench/bench_bad_sample.py FOLDER [--draws 1000] [--diagnoses 12] [--first 0] [--seed 0]

FOLDER holds sessions, and `robot.urdf` or sessions that name their robot. A draw spoils one cell of one run: channel,
joint, row and size. Laws: the mended session differs from the clean one at the spoilt row and its neighbours only, and
nothing is refused (a millionth to a million millions of the channel's spread, either sign, NaN or infinite); and the
diagnosis has the verdict and the named classes of the clean one (from three times the channel's noise to a million
times its spread, NaN or infinite). Draw k of the diagnoses depends on the seed and on k alone: a long run may be made
in pieces; the clean sessions' outcomes wait for the next one in FOLDER/clean.json (remove it where the code changed).
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from pathlib import Path

import numpy as np

from ident.api.diagnosing import diagnose
from ident.checks.inspection import inspect_alone
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.sessions import load_robot

CHANNELS = ("effort", "position", "velocity", "time")
# Rows on each side of the spoilt one that may be different too: a spike's neighbours stand out with it.
NEIGHBOURS = 2
SMALLEST, LARGEST = -6.0, 12.0
# Of the diagnoses: times the channel's noise, and times its spread.
LEAST_NOISES, MOST_SPREADS = 3.0, 1e6
# What is held against the clean session's.
PARTS = ("verdict", "named classes", "first names with the joints where they show")


def noise_of(values: np.ndarray) -> float:
    """Standard deviation of what changes from sample to sample, by the median of the second differences."""
    return float(np.median(np.abs(np.diff(values, 2)))) / (0.6745 * np.sqrt(6.0))


def spoil(session: Session, rng: np.random.Generator, visibly: bool = False) -> tuple[Session, str, int, int]:
    """A session with one bad cell, what it is, and in which run and row."""
    at = int(rng.integers(len(session.runs)))
    run = session.runs[at]
    channel = str(rng.choice([name for name in CHANNELS if name == "time" or name in run.channels()]))
    row, joint = int(rng.integers(len(run))), int(rng.integers(len(run.joints)))
    values = np.array(run.time if channel == "time" else run.channels()[channel])
    cell = row if channel == "time" else (row, joint)
    spread = float(np.std(values[:, joint] if values.ndim == 2 else np.diff(values)))
    spread = max(spread, 1e-9)
    decades = SMALLEST, LARGEST
    if visibly:
        noise = noise_of(values[:, joint] if values.ndim == 2 else values)
        decades = np.log10(max(LEAST_NOISES * noise, 1e-6 * spread) / spread), np.log10(MOST_SPREADS)
    size = float(rng.choice([-1.0, 1.0])) * 10.0 ** rng.uniform(*decades) * spread
    kind = rng.random()
    values[cell] = np.nan if kind < 0.05 else np.inf if kind < 0.1 else values[cell] + size
    spoilt = run.replace(**{channel: values})
    words = f"{session.name}/{run.name} {channel} of {run.joints[joint]}, row {row}: {values[cell]:.4g}"
    return session.replace(runs=[spoilt if k == at else one for k, one in enumerate(session.runs)]), words, at, row


def difference(clean: Session, mended: Session, run: int, row: int) -> str:
    """Why the mended session is not the clean one but for one row and its neighbours; nothing where it is."""
    before = {name: one for one in clean.runs for name in [one.name]}
    spoilt = clean.runs[run]
    after: dict[str, list[Recording]] = {}
    for one in mended.runs:
        # A run that is cut where a row fell out goes on under a name of its own.
        origin = max((name for name in before if one.name.startswith(name)), key=len, default="")
        after.setdefault(origin, []).append(one)
    if set(after) != set(before):
        return f"runs {sorted(set(after) ^ set(before))}"
    for name, pieces in after.items():
        time_after = np.concatenate([piece.time for piece in pieces])
        rows = np.searchsorted(before[name].time, time_after)
        rows = np.clip(rows, 0, len(before[name]) - 1)
        near = np.zeros(len(before[name]), dtype=bool)
        if before[name] is spoilt:
            near[max(0, row - NEIGHBOURS) : row + NEIGHBOURS + 1] = True
        lost = np.ones(len(near), dtype=bool)
        lost[rows] = False
        if (lost & ~near).any():
            return f"{(lost & ~near).sum()} other rows of {name} are lost"
        for channel, values in before[name].channels().items():
            if any(channel not in piece.channels() for piece in pieces):
                return f"{channel} is dropped"
            found = np.concatenate([piece.channels()[channel] for piece in pieces])
            off = (found != values[rows]).any(axis=1) & ~near[rows]
            if off.any():
                return f"{channel} of {name} differs in {off.sum()} other rows"
    return ""


def check_mending(sessions: list[Session], arms: list[ArmModel], draws: int, rng: np.random.Generator) -> None:
    cleans = [inspect_alone(session, arm) for session, arm in zip(sessions, arms, strict=True)]
    told: Counter[str] = Counter()
    bad = 0
    for _ in range(draws):
        k = int(rng.integers(len(sessions)))
        spoilt, words, run, row = spoil(sessions[k], rng)
        report = inspect_alone(spoilt, arms[k])
        fatal = [issue.issue for issue in report.fatal if issue not in cleans[k].fatal]
        why = f"refused: {fatal[0]}" if fatal else difference(cleans[k].session, report.session, run, row)
        channel = words.split()[1]
        told[f"{channel} {'kept' if not why else 'changed'}"] += 1
        if why:
            bad += 1
            print(f"{words}: {why}", flush=True)
    print(f"mending: {draws - bad} of {draws} draws leave all else as it is; {dict(told)}")


def check_diagnoses(sessions: list[Session], arms: list[ArmModel], numbers: range, seed: int, kept: Path) -> None:
    same, channels = Counter[str](), Counter[str]()
    clean: dict[str, list[object]] = json.loads(kept.read_text()) if kept.is_file() else {}
    for number in numbers:
        rng = np.random.default_rng([seed, number])
        k = int(rng.integers(len(sessions)))
        name = sessions[k].name
        if name not in clean:
            clean[name] = outcome(sessions[k], arms[k])
            kept.write_text(json.dumps(clean))
        spoilt, words, _, _ = spoil(sessions[k], rng, visibly=True)
        found = outcome(spoilt, arms[k])
        # A cause names its class; which of those that nothing tells apart stands first may turn on a hair.
        alike = [part for part, one, other in zip(PARTS, found, clean[name], strict=True) if one == other]
        same.update(alike)
        channels[words.split()[1]] += 1
        print(f"{number} {words}: {'same' if found == clean[name] else f'{found}, clean {clean[name]}'}", flush=True)
    told = ", ".join(f"{part} {same[part]}" for part in PARTS)
    print(f"diagnoses of {len(numbers)} draws as of the clean session: {told}; {dict(channels)}")


def outcome(session: Session, arm: ArmModel) -> list[object]:
    """What `PARTS` says."""
    found = diagnose(session, arm).to_dict()
    classes = sorted(sorted(one["class"]) for one in found["findings"])
    return [found["verdict"], classes, sorted(f"{one['effect']} {one['joints']}" for one in found["findings"])]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--diagnoses", type=int, default=12)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw that is diagnosed")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    urdf = options.folder / "robot.urdf"
    places = sorted(path for path in options.folder.iterdir() if path.is_dir())
    sessions = [load_session(path) for path in places]
    arms = [load_robot(urdf if urdf.is_file() else None, [session]) for session in sessions]
    begun = time.process_time()
    check_mending(sessions, arms, options.draws, np.random.default_rng(options.seed))
    numbers = range(options.first, options.first + options.diagnoses)
    check_diagnoses(sessions, arms, numbers, options.seed, options.folder / "clean.json")
    print(f"{time.process_time() - begun:.0f} s of processor time")


if __name__ == "__main__":
    main()
