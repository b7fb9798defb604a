"""Wrong mounts and gains of real arms: which are found, how near, and whether they are said first.

A recording is read with a URDF whose base is turned, or with one joint's torque multiplied. Turns below those of a
mount are the diagnosis' own, a tilt.

    python -m tests.bench.bench_mounts mounts FOLDER SEED [SESSION …]   # 30 random turns, evenly over all of them
    python -m tests.bench.bench_mounts tilts FOLDER SEED [SESSION …]    # 6 turns of 4 to 19 degrees, about level axes
    python -m tests.bench.bench_mounts gains FOLDER SEED [SESSION …]    # 0.5, 0.7, 0.9, 1.1, 1.3, 1.5 at each joint

FOLDER holds the recordings (`ident.simulation.real.sources`), SESSION is a name among these.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ident.arrays import Array
from ident.checks.effort import collect_states
from ident.checks.inspection import inspect_alone
from ident.checks.report import MISREAD
from ident.checks.scales import fit_scale
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.laws.acting import turned_gravity
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.simulation.real.sources import load_sources

GAINS = (0.5, 0.7, 0.9, 1.1, 1.3, 1.5)
TILT = "gravity_misalignment"
NEAR = 3.0  # how far a found direction may be off [degrees]


def angle_between(a: Array, b: Array) -> float:
    """Angle between two directions [degrees]."""
    cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def found_gravity(session: Session, arm: ArmModel) -> Array:
    """Gravity as the diagnosis reports it: of the mount, turned by a tilt where it names one [m/s²]."""
    report = inspect_alone(session, arm)
    mounted = report.session.gravity
    gravity = np.array(arm.model.gravity.linear if mounted is None else mounted)
    for finding in diagnose_reports([report], arm, CATALOGUE)[0].findings:
        if finding.effect == TILT:
            return turned_gravity(gravity, {name: one.value for name, one in finding.estimate.parameters.items()})
    return gravity


def turned(session: Session, arm: ArmModel, turns: Rotation) -> None:
    """One row a turn: the turn, whether the check reports it, and how far what is found is off."""
    true, usual = np.array(arm.model.gravity.linear), {one.issue for one in inspect_alone(session, arm).fatal}
    own = angle_between(found_gravity(session, arm), true)
    print(f"{session.name}: as it is {own:.1f} degrees are named", flush=True)
    counts: Counter[str] = Counter()
    for turn in turns:
        wrong = arm.with_gravity(turn.apply(true))
        report = inspect_alone(session, wrong)
        refused = {one.issue for one in report.fatal} - usual
        mounted = report.session.gravity is not None
        gravity = np.array(report.session.gravity) if mounted else found_gravity(session, wrong)
        off = angle_between(gravity, true)
        counts.update(turns=1, mounts=mounted, refused=bool(refused), near=off <= NEAR)
        if not mounted or off > NEAR:
            kind = "mount" if mounted else "tilt"
            print(f"  {kind} of {np.degrees(turn.magnitude()):.1f}: off by {off:.2f} {' '.join(refused)}", flush=True)
    print(f"{session.name}: {dict(counts)}", flush=True)


def scaled(session: Session, arm: ArmModel) -> None:
    """Of the joints that carry load, and of the light ones: how many factors are said, said first, and held."""
    base = inspect_alone(session, arm).session
    states = collect_states(base, arm.keeping(base.joints))
    loaded = states.heavy & states.alive & states.moving
    counts: dict[bool, Counter[str]] = {True: Counter(), False: Counter()}
    for j, joint in enumerate(base.joints):
        own, error, _ = fit_scale(states, j)
        for gain in GAINS:
            factors = np.where(np.arange(len(base.joints)) == j, gain, 1.0)
            wrong = base.replace(runs=tuple(run.replace(effort=run.effort * factors) for run in base.runs))
            report = inspect_alone(wrong, arm)
            issue = report.find(MISREAD)
            said = bool(issue) and joint in issue[0].joints
            row = counts[bool(loaded[j])]
            row.update(all=1, said=said, refused=bool(report.fatal))
            if said:
                row["first"] += report.issues[0].issue == MISREAD and issue[0].joints[0] == joint
                values = re.search(rf"{re.escape(joint)} reads ([\d.]+) ± ([\d.]+)", issue[0].evidence)
                row["held"] += values is not None and abs(float(values[1]) - gain * own) <= float(values[2]) + 0.006
            elif loaded[j]:
                seen = f"own {own:.2f} ± {2 * error:.2f}, would read {gain * own:.2f}"
                print(f"  silent: {joint} x {gain}, {seen}; {[one.issue for one in report.issues]}", flush=True)
    for heavy, row in counts.items():
        print(f"{session.name}, {'loaded' if heavy else 'light'} joints: {dict(row)}", flush=True)


def main(job: str, folder: str, seed: str, *names: str) -> None:
    rng = np.random.default_rng(int(seed))
    for source in load_sources(Path(folder)):
        if names and source.name not in names:
            continue
        session, arm = Session(source.name, source.runs), ArmModel.from_urdf(source.urdf)
        if job == "gains":
            scaled(session, arm)
            continue
        around = rng.uniform(-np.pi, np.pi, 6)
        axes = np.column_stack([np.cos(around), np.sin(around), np.zeros(6)])
        small = Rotation.from_rotvec(axes * np.radians(np.linspace(4.0, 19.0, 6))[:, None])
        turned(session, arm, small if job == "tilts" else Rotation.random(30, rng=rng))


if __name__ == "__main__":
    main(*sys.argv[1:])
