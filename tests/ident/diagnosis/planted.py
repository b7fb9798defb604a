"""Recordings of a three-joint arm whose torque is written out here, so that what is wrong with it is known exactly."""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache

import numpy as np

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis, diagnose
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.inference.revision import evidence_of
from ident.inference.search import SetSearch
from ident.motion.motion import Motion
from ident.recordings.recording import Payload, Session
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions, made_session

COULOMB = np.array([6.0, 9.0, 5.0])  # [N m]
VISCOUS = np.array([8.0, 10.0, 4.0])  # [N m s/rad]
ROTOR = np.array([1.5, 1.5, 0.8])  # [kg m²]
NOISE = 0.3  # [N m], white, before the filter
SLIP = 0.002  # transition speed of Coulomb friction [rad/s]
# At the elbow's link: far more than the URDF's numbers may be off.
MASS = 12.0  # [kg]
LOAD = Payload(MASS, (0.0, 0.0, 0.3))

Plant = Callable[[ArmModel, Array, Array, Array], Array]


def healthy_torque(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """What the baseline can say exactly: rigid body, rotors, viscous and Coulomb friction."""
    return arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + COULOMB * np.tanh(dq / SLIP) + VISCOUS * dq


@cache
def sprung_session() -> Session:
    """Recordings of six runs of 8 s at 125 Hz, with a spring across joint 3."""
    arm = load_arm()
    law = lambda *states: healthy_torque(arm, *states) + spring_on_3(arm, *states)  # noqa: E731
    return made_session(arm, law, range(6), 8.0, 125.0)


def at_joint(joint: int, torque: Array, n: int = 3) -> Array:
    """A torque on one joint, none on the others."""
    whole = np.zeros((len(torque), n))
    whole[:, joint] = torque
    return whole


def nothing(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return np.zeros_like(q)


def spring_on_3(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """τ₃ = 1.5 sin 2 q₃ N m: a spring of 3 N m/rad with rests at 0 and π."""
    return at_joint(2, 1.5 * np.sin(2 * q[:, 2]))


def load_friction(share: float) -> Plant:
    """τ₂ = share |τ_rigid,₂| sign(dq₂)."""
    return lambda arm, q, dq, ddq: at_joint(
        1, share * np.abs(arm.inverse_dynamics(q, dq, ddq)[:, 1]) * np.tanh(dq[:, 1] / SLIP)
    )


load_friction_on_2 = load_friction(0.08)


def gain_on_2(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """The log of joint 2 reads 1.15 times the torque."""
    return at_joint(1, 0.15 * healthy_torque(arm, q, dq, ddq)[:, 1])


def stribeck_on_1(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """τ₁ = 6 exp(−(v / 0.06)²) sign(v) N m."""
    v = dq[:, 0]
    return at_joint(0, 6.0 * np.exp(-((v / 0.06) ** 2)) * np.tanh(v / SLIP))


def offset_on_1(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """τ₁ is shifted by 0.3 N m, at rest and in motion."""
    return at_joint(0, np.full(len(q), 0.3))


def carrying(load: Payload) -> Plant:
    """What a load at the last link adds."""
    return lambda arm, q, dq, ddq: (
        arm.with_payload(load).inverse_dynamics(q, dq, ddq) - arm.inverse_dynamics(q, dq, ddq)
    )


loaded = carrying(LOAD)


@cache
def load_arm() -> ArmModel:
    """The first three joints of the TM5-900, the wrist locked."""
    return ArmModel.load("tm5-900", joints=["joint_1", "joint_2", "joint_3"])


def record(arm: ArmModel, plant: Plant, seeds: Sequence[int] = range(6)) -> list[Motion]:
    """Runs of 8 s at 50 Hz."""

    def law(q: Array, dq: Array, ddq: Array) -> Array:
        return healthy_torque(arm, q, dq, ddq) + plant(arm, q, dq, ddq)

    return made_motions(arm, law, seeds, 8.0, 50.0, noise=NOISE)


def analyse(arm: ArmModel, plant: Plant, catalogue: Sequence[Effect] = CATALOGUE) -> Analysis:
    """The diagnosis of such recordings, made once a process; each run has a clock of its own."""
    return _analyse(arm, plant, tuple(catalogue))


@lru_cache(maxsize=16)
def _analyse(arm: ArmModel, plant: Plant, catalogue: tuple[Effect, ...]) -> Analysis:
    return diagnose(record(arm, plant), arm, catalogue, common_clock=False)


def all_evidence(analysis: Analysis) -> Evidence:
    """The sums of all candidates on their coarse grids."""
    return evidence_of(analysis.conclusion.inference.best.model)


def scorer_of(analysis: Analysis) -> HeldOut:
    """Held-out scores of models with any candidates, beside the URDF's usual tolerance."""
    evidence = all_evidence(analysis)
    return HeldOut(evidence, Prior.of(evidence, analysis.baseline.prior))


def search_of(analysis: Analysis) -> SetSearch:
    """Sets of all candidates on their coarse grids."""
    return analysis.conclusion.inference.best.search


def named_groups(analysis: Analysis) -> list[Group]:
    """The names' columns on coarse grids, which `all_evidence` has."""
    return [name.described.coarse for name in analysis.conclusion.names]


def named(analysis: Analysis) -> set[tuple[str, str]]:
    """Effect and joint of every finding."""
    return {
        (finding.estimate.group.effect.id, joint) for finding in analysis.diagnosis.findings for joint in finding.joints
    }
