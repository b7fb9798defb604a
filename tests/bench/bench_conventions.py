"""Random conventions of logs and URDFs: how often the search finds what was changed, and what it costs.

Of each log one to three conventions are changed, in the log or in the URDF. Two readings that explain the same torque
as well are the same: a turn of joint 1 of an upright arm, the direction of a joint whose links look alike both ways.

    python -m tests.bench.bench_conventions FOLDER CASES SEED     # FOLDER: recordings of real arms
    python -m tests.bench.bench_conventions untouched FOLDER SEED # stretches of the same, as they are
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.checks.conventions.find import is_changed, search_conventions
from ident.checks.conventions.hypothesis import COMPENSATED, UNITS, ZEROS, Hypothesis
from ident.checks.conventions.masses import cost_at, read_as
from ident.checks.conventions.readings import Log, Model
from ident.checks.filtered_run import filter_run
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.simulation.real.sources import load_sources

GRAVITY = 9.81
STATES = ("q", "dq", "ddq", "tau")
# By how much more must be left for a change to be seen, and for two hypotheses to be one [nats]; share of a torque's
# variance below which nothing is.
VISIBLE, SAME, FLOOR = 3.0, 0.5, 1e-3
SOUND = 1.25  # factor by which a sound URDF's torques are off at most
LEAST_STATES = 200  # of a stretch
SIMULATED = ("panda", "ur3", "ur5", "ur10", "z1", "xarm7", "kinova", "baxter:left_w2", "so101", "tm5-900")
KINDS = (
    "order",
    "effort_order",
    "direction",
    "zero",
    "unit",
    "unit_of_one",
    "effort_sign",
    "effort_sign_of_one",
    "gravity",
    "compensated",
    "mass_factor",
    "effort_scale",
    "body",
)
FACTORS = (1e-3, 1e3, 1.9, 1.0 / 1.9, 2.5, 0.4)
SCALES = (10.0, 100.0, 0.05, 1000.0)


@dataclass(frozen=True)
class Case:
    """A log, its arm, and where they come from."""

    name: str
    arm: ArmModel
    log: Log
    sizes: Array  # of each joint's torque over the model's

    @property
    def is_sound(self) -> bool:
        """Whether the URDF's masses explain the torque as they are: only then a change of theirs is known."""
        return bool(np.abs(np.log(self.sizes)).max() < np.log(SOUND))


def case_of(name: str, arm: ArmModel, log: Log) -> Case:
    """A case, with the sizes of its torques."""
    reading = read_as(log.thinned(240), Model(arm), Hypothesis.as_it_is(arm.n))
    return Case(name, arm, log, cost_at(reading, reading.rigid).plain_sizes)


def log_of(session: Session) -> Log | None:
    """The filtered states of all runs."""
    motions = [motion for run in session.runs if (motion := filter_run(run)) is not None]
    if not motions:
        return None
    return Log(*(np.concatenate([getattr(motion, name) for motion in motions]) for name in ("q", "dq", "ddq", "tau")))


def simulated(name: str, rng: np.random.Generator) -> Case:
    """States of an arm that moves and rests, with friction, rotors, noise, and links that its URDF has a little off."""
    arm = ArmModel.load(name)
    n, count = arm.n, 1200
    t = np.arange(count) / 25.0
    limits = arm.known_limits
    low, high = np.maximum(limits.lower, -2.0), np.minimum(limits.upper, 2.0)
    reach, middle = 0.45 * (high - low), 0.5 * (high + low)
    pulse = rng.uniform(0.3, 1.6, (4, n))
    phase = rng.uniform(0.0, 2.0 * np.pi, (4, n))
    size = rng.uniform(0.5, 1.0, (4, n)) / pulse
    size = size / size.sum(axis=0) * reach
    angle = pulse * t[:, None, None] + phase
    q = middle + (size * np.sin(angle)).sum(axis=1)
    dq = (size * pulse * np.cos(angle)).sum(axis=1)
    ddq = -(size * pulse**2 * np.sin(angle)).sum(axis=1)
    resting = (t % 12.0) > 11.0
    dq[resting], ddq[resting] = 0.0, 0.0
    true = arm.with_inertial_parameters(arm.inertial_parameters * rng.lognormal(0.0, 0.05, 10 * n))
    torque = true.inverse_dynamics(q, dq, ddq)
    scale = np.maximum(arm.weight_in_poses.std(axis=0), 0.05 * arm.weight_in_poses.std(axis=0).max())
    inertia = arm.mean_inertia(q[::50])
    torque += 0.3 * scale * np.tanh(dq / 0.01) + 0.2 * scale * dq + inertia * rng.uniform(0.2, 1.0, n) * ddq
    torque += 0.02 * scale * rng.standard_normal(q.shape)
    return case_of(f"simulated_{name}", arm, Log(q, dq, ddq, torque))


def logs(folder: Path, rng: np.random.Generator) -> list[Case]:
    """Recordings of real arms, the shipped ones, and simulated arms of example-robot-data."""
    cases = []
    for source in load_sources(folder):
        log = log_of(Session(source.name, source.runs))
        if log is not None:
            cases.append(case_of(source.name, ArmModel.from_urdf(source.urdf).keeping(source.joints), log))
    for name in ("E1", "T1"):
        log = log_of(load_session(data_path(f"logs/tm5_900/{name}")))
        if log is not None:
            cases.append(case_of(f"tm5_{name}", ArmModel.load("tm5-900"), log))
    return cases + [simulated(name, rng) for name in SIMULATED]


def draw(case: Case, kinds: list[str], rng: np.random.Generator) -> Hypothesis:
    """A reading that undoes what is to be changed: the truth."""
    n, turning = case.arm.n, np.flatnonzero(~case.arm.sliding_joints)
    truth = Hypothesis.as_it_is(n)
    for kind in kinds:
        joint = int(rng.choice(turning))
        if kind == "order":
            order = list(range(n))
            if rng.uniform() < 0.5 or n < 3:
                i, j = rng.choice(n, 2, replace=False)
                order[i], order[j] = order[j], order[i]
            else:
                order = [int(k) for k in np.argsort(case.arm.joint_names)]
                order = order[::-1] if order == sorted(order) else order
            truth = replace(truth, order=tuple(order), effort_order=tuple(order))
        elif kind == "effort_order":
            order = list(truth.effort_order)
            i, j = rng.choice(n, 2, replace=False)
            order[i], order[j] = order[j], order[i]
            truth = replace(truth, effort_order=tuple(order))
        elif kind == "direction":
            truth = truth.with_entry("direction", joint, -1)
        elif kind == "zero":
            truth = truth.with_entry("quarters", joint, int(rng.integers(1, 4)))
        elif kind == "unit":
            truth = replace(truth, unit=(str(rng.choice(["deg", "turns"])),) * n)
        elif kind == "unit_of_one":
            truth = truth.with_entry("unit", joint, "deg")
        elif kind == "effort_sign":
            truth = replace(truth, effort_sign=(-1,) * n)
        elif kind == "effort_sign_of_one":
            truth = truth.with_entry("effort_sign", joint, -1)
        elif kind == "gravity":
            x, y, z = (float(value) for value in case.arm.model.gravity.linear)
            truth = replace(truth, gravity=(x, y, z))
        elif kind == "compensated":
            truth = replace(truth, gravity=COMPENSATED)
        elif kind == "mass_factor":
            truth = replace(truth, mass_factor=float(rng.choice(FACTORS)))
        elif kind == "effort_scale":
            truth = replace(truth, effort_scale=((joint, float(rng.choice(SCALES))),))
        elif kind == "body":
            mass = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.1, 0.3) * arm_mass(case.arm)
            place = rng.uniform(-0.1, 0.1, 3) + 0.1 * np.sign(rng.standard_normal(3))
            truth = replace(truth, body=(mass, *(float(mass * x) for x in place)))
    return truth


def arm_mass(arm: ArmModel) -> float:
    """Mass of the moving links [kg]."""
    return float(arm.inertial_parameters[::10].sum())


def spoil(case: Case, truth: Hypothesis, rng: np.random.Generator) -> tuple[Log, ArmModel]:
    """The log and the URDF that the truth, read of them, makes those of the case."""
    q, dq, ddq, tau = (np.zeros_like(case.log.q) for _ in range(4))
    torque = np.array(case.log.tau)
    if truth.gravity == COMPENSATED:  # as large as it is in the recording, whatever the URDF's masses are
        torque -= case.sizes * case.arm.gravity(case.log.q)
    for joint, scale in truth.effort_scale:
        torque[:, joint] *= scale
    for j, (column, effort) in enumerate(zip(truth.order, truth.effort_order, strict=True)):
        factor = truth.direction[j] * UNITS.get(truth.unit[j], 1.0)
        q[:, column] = (case.log.q[:, j] - ZEROS[truth.quarters[j]]) / factor
        dq[:, column], ddq[:, column] = case.log.dq[:, j] / factor, case.log.ddq[:, j] / factor
        tau[:, effort] = truth.direction[j] * truth.effort_sign[j] * torque[:, j]
    arm, parameters = case.arm, np.array(case.arm.inertial_parameters)
    if truth.body is not None:
        parameters[-10:-6] -= np.array(truth.body)
    arm = arm.with_inertial_parameters(parameters / truth.mass_factor)
    if not isinstance(truth.gravity, str):
        own = np.array(truth.gravity) / GRAVITY
        axes = [axis for axis in np.concatenate([np.eye(3), -np.eye(3)]) if axis @ own < 0.9]
        arm = arm.with_gravity(GRAVITY * axes[int(rng.integers(len(axes)))])
    return Log(q, dq, ddq, tau), arm


def residual(log: Log, model: Model, hypothesis: Hypothesis) -> Array:
    """What a hypothesis leaves of each joint's torque, friction and rotor projected out, shape (n, T)."""
    reading = read_as(log, model, hypothesis)
    tau = reading.tau.copy()
    for joint, scale in hypothesis.effort_scale:
        tau[joint] /= scale
    body = 0.0 if hypothesis.body is None else reading.body @ np.array(hypothesis.body)
    return np.asarray(tau - reading.rigid - body)


def more_left(log: Log, model: Model, one: Hypothesis, other: Hypothesis) -> float:
    """By how much more of the torque a hypothesis leaves than another, all joints together [nats].

    Friction and rotor are free, of either sign: what is compared is the rigid torque alone.
    """
    left = [(residual(log, model, each) ** 2).mean(axis=1) for each in (one, other)]
    floor = FLOOR * log.tau.var(axis=0)[list(other.effort_order)] + 1e-12
    return float(np.log((left[0] + floor) / (left[1] + floor)).sum())


def without(truth: Hypothesis, name: str) -> Hypothesis:
    """The truth but for one of its changes."""
    plain = Hypothesis.as_it_is(len(truth.order))
    kind, _, joint = name.partition(" ")
    field = {"zero": "quarters"}.get(kind, kind)
    if kind == "order":
        kept = {truth.order[j]: j for j in range(len(truth.order))}
        efforts = tuple(kept[column] for column in truth.effort_order)
        return replace(truth, order=plain.order, effort_order=efforts)
    if kind == "effort_order":
        return replace(truth, effort_order=truth.order)
    if kind == "effort_scale":
        return replace(truth, effort_scale=())
    if joint:
        return truth.with_entry(field, int(joint), getattr(plain, field)[int(joint)])
    return replace(truth, **{field: getattr(plain, field)})


def is_visible(log: Log, model: Model, truth: Hypothesis) -> bool:
    """Whether the torque without any one of the changes is explained worse by as much as is asked for to be sure.

    The unit of an effort that is friction and rotor alone shows nowhere: both have any size.
    """
    if any(more_left(log, model, without(truth, name), truth) < VISIBLE for name in truth.changes):
        return False
    left = np.sqrt((residual(log, model, truth) ** 2).mean(axis=1))
    rigid = np.sqrt((read_as(log, model, truth).rigid ** 2).mean(axis=1))
    return all(rigid[joint] > 2.0 * left[joint] for joint, _ in truth.effort_scale)


def is_same(log: Log, model: Model, found: Hypothesis, truth: Hypothesis, is_sound: bool) -> bool:
    """Whether two hypotheses say the same of the masses, where they are known, and mean the same torque beside."""
    masses = (
        []
        if not is_sound
        else [
            (found.mass_factor == 1.0) == (truth.mass_factor == 1.0)
            and 0.75 < found.mass_factor / truth.mass_factor < 1.33,
            [joint for joint, _ in found.effort_scale] == [joint for joint, _ in truth.effort_scale],
            (found.body is None) == (truth.body is None),
        ]
    )
    if is_sound and found.body is not None and truth.body is not None:
        masses.append(found.body[0] * truth.body[0] > 0.0)
    alike = replace(found, mass_factor=truth.mass_factor, effort_scale=truth.effort_scale, body=truth.body)
    return all(masses) and (alike == truth or more_left(log, model, alike, truth) < SAME)


def bench(folder: Path, count: int, seed: int) -> None:
    """Draws cases and prints what was found, one line a miss, and the shares."""
    rng = np.random.default_rng(seed)
    cases = logs(folder, rng)
    arms = {case.name for case in cases}
    print(f"{len(cases)} logs: {', '.join(sorted(arms))}", flush=True)
    hits: Counter[str] = Counter()
    by_kind: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    seconds: list[float] = []
    drawn = 0
    while drawn < count:
        case = cases[int(rng.integers(len(cases)))]
        kinds = [str(kind) for kind in rng.choice(KINDS, int(rng.integers(1, 4)), replace=False)]
        if {"gravity", "compensated"} <= {*kinds} or len({"unit", "unit_of_one"} & {*kinds}) > 1:
            continue
        if not case.is_sound and {"mass_factor", "effort_scale", "body"} & {*kinds}:
            continue
        truth = draw(case, kinds, rng)
        spoilt, arm = spoil(case, truth, rng)
        model = Model(arm)
        thin = spoilt.thinned(240)
        if not is_visible(thin, model, truth):
            hits["invisible"] += 1
            continue
        drawn += 1
        start = time.process_time()
        found = search_conventions(spoilt, model)
        seconds.append(time.process_time() - start)
        first = is_same(thin, model, found.best.hypothesis, truth, case.is_sound)
        second = found.second is not None and is_same(thin, model, found.second.hypothesis, truth, case.is_sound)
        hits.update(cases=1, first=first, among=first or second)
        for kind in kinds:
            by_kind[kind].update(cases=1, first=first, among=first or second)
        if drawn % 25 == 0:
            print(f"{drawn}: first {hits['first']}, among {hits['among']}", flush=True)
        hits.update({f"cases of {len(kinds)}": 1, f"first of {len(kinds)}": int(first)})
        if not (first or second):
            seen = found.best.hypothesis.changes
            print(f"  {case.name}: {kinds} -> {seen} ({found.best.cost:.1f}, as it is {found.as_it_is.cost:.1f})")
    print(dict(hits))
    for kind, each in by_kind.items():
        print(f"{kind:20s} {dict(each)}")
    print(f"first {hits['first'] / count:.3f}, among the two {hits['among'] / count:.3f}, cases {count}")
    print(f"processor seconds of a search: median {np.median(seconds):.2f}, most {max(seconds):.2f}")


def untouched(folder: Path, seed: int) -> None:
    """Stretches of recordings as they are: how many are read otherwise than they say."""
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    gains: list[float] = []
    for case in logs(folder, rng):
        model = Model(case.arm)
        edges = np.linspace(0, len(case.log.q), 1 + max(1, len(case.log.q) // LEAST_STATES)).astype(int)
        for begin, end in pairwise(edges):
            found = search_conventions(Log(*(getattr(case.log, name)[begin:end] for name in STATES)), model)
            changed = is_changed(found)
            counts.update(stretches=1, changed=changed)
            gains.append(found.gain)
            if changed or found.gain > 0.0:
                print(f"  {case.name} {begin}: {found.best.hypothesis.changes} gains {found.gain:.2f}", flush=True)
        print(f"{case.name}: {dict(counts)}", flush=True)
    print(dict(counts), f"largest gain {max(gains):.2f}")


def main() -> None:
    """Runs what is asked for."""
    if sys.argv[1] == "untouched":
        untouched(Path(sys.argv[2]), int(sys.argv[3]))
    else:
        bench(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))


if __name__ == "__main__":
    main()
