"""Effects planted onto recordings: as large as asked, by physics that closes, distinguished from what was there."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from ident.simulation.real.cases import NEAR, OUTSIDE, before_and_after, plan_slots, plant_effects, sized
from ident.simulation.real.moved_arm import MovedArm, model_of, rigid_torque, twist_of
from ident.simulation.real.planted import EFFECTS
from ident.simulation.real.planting import bristle
from ident.simulation.real.sources import Source, with_body

LAWS = {**EFFECTS, **OUTSIDE}
# What this arm can't show: it moves for a minute, and its drives are not torn by their torque.
HARDLY = ("thermal_friction",)


@pytest.fixture(scope="module")
def arm() -> MovedArm:
    """A Panda that follows sums of sines, with friction, an offset and noise, in three runs of 12 s."""
    model = ArmModel.load("panda")
    urdf, rng, n = model.urdf, np.random.default_rng(0), model.n
    t = np.arange(0.0, 12.0, 0.01)
    runs = []
    for k in range(3):
        phase, pace = rng.uniform(0.0, 6.0, (2, n)), rng.uniform(0.6, 2.0, (2, n))
        waves = [0.35 * np.sin(p * t[:, None] + f) for p, f in zip(pace, phase, strict=True)]
        q = sum(waves) + np.array([0.0, 0.3, 0.0, -1.6, 0.0, 1.8, 0.0])
        dq = np.gradient(q, 0.01, axis=0)
        torque = model.inverse_dynamics(q, dq, np.gradient(dq, 0.01, axis=0))
        tau = torque + 0.6 * np.tanh(dq / 0.01) + 0.4 * dq + 0.2 + 0.1 * rng.standard_normal(q.shape)
        runs.append(Recording(f"run_{k}", model.joint_names, t + 15.0 * k, q, tau))
    return MovedArm.of(Source("made", "made", urdf, tuple(runs)))


def test_the_refit_leaves_the_noise(arm: MovedArm) -> None:
    """White noise of 0.1 N m at 100 Hz, cut at 8 Hz on both sides: what is left is about 0.1 √(16 / 100)."""
    assert np.all(arm.noise < 0.07)
    assert np.all(np.abs(arm.coulomb - 0.6) < 0.1)
    assert np.all(np.abs(arm.viscous - 0.4) < 0.1)


@pytest.mark.parametrize("effect", [name for name in LAWS if name not in HARDLY])
def test_it_shows_as_much_as_asked(arm: MovedArm, effect: str) -> None:
    """What the refit leaves of a planted torque is 3 × the noise at the joint, and so again from the same seed."""
    found = [sized(arm, effect, 3.0, np.random.default_rng(3), set()) for _ in range(2)]
    (change, entry), (again, _) = found
    seen = arm.visible(change.felt, LAWS[effect].view, LAWS[effect].local)
    at = [arm.source.joints.index(joint) for joint in entry["joints"]]
    assert abs(seen[at].max() - 3.0) < 3.0 * NEAR + 1e-6
    assert np.array_equal(change.felt, again.felt)
    assert set(entry["joints"]) <= set(entry["may_stand_at"])


def test_what_is_planted_is_cut_from_the_whole_recording(arm: MovedArm) -> None:
    """Law: rows that a session gets have the torque of the whole recording, memory and all; a push falls into them."""
    rows = slice(300, 700)
    part = MovedArm.of(arm.source, (rows,))
    hysteresis = EFFECTS["presliding_hysteresis"].change
    whole = hysteresis(arm, 2, 1.0, np.random.default_rng(4)).torque
    np.testing.assert_allclose(hysteresis(part, 2, 1.0, np.random.default_rng(4)).torque, whole)
    push = EFFECTS["external_contact"].change(part, 3, 20.0, np.random.default_rng(4))
    pushed = np.flatnonzero(np.any(push.torque != 0.0, axis=1))
    assert rows.start <= pushed.min() < pushed.max() < rows.stop
    made = plant_effects(part, "single", (("external_contact", 3.0),), np.random.default_rng(4))
    assert made is not None
    runs, _, answer = made
    assert [len(run) for run in runs] == [rows.stop - rows.start]
    np.testing.assert_array_equal(runs[0].position, arm.source.runs[0].position[rows])
    start = answer["effects"][0]["parameters"]["start_s"]
    assert runs[0].time[0] < start < runs[0].time[-1]


@pytest.mark.parametrize("seed", range(6))
def test_of_a_pair_the_later_set_alone_has_what_is_planted(arm: MovedArm, seed: int) -> None:
    """Law: the two sets share no row, and a push, which acts for a while only, falls into the later one."""
    before, rows = before_and_after(arm.source, np.random.default_rng(seed))
    later = replace(arm, given=rows)
    made = plant_effects(later, "single", (("external_contact", 3.0),), np.random.default_rng(seed))
    assert made is not None
    runs, _, answer = made
    times = [np.concatenate([run.time for run in side]) for side in (before, runs)]
    assert not set(times[0]) & set(times[1])
    assert sum(map(len, times)) == len(arm.t)
    assert len({run.name for run in (*before, *runs)}) == len(before) + len(runs)
    window = [answer["effects"][0]["parameters"][end] for end in ("start_s", "end_s")]
    assert any(run.time[0] < window[0] < window[1] < run.time[-1] for run in runs)
    torques = [run.effort[(run.time > window[0]) & (run.time < window[1])] for run in runs]
    assert max(np.abs(np.diff(torque, axis=0)).max(initial=0.0) for torque in torques) > 0.0


def test_more_of_the_last_link_may_be_told_as_a_load(arm: MovedArm) -> None:
    """Law: both are one torque exactly there, and nowhere else."""
    for seed in range(8):
        made = sized(arm, "link_inertial_error", 3.0, np.random.default_rng(seed), set())
        assert made is not None
        entry = made[1]
        is_last = entry["joints"] == [arm.source.joints[-1]]
        assert entry["also"] == (["payload"] if is_last else [])
    others = set(arm.source.joints[:-1])
    made = sized(arm, "link_inertial_error", 3.0, np.random.default_rng(0), others)
    assert made is not None
    assert made[1]["also"] == ["payload"]


def test_a_body_put_on_and_taken_off_is_none(arm: MovedArm) -> None:
    place, joint = np.array([0.05, -0.02, 0.1]), arm.source.joints[-1]
    heavier = with_body(arm.source.urdf, joint, 1.3, place, 0.03)
    back = with_body(heavier, joint, -1.3, place, 0.03)
    rows = arm.q[:20], arm.v[:20], arm.a[:20]
    added = rigid_torque(model_of(heavier), *rows) - rigid_torque(model_of(arm.source.urdf), *rows)
    weight = pin.computeTotalMass(model_of(heavier)) - pin.computeTotalMass(model_of(arm.source.urdf))
    assert weight == pytest.approx(1.3)
    assert np.abs(added).max() > 1.0
    assert np.allclose(rigid_torque(model_of(back), *rows), rigid_torque(model_of(arm.source.urdf), *rows), atol=1e-6)


def test_a_stiff_gear_twists_by_its_torque_over_its_stiffness(arm: MovedArm) -> None:
    stiffness, j = 2e4, 1
    (twist, _, _), _ = twist_of(arm, j, stiffness, 0.1)
    settled = slice(300, 1100)
    assert np.abs(twist - arm.rigid[:, j] / stiffness)[settled].max() < 0.05 * np.abs(twist[settled]).max()


def test_a_bristle_turns_round_over_its_travel(arm: MovedArm) -> None:
    """Where the joint has moved far beyond the travel since it turned, the bristle is the sign of its speed."""
    v = arm.v[:, 0]
    fast = (np.abs(v) > 0.2) & np.isfinite(arm.steps)
    assert np.allclose(bristle(arm, v, 1e-5)[fast], np.sign(v[fast]), atol=0.02)
    assert np.abs(bristle(arm, v, 10.0)).max() < 0.2


def test_every_effect_takes_its_turn() -> None:
    slots = plan_slots(120, 7)
    single = [effects[0][0] for kind, effects in slots if kind == "single"]
    assert len(slots) == 120
    assert min(single.count(effect) for effect in EFFECTS) >= len(single) // len(EFFECTS)
    assert slots == plan_slots(120, 7)
