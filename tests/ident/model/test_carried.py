"""Laws of what a fit takes from a diagnosis beside friction: springs, links, offsets, delays."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ident.api.fitting import with_carried
from ident.arrays import Array
from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.fitting.named_laws import NamedLaws, read_named_laws
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.export.diagnoses import FIGURES, finding, write_diagnosis
from tests.ident.made_up import exact_motion, multisine, two_joint_arm

RATE, SECONDS, NOISE = 100.0, 10.0, 0.1
OWN = np.array([[0.6, 10.0, 8.0], [0.8, 6.0, 5.0]])  # rotor inertia, viscous, Coulomb of each joint
JOINT = 1  # where the effect is
GROWTH = 0.15  # of the link that is heavier than its URDF says
PLAIN = FitOptions(net="none", inertia="nominal", offset="off", laws="none")
States = tuple[Array, Array, Array]
Torque = Callable[[ArmModel, States, States], Array]


def plain_torque(arm: ArmModel, states: States) -> Array:
    """The rigid arm with its losses."""
    q, dq, ddq = states
    return arm.inverse_dynamics(q, dq, ddq) + OWN[:, 0] * ddq + OWN[:, 1] * dq + OWN[:, 2] * np.tanh(dq / 0.05)


def sprung(arm: ArmModel, now: States, before: States) -> Array:
    """A spring from link to link, which the joint has to hold."""
    torque = plain_torque(arm, now)
    torque[:, JOINT] += 6.0 * (now[0][:, JOINT] - 0.3)
    return torque


def heavier(arm: ArmModel, now: States, before: States) -> Array:
    """A link of the same shape and of more matter."""
    links = np.array(arm.inertial_parameters)
    links[10 * JOINT : 10 * JOINT + 10] *= 1.0 + GROWTH
    return plain_torque(arm.with_inertial_parameters(links), now)


def biased(arm: ArmModel, now: States, before: States) -> Array:
    """A sensor that reads 1.1 N m too much."""
    return plain_torque(arm, now) + 1.1 * np.eye(arm.n)[JOINT]


def scaled(arm: ArmModel, now: States, before: States) -> Array:
    """A sensor that reads 6 % too much."""
    return plain_torque(arm, now) * (1.0 + 0.06 * np.eye(arm.n)[JOINT])


def late(arm: ArmModel, now: States, before: States) -> Array:
    """A log of torque that is 11 ms old."""
    return plain_torque(arm, before)


def tilted(arm: ArmModel, now: States, before: States) -> Array:
    """A base that is turned about x and y."""
    turn = Rotation.from_rotvec([-0.02, 0.03, 0.0])
    return plain_torque(arm.with_gravity(turn.apply(arm.model.gravity.linear)), now)


def turned_zero(arm: ArmModel, now: States, before: States) -> Array:
    """Angles that are 20 mrad more than the encoder says."""
    q, dq, ddq = now
    return plain_torque(arm, (q + 0.02 * np.eye(arm.n)[JOINT], dq, ddq))


TRUTHS: dict[str, Torque] = {
    "spring_torque": sprung,
    "link_inertial_error": heavier,
    "torque_offset": biased,
    "torque_gain_error": scaled,
    "torque_delay": late,
    "gravity_misalignment": tilted,
    "encoder_offset": turned_zero,
}


def record_runs(arm: ArmModel, truth: Torque, count: int = 4) -> list[Motion]:
    """Runs of an arm with an effect."""
    runs = []
    time = np.arange(int(SECONDS * RATE)) / RATE
    for seed in range(count):
        now = multisine(np.random.default_rng(seed), time, arm.n)
        before = multisine(np.random.default_rng(seed), time - FIGURES["torque_delay"]["delay_s"], arm.n)
        noise = NOISE * np.random.default_rng(100 + seed).standard_normal(now[0].shape)
        tau = truth(arm, now, before) + noise
        runs.append(exact_motion(time, now, tau, arm.joint_names, f"run_{seed}"))
    return runs


def diagnose_by_hand(path: Path, arm: ArmModel, effect: str) -> NamedLaws:
    """What a fit takes from a diagnosis that has the effect right."""
    named = finding(arm, effect, JOINT)
    if effect == "link_inertial_error":
        link = np.asarray(arm.inertial_parameters).reshape(arm.n, 10)[JOINT]
        names = ("mass_change_kg", *(f"moment_change_{axis}_kgm" for axis in "xyz"))
        values = (GROWTH * link[:4]).tolist()
        spread = [{"value": one, "low": one - 0.1 * abs(one), "high": one + 0.1 * abs(one)} for one in values]
        named["parameters"] = dict(zip(names, spread, strict=True))
    written = write_diagnosis(path, arm, findings=[named])
    return with_carried(written, arm, read_named_laws(written, arm))


def held_out_error(model: HybridModel, run: Motion) -> float:
    """What a model leaves of a run's filtered torque where joints move, root mean square [N m]."""
    left = run.filtered(model.torque(run.q, run.dq, run.ddq)) - run.tau_filtered
    return float(np.sqrt(np.mean(left[run.moving] ** 2)))


@pytest.fixture(scope="module")
def healthy_error() -> float:
    """What a fit leaves of an arm that has no effect: noise, and how friction turns round [N m]."""
    arm = two_joint_arm()
    runs = record_runs(arm, lambda arm, now, before: plain_torque(arm, now))
    return held_out_error(fit_hybrid(runs[:3], arm, PLAIN).model, runs[3])


@pytest.mark.parametrize("effect", TRUTHS)
def test_a_named_effect_is_carried_and_foretold(
    two_joints: ArmModel, healthy_error: float, tmp_path: Path, effect: str
) -> None:
    """With it an unseen run is foretold as of an arm without it, else much worse; it is kept."""
    runs = record_runs(two_joints, TRUTHS[effect])
    named = diagnose_by_hand(tmp_path / "why.json", two_joints, effect)
    assert [one.effect for one in named.carried] == [effect]
    assert named.left_out == ()
    model = fit_hybrid(runs[:3], two_joints, PLAIN, named=named).model
    without = fit_hybrid(runs[:3], two_joints, PLAIN).model
    assert held_out_error(model, runs[3]) < 1.05 * healthy_error
    assert held_out_error(without, runs[3]) > 2.0 * held_out_error(model, runs[3])
    assert np.allclose(model.loss.coulomb, OWN[:, 2], rtol=0.03)
    back = HybridModel.load(model.save(tmp_path / "model"))
    states = runs[3].q, runs[3].dq, runs[3].ddq
    assert np.allclose(back.torque(*states), model.torque(*states), atol=1e-9)
