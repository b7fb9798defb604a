"""Logs whose conventions are known: recordings of real arms, the shipped ones, and simulated arms; each read once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.checks.conventions.find import log_of
from ident.checks.conventions.hypothesis import Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.products import amounts, cost_with, products_of, read_as
from ident.checks.conventions.readings import Log
from ident.checks.inspection import check_rows
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.simulation.real.sources import load_sources

SHIPPED = ("E1", "T1")
SIMULATED = ("panda", "ur3", "ur5", "ur10", "z1", "xarm7", "kinova", "baxter:left_w2", "so101", "tm5-900")
# States that the search sees at most; of more, evenly spread ones are kept here.
MOST_STATES = 480
# States of a stretch of a recording, at least.
LEAST_STATES = 150
# Factor by which a sound URDF's torques are off at most: only then a change of its masses is known.
SOUND = 1.25
# A simulated arm: states, seconds from one to the next, sinusoids a joint, and its noise over its gravity torque.
COUNT, INTERVAL, SINUSOIDS, NOISE = 1200, 0.04, 4, 0.02
# It rests for the last second of every twelve.
PERIOD_S, REST_FROM_S = 12.0, 11.0


@dataclass(frozen=True, eq=False)
class Case:
    """A log, its arm, and where they come from."""

    name: str
    group: str  # the physical arm: what is left out together
    arm: ArmModel
    log: Log
    sizes: Array  # of each joint's torque over the model's, shape (n,)

    @property
    def is_sound(self) -> bool:
        """Whether the URDF's masses explain the torque as they are."""
        return bool(np.abs(np.log(self.sizes)).max() < np.log(SOUND))


def case_of(name: str, group: str, arm: ArmModel, log: Log) -> Case:
    """A case, with the sizes of its torques."""
    reading = read_as(log.thinned(MOST_STATES), Model(arm), Hypothesis.as_it_is(arm.n))
    return Case(name, group, arm, log, cost_with(products_of(reading), amounts(1.0)).plain_sizes)


def load_cases(folder: Path, rng: np.random.Generator) -> list[Case]:
    """Recordings of real arms below a folder, the shipped ones, and simulated arms of example-robot-data."""
    cases = []
    for source in load_sources(folder):
        arm = ArmModel.from_urdf(source.urdf).keeping(source.joints)
        session, _ = check_rows(Session(source.name, source.runs), arm)  # the search sees what the checks left
        log = log_of(session)
        if log is not None:
            cases.append(case_of(source.name, source.arm, arm, log))
    for name in SHIPPED:
        log = log_of(load_session(data_path(f"logs/tm5_900/{name}")))
        if log is not None:
            cases.append(case_of(f"tm5_{name}", "tm5-900", ArmModel.load("tm5-900"), log))
    return cases + [simulate(name, rng) for name in SIMULATED]


def case_of_session(name: str, group: str, folder: Path, urdf: Path) -> Case | None:
    """A stored session and its URDF; None where too little of it is left to see anything."""
    session = load_session(folder)
    arm = ArmModel.from_urdf(urdf.read_text(encoding="utf-8")).keeping(session.joints)
    session, _ = check_rows(session, arm)
    log = log_of(session)
    return None if log is None else case_of(name, group, arm, log)


def simulate(name: str, rng: np.random.Generator) -> Case:
    """States of an arm that moves and rests, with friction, rotors, noise, and links that its URDF has a little off."""
    arm = ArmModel.load(name)
    n = arm.n
    t = np.arange(COUNT) * INTERVAL
    limits = arm.known_limits
    low, high = np.maximum(limits.lower, -2.0), np.minimum(limits.upper, 2.0)
    reach = 0.45 * (high - low)
    pulse = rng.uniform(0.3, 1.6, (SINUSOIDS, n))
    phase = rng.uniform(0.0, 2.0 * np.pi, (SINUSOIDS, n))
    size = rng.uniform(0.5, 1.0, (SINUSOIDS, n)) / pulse
    size = size / size.sum(axis=0) * reach
    angle = pulse * t[:, None, None] + phase
    q = 0.5 * (low + high) + (size * np.sin(angle)).sum(axis=1)
    dq = (size * pulse * np.cos(angle)).sum(axis=1)
    ddq = -(size * pulse**2 * np.sin(angle)).sum(axis=1)
    resting = (t % PERIOD_S) > REST_FROM_S
    dq[resting] = 0.0
    ddq[resting] = 0.0
    true = arm.with_inertial_parameters(arm.inertial_parameters * rng.lognormal(0.0, 0.05, 10 * n))
    torque = true.inverse_dynamics(q, dq, ddq)
    gravity = arm.weight_in_poses.std(axis=0)
    scale = np.maximum(gravity, 0.05 * gravity.max())
    torque += 0.3 * scale * np.tanh(dq / 0.01) + 0.2 * scale * dq
    torque += arm.mean_inertia(q[::50]) * rng.uniform(0.2, 1.0, n) * ddq
    torque += NOISE * scale * rng.standard_normal(q.shape)
    return case_of(f"simulated_{name}", name.partition(":")[0], arm, Log(q, dq, ddq, torque))


def stretches(case: Case) -> Iterator[tuple[int, Log]]:
    """Stretches of a log one after the other, each with its first state's place."""
    count = max(1, len(case.log.q) // LEAST_STATES)
    edges = np.linspace(0, len(case.log.q), 1 + count).astype(int)
    for begin, end in pairwise(edges):
        rows = slice(int(begin), int(end))
        yield int(begin), Log(case.log.q[rows], case.log.dq[rows], case.log.ddq[rows], case.log.tau[rows])
