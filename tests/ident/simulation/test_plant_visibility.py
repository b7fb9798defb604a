"""Laws of the visible amplitude: what is claimed is there, measured coarsely or finely, simulated anew or not."""

import numpy as np
import pytest

from ident.simulation import visibility
from ident.simulation.causes import Circumstances, find_cause
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.simulator import choose_step
from ident.simulation.visibility import TOLERANCE, VisibilityMeter, compare, gather, moves_alike
from ident.trajectories.kinds import plan_motions

SENSORS = ("torque_gain_error", "torque_offset", "torque_delay", "torque_saturation", "supply_sag")


@pytest.fixture(scope="module")
def motions(arm):
    return plan_motions(arm, ["fourier", "chirp"], 2, 3.0, np.random.default_rng(1))


@pytest.fixture(scope="module")
def meters(hardware, motions):
    """A coarse and a fine meter of the same session."""
    return tuple(VisibilityMeter(hardware, motions, [0.0, 1.0], 0, coarse) for coarse in (True, False))


def scene_at(hardware, motions, joint):
    return Circumstances(hardware, joint, motions, np.random.default_rng(2))


@pytest.mark.parametrize(
    ("effect", "joint", "wanted"),
    [
        ("load_dependent_friction", 1, 0.3),
        ("presliding_hysteresis", 4, 1.0),
        ("joint_elasticity", 2, 3.0),
        ("payload", 5, 3.0),
        ("external_contact", 2, 1.0),
        ("torque_delay", 5, 1.0),
        ("torque_saturation", 1, 1.0),
    ],
)
def test_a_coarse_search_keeps_its_promise(hardware, motions, meters, effect, joint, wanted):
    """A finer simulation of all runs shows what the coarse one told; so it does without the effect."""
    meter = meters[0]
    cause, scene = find_cause(effect), scene_at(hardware, motions, joint)
    size = meter.find_size(cause, scene, wanted, seed=2)
    assert meter.share(cause, scene, size, seed=2) == pytest.approx(wanted, rel=1.05 * TOLERANCE)
    changed, _ = cause.apply(scene_at(hardware, motions, joint), size)
    way = visibility.Way(all_runs=True, coarse_step=0.5 * choose_step(changed, coarse=True))
    finer = VisibilityMeter(hardware, motions, [0.0, 1.0], 0)
    after, before = (gather(one, finer._traces(one, way), cause.view) for one in (changed, hardware))
    push = changed.contact
    window = (after.run == changed.contact_run) & (after.time > push.start) & (after.time < push.end)
    share = compare(after, before, window if push.body else None).rms / hardware.sensing.noise_floor
    assert (share.max() if cause.whole_arm else share[joint]) == pytest.approx(wanted, rel=0.08)


@pytest.mark.parametrize("effect", SENSORS)
def test_what_only_the_reading_shows_needs_no_new_simulation(hardware, motions, meters, effect):
    """Read anew from the arm without the effect, the torque is the one that a new simulation would give."""
    fine = meters[1]
    cause, scene = find_cause(effect), scene_at(hardware, motions, 2)
    size = cause.typical(scene)
    changed, _ = cause.apply(Circumstances(hardware, 2, motions, np.random.default_rng(2)), size)
    assert moves_alike(changed, hardware)
    seen = fine.measure(cause, scene, size, 2)
    way = visibility.Way(cause.needs_all, None)
    again = [gather(one, fine._traces(one, way), cause.view) for one in (changed, hardware)]
    np.testing.assert_array_equal(seen, compare(*again).rms)


def test_a_size_is_measured_once(hardware, motions, monkeypatch):
    meter = VisibilityMeter(hardware, motions, [0.0, 1.0], 0, coarse=True)
    cause, scene = find_cause("spring_torque"), scene_at(hardware, motions, 2)
    first = meter.measure(cause, scene, 3.0, 2)
    monkeypatch.setattr(meter, "_traces", lambda *_: pytest.fail("simulated again"))
    assert meter.measure(cause, scene, 3.0, 2) is first


def test_the_answer_tells_the_amplitude_that_was_reached():
    request = EffectRequest("spring_torque", "joint_3", amplitude=1.0)
    options = SimulationOptions(motions=("spline",), runs=2, duration=2.0, rate=50.0, effects=(request,), coarse=True)
    made = simulate(options).answer
    assert made.effects[0].visible_Nm["joint_3"] / made.noise_floor_Nm["joint_3"] == pytest.approx(1.0, rel=TOLERANCE)


def test_play_is_compared_with_the_same_gear_without_play(hardware, motions, meters):
    """That teeth twist is no play: a gear without it shows nothing, and more play shows more."""
    cause, scene = find_cause("backlash"), scene_at(hardware, motions, 2)
    none, some, more = (meters[0].measure(cause, scene, gap, 3)[2] for gap in (0.0, 0.004, 0.016))
    assert none < 1e-9
    assert 1e-6 < some < more
