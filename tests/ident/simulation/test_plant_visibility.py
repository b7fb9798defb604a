"""Laws of the visible amplitude: what is claimed is there, measured coarsely or finely, simulated anew or not."""

import numpy as np
import pytest

from ident.simulation import visibility
from ident.simulation.causes import Circumstances, find_cause
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.simulator import choose_step
from ident.simulation.visibility import TOLERANCE, VisibilityMeter, compare, find_size, gather, moves_alike
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import TICK_S

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


@pytest.mark.parametrize(
    "effect", ["encoder_offset", "spring_torque", "payload", "external_contact", "thermal_friction"]
)
def test_what_moves_the_arm_is_simulated(hardware, motions, effect):
    changed, _ = find_cause(effect).apply(
        scene_at(hardware, motions, 2), find_cause(effect).typical(scene_at(hardware, motions, 2))
    )
    assert not moves_alike(changed, hardware)


def test_a_size_is_measured_once(hardware, motions, monkeypatch):
    meter = VisibilityMeter(hardware, motions, [0.0, 1.0], 0, coarse=True)
    cause, scene = find_cause("spring_torque"), scene_at(hardware, motions, 2)
    first = meter.measure(cause, scene, 3.0, 2)
    monkeypatch.setattr(meter, "_traces", lambda *_: pytest.fail("simulated again"))
    assert meter.measure(cause, scene, 3.0, 2) is first


def test_the_answer_tells_the_amplitude_that_was_reached():
    request = EffectRequest("spring_torque", "joint_3", amplitude=1.0)
    options = SimulationOptions(motions=("spline",), runs=2, duration=2.0, rate=50.0, effects=(request,), coarse=True)
    told = simulate(options).answer
    assert told.effects[0].visible_Nm["joint_3"] / told.noise_floor_Nm["joint_3"] == pytest.approx(1.0, rel=TOLERANCE)


def test_what_is_too_quick_to_be_seen_is_no_amplitude():
    """Chatter beyond the stride's own band would pass for something slower; what is slow stays as it is."""
    ticks = np.arange(4000) * TICK_S
    chatter, slow = np.sin(2 * np.pi * 90.0 * ticks), np.sin(2 * np.pi * 3.0 * ticks)
    seen = visibility._slow(np.column_stack([chatter, slow]))[200:-200]
    assert np.sqrt(np.mean(seen[:, 0] ** 2)) < 1e-3
    np.testing.assert_allclose(seen[:, 1], slow[200:-200], atol=1e-3)


def test_play_is_compared_with_the_same_gear_without_play(hardware, motions, meters):
    """That teeth twist is no play: a gear without it shows nothing, and more play shows more."""
    cause, scene = find_cause("backlash"), scene_at(hardware, motions, 2)
    none, some, more = (meters[0].measure(cause, scene, gap, 3)[2] for gap in (0.0, 0.004, 0.016))
    assert none < 1e-9
    assert 1e-6 < some < more


def search(law, wanted, start=1.0, small=1e-3, large=1e3, tolerance=0.04):
    """The size found, what it shows, and all sizes tried."""
    tried = []

    def shown(size):
        tried.append(size)
        return law(size)

    return *find_size(shown, wanted, start, (small, large), tolerance), tried


# What a size shows, what is wanted and where the search begins, and how many trials it may take.
SEARCHES = {
    "in proportion": (lambda s: 2.0 * s, {"wanted": 0.3}, 2),
    **{f"power {p}": (lambda s, p=p: 0.2 * s**p, {"wanted": 3.0}, 4) for p in (0.5, 1.5, 2.0)},
    "less shows more": (lambda s: 5.0 / s, {"wanted": 1.0, "small": 1e3, "large": 1e-3}, 2),
    # Nothing below one, then ever more: no power law, and no information below.
    **{f"threshold from {s}": (lambda s: max(s - 1.0, 0.0), {"wanted": 0.5, "start": s}, 10) for s in (0.02, 60.0)},
    "stalled arm": (lambda s: 0.1 * s if s < 40.0 else np.inf, {"wanted": 3.5, "start": 100.0}, 40),
    "four digits": (lambda s: s, {"wanted": np.pi}, 40),
}


@pytest.mark.parametrize("case", SEARCHES)
def test_a_size_is_found_in_a_few_trials(case):
    law, asked, most = SEARCHES[case]
    size, seen, tried = search(law, **asked)
    assert seen == law(size) == pytest.approx(asked["wanted"], rel=0.04)
    assert len(tried) <= most
    assert all(float(f"{one:.4g}") == one for one in tried)


def test_a_bound_ends_the_search():
    """Out of reach it is tried and nothing more; so it is where even the smallest size shows too much."""
    size, seen, tried = search(lambda s: 0.1 * s, wanted=3.0, large=20.0)
    assert tried == [1.0, 20.0]
    assert (size, seen) == (20.0, 2.0)
    size, _, tried = search(lambda s: 1.0 + s, wanted=0.5, small=0.1)
    assert size == 0.1
    assert len(tried) <= 4
