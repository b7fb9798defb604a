"""Careless logs: faults of scale, sign, zero, arm and clock put into sound sessions, and what is said of them.

Of each session every variant is made and inspected. An answer is right where a finding that the untouched session does
not have names the fault by one of its kinds, at its joint or in its run; unclear where it names the joint or the run by
another kind, or the kind alone; wrong where all that is new names something else; silent where nothing is new.

    python -m tests.bench.bench_careless FOLDER [VARIANT …] [--logs NAME,…]

FOLDER holds recordings of real arms. What is printed last are rows of `docs/figures.toml`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.checks.inspection import inspect_sessions
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.simulation.real.sources import load_sources
from ident.simulation.simulate import SimulationOptions, simulate

SIMULATED = ("tm5-900", "ur5", "panda")
SHIPPED = ("E1", "T1")
SLOW_HZ = 10.0
FAST_HZ = 100.0
LATE_S = 0.1
ZERO_RAD = 0.3
SMALL_ZERO_RAD = 0.1
FEWEST_RUNS = 3

Change = Callable[[Recording], Recording]


@dataclass(frozen=True, eq=False)
class Log:
    """A sound session and its arm."""

    name: str
    arm: ArmModel
    session: Session


@dataclass(frozen=True, eq=False)
class Fault:
    """A session with a fault, and what says it rightly."""

    session: Session
    kinds: tuple[str, ...]  # issues that name it
    joints: tuple[str, ...] = ()  # joints that a right answer names one of
    runs: tuple[str, ...] = ()  # words, of runs mostly, that a right answer says one of


def of_joint(run: Recording, joint: int, channel: str, change: Callable[[Array], Array]) -> Recording:
    """A run with one joint's channel changed."""
    values = np.array(getattr(run, channel))
    values[:, joint] = change(values[:, joint])
    return run.replace(**{channel: values})


def scaled(joint: int, factor: float) -> Change:
    """One joint's torque times a factor."""
    return lambda run: of_joint(run, joint, "effort", lambda effort: factor * effort)


def constant(joint: int) -> Change:
    """One joint's torque held at its mean, another in every run."""
    return lambda run: of_joint(run, joint, "effort", lambda effort: np.full_like(effort, effort.mean()))


def late(run: Recording) -> Recording:
    """All torques late against all else."""
    effort = [np.interp(run.time - LATE_S, run.time, column) for column in run.effort.T]
    return run.replace(effort=np.column_stack(effort))


def shifted(joint: int, angle: float) -> Change:
    """One joint's zero moved."""
    return lambda run: of_joint(run, joint, "position", lambda position: position + angle)


def turned(joints: Sequence[int]) -> Change:
    """Torques of the other sign."""

    def change(run: Recording) -> Recording:
        sign = np.ones(len(run.joints))
        sign[list(joints)] = -1.0
        return run.replace(effort=sign * run.effort)

    return change


def exchanged(first: int, second: int) -> Change:
    """Two joints' columns in each other's place."""

    def change(run: Recording) -> Recording:
        order = list(range(len(run.joints)))
        order[first], order[second] = second, first
        return run.replace(**{name: values[:, order] for name, values in run.channels().items()})

    return change


def doubled(joint: int) -> Change:
    """A motor's angle where the joint's is meant: twice it, with its velocity."""

    def change(run: Recording) -> Recording:
        run = of_joint(run, joint, "position", lambda position: 2.0 * position)
        return run if run.velocity is None else of_joint(run, joint, "velocity", lambda velocity: 2.0 * velocity)

    return change


def summed(joint: int) -> Change:
    """A joint's angle counted from the base, as a parallelogram's: the joint's before it added."""

    def change(run: Recording) -> Recording:
        run = of_joint(run, joint, "position", lambda position: position + run.position[:, joint - 1])
        if run.velocity is None:
            return run
        before = run.velocity[:, joint - 1]
        return of_joint(run, joint, "velocity", lambda velocity: velocity + before)

    return change


def interpolated(run: Recording) -> Recording:
    """Logged at a slow rate, and brought to a faster one by straight lines."""
    slow = np.arange(run.time[0], run.time[-1], 1.0 / SLOW_HZ)
    fast = np.arange(slow[0], slow[-1], 1.0 / FAST_HZ)
    channels = {}
    for name, values in run.channels().items():
        taken = [np.interp(slow, run.time, column) for column in values.T]
        channels[name] = np.column_stack([np.interp(fast, slow, column) for column in taken])
    return Recording(run.name, run.joints, fast, **channels)


def halved_clock(run: Recording) -> Recording:
    """From the middle on, behind a gap of a second, the clock goes at half its speed."""
    middle = len(run) // 2
    stamps = np.array(run.time)
    stamps[middle:] = stamps[middle] + 1.0 + 0.5 * (stamps[middle:] - stamps[middle])
    return run.replace(time=stamps)


def each(session: Session, change: Change, runs: Sequence[int] | None = None) -> Session:
    """A session with all of its runs changed, or some."""
    chosen = range(len(session.runs)) if runs is None else runs
    changed = [change(run) if number in chosen else run for number, run in enumerate(session.runs)]
    return session.replace(runs=changed)


def heaviest(log: Log, after: int = 0) -> int:
    """Column of the joint, from some on, that gravity changes most."""
    position = np.concatenate([run.position for run in log.session.runs])
    change = log.arm.gravity(position[:: max(1, len(position) // 2000)]).std(axis=0)
    return int(after + np.argmax(change[after:]))


def stranger(log: Log, others: Sequence[Log]) -> Session | None:
    """A session of another arm with as many joints, under this one's names; None where there is none."""
    for other in others:
        same_count = len(other.session.joints) == len(log.session.joints)
        if same_count and other.arm.name != log.arm.name:
            runs = []
            for run in other.session.runs:
                channels = {name: getattr(run, name) for name in ("position", "velocity", "effort")}
                runs.append(Recording(run.name, log.session.joints, run.time, **channels))
            return other.session.replace(runs=runs)
    return None


def placed(run: Recording, before: Recording) -> Recording:
    """A run in another's place: its clock and its name."""
    return run.replace(time=run.time - run.time[0] + before.time[0], name=before.name)


def faults(log: Log, others: Sequence[Log]) -> dict[str, Fault]:
    """Every variant of a session that can be made of it."""
    session, joints = log.session, log.session.joints
    count, names = len(joints), [run.name for run in session.runs]
    wrist, last = min(3, count - 1), count - 1
    heavy = heaviest(log)
    scale = ("effort_not_torque", "torque_scale", "mass_factor")
    columns = ("columns_swapped", "runs_differ")
    late_kinds = ("effort_late", "velocity_inconsistent")
    found = {"untouched": Fault(session, ())}
    found["x10 at joint 4"] = Fault(each(session, scaled(wrist, 10.0)), scale, (joints[wrist],))
    found["x3 at the last"] = Fault(each(session, scaled(last, 3.0)), scale, (joints[last],))
    for joint in (heavy, last):
        place = "heaviest" if joint == heavy else "last"
        dead = ("stuck_channel", "effort_not_torque")
        found[f"constant, {place}"] = Fault(each(session, constant(joint)), dead, (joints[joint],))
    found["100 ms late"] = Fault(each(session, late), late_kinds)
    found["angle doubled"] = Fault(each(session, doubled(heavy)), ("angle_scale",), (joints[heavy],))
    found["10 to 100 Hz"] = Fault(each(session, interpolated), ("wrong_time_base",), (), ("straight lines",))
    found["clock halved"] = Fault(each(session, halved_clock), ("wrong_time_base", "clock_jump"))
    if heavy > 0:
        elbow = heaviest(log, heavy + 1) if heavy < last else heavy
        found["angle from the base"] = Fault(each(session, summed(elbow)), ("angle_coupled",), (joints[elbow],))
    if len(names) < FEWEST_RUNS:
        return found
    middle, half = len(names) // 2, range(len(names) // 2, len(names))
    differ = ("runs_differ",)
    zeros = {"zero moved": ZERO_RAD, "zero moved a little": SMALL_ZERO_RAD}
    for name, angle in zeros.items():
        moved = each(session, shifted(heavy, angle), half)
        kinds = (*differ, "zero_shifted")
        found[name] = Fault(moved, kinds, (joints[heavy],), tuple(names[middle - 1 :]))
    signs = (*differ, "effort_sign_flipped")
    only = (names[middle],)
    found["sign of a run"] = Fault(each(session, turned(range(count)), [middle]), signs, (), only)
    found["sign of a run's joint"] = Fault(each(session, turned([heavy]), [middle]), signs, (joints[heavy],), only)
    if count > 1:
        second = heavy + 1 if heavy < last else heavy - 1
        swapped = each(session, exchanged(heavy, second), [middle])
        found["columns of a run"] = Fault(swapped, columns, (joints[heavy],), only)
    other = stranger(log, others)
    if other is not None:
        runs = list(session.runs)
        runs[middle] = placed(other.runs[0], runs[middle])
        found["a run of another arm"] = Fault(session.replace(runs=runs), differ, (), only)
        runs = list(session.runs)
        for number in half:
            runs[number] = placed(other.runs[(number - middle) % len(other.runs)], runs[number])
        found["two arms"] = Fault(session.replace(runs=runs), differ, (), tuple(names))
    return found


def judge(fault: Fault, issues: Sequence[TelemetryIssue], before: Sequence[TelemetryIssue]) -> tuple[str, str]:
    """Right, unclear, wrong or silent, and what says so."""
    known = {(issue.issue, issue.joints) for issue in before if issue.severity != "note"}
    fresh = [issue for issue in issues if issue.severity != "note" and (issue.issue, issue.joints) not in known]
    if not fresh:
        return "silent", ""
    said = "; ".join(f"{issue.severity} {issue.issue} {','.join(issue.joints)}" for issue in fresh)
    if not fault.kinds:
        return "wrong", said
    answers = []
    for issue in fresh:
        kind = issue.issue in fault.kinds
        joint = not fault.joints or bool({*fault.joints} & {*issue.joints})
        run = not fault.runs or any(name in issue.evidence for name in fault.runs)
        answers.append(
            "right" if kind and joint and run else "unclear" if kind or (joint and fault.joints) else "wrong"
        )
    return next(answer for answer in ("right", "unclear", "wrong") if answer in answers), said


def logs(folder: Path) -> list[Log]:
    """Simulated sessions, the shipped ones, and those of real arms that are not kept back."""
    known = []
    for number, name in enumerate(SIMULATED):
        options = SimulationOptions(robot=name, seed=100 + number, runs=6, rate=125.0)
        known.append(Log(f"simulated {name}", ArmModel.load(name), simulate(options).session))
    for name in SHIPPED:
        session = load_session(data_path(f"logs/tm5_900/{name}"))
        known.append(Log(f"tm5 {name}", ArmModel.load("tm5-900"), session))
    for source in load_sources(folder):
        arm = ArmModel.from_urdf(source.urdf).keeping(source.joints)
        known.append(Log(source.name, arm, Session(source.name, source.runs)))
    return known


def answers_of(log: Log, others: Sequence[Log], wanted: set[str]) -> dict[str, str]:
    """What is said of each variant of a log: right, unclear, wrong or silent; printed as it comes."""
    (before,) = inspect_sessions([log.session], log.arm)
    answers = {}
    for name, fault in faults(log, others).items():
        if wanted and name not in wanted:
            continue
        issues = before.issues
        known: Sequence[TelemetryIssue] = ()
        if name != "untouched":
            issues = inspect_sessions([fault.session], log.arm)[0].issues
            known = before.issues
        answers[name], said = judge(fault, issues, known)
        print(f"{log.name:22s} {name:22s} {answers[name]:8s} {said[:160]}", flush=True)
    return answers


def main() -> None:
    """Makes, inspects and judges."""
    as_written = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=as_written)
    parser.add_argument("folder", type=Path)
    parser.add_argument("variants", nargs="*")
    parser.add_argument("--logs", default="", help="names of logs, with commas; all if not given")
    options = parser.parse_args()
    start = time.process_time()
    every = logs(options.folder)
    names = options.logs.split(",") if options.logs else [log.name for log in every]
    chosen = [log for log in every if log.name in names]
    columns = [answers_of(log, every, set(options.variants)) for log in chosen]
    print(json.dumps(["fault", *(log.name for log in chosen)]))
    for fault in dict.fromkeys(fault for answers in columns for fault in answers):
        print(json.dumps([fault, *(answers.get(fault, "") for answers in columns)]))
    print(f"{time.process_time() - start:.0f} s of processor time")


if __name__ == "__main__":
    main()
