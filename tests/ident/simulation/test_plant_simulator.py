"""Laws of the closed loop: rest to rest, within limits, repeatable."""

from itertools import pairwise

import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.simulation import visibility
from ident.simulation.hardware import draw_hardware
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.simulator import Simulator, choose_step
from ident.trajectories.kinds import plan_motions

SHORT = SimulationOptions(motions=("spline", "chirp"), runs=3, duration=2.5, rate=100.0, seed=5, temperature=True)


@pytest.fixture(scope="module")
def short():
    return simulate(SHORT)


def test_the_arm_follows_and_starts_and_ends_at_rest(hardware):
    motions = plan_motions(hardware.arm, ["spline", "fourier"], 3, 3.0, np.random.default_rng(0))
    traces = Simulator(hardware, np.random.default_rng(1)).run(motions, [0.0, 2.0, 2.0], lambda: None)
    for trace in traces:
        error = np.abs(trace.log.angle - trace.motion.q)
        assert error.max() < 0.02
        for edge in (slice(0, 100), slice(-100, None)):
            assert np.abs(trace.log.speed[edge]).max() < 5e-3
        # No start-up transient: the first torque is what holds the arm, up to friction.
        holding = hardware.arm.gravity(trace.log.angle[:1])[0]
        assert (np.abs(trace.log.torque[0] - holding) < 1.2 * hardware.friction.coulomb + 5.0).all()


def test_torques_and_speeds_stay_within_the_urdfs_limits(short):
    arm = ArmModel.load("tm5-900")
    for run in short.session.runs:
        assert (np.abs(run.effort) < arm.effort_limit).all()
        assert (np.abs(run.velocity) < arm.velocity_limit).all()
        assert ((run.position > arm.lower) & (run.position < arm.upper)).all()


def test_a_seed_repeats_bit_for_bit(short):
    again = simulate(SHORT)
    for one, other in zip(short.session.runs, again.session.runs, strict=True):
        for name, values in one.channels().items():
            assert values.tobytes() == getattr(other, name).tobytes(), name
        assert one.time.tobytes() == other.time.tobytes()
    assert again.answer == short.answer


def test_another_seed_is_another_arm(short):
    other = simulate(SimulationOptions(**{**vars(SHORT), "seed": 6}))
    assert not np.array_equal(other.hardware.friction.coulomb, short.hardware.friction.coulomb)


def test_an_arm_seed_keeps_the_arm(short):
    options = SimulationOptions(**{**vars(SHORT), "seed": 6, "arm_seed": 5, "runs": 1})
    np.testing.assert_array_equal(simulate(options).hardware.friction.coulomb, short.hardware.friction.coulomb)


def test_the_clock_goes_on_through_pauses(short):
    runs = short.session.runs
    for before, after in pairwise(runs):
        assert SHORT.pause[0] <= after.time[0] - before.time[-1] <= SHORT.pause[1] + 0.1
    assert all(np.all(np.diff(run.time) > 0.0) for run in runs)


def test_channels_are_optional():
    bare = SimulationOptions(
        motions=("spline",), runs=1, duration=2.0, rate=50.0, velocity=False, commands=False, temperature=False
    )
    assert set(simulate(bare).session.runs[0].channels()) == {"position", "effort"}


def test_friction_varies_by_a_per_cent_from_run_to_run(hardware):
    varied = hardware.replace(friction_spread=0.01)
    motion = plan_motions(hardware.arm, ["spline"], 1, 2.0, np.random.default_rng(0))[0]
    traces = Simulator(varied, np.random.default_rng(1)).run([motion] * 6, [1.0] * 6, lambda: None)
    moving = np.abs(motion.dq[:, 0]) > 0.2
    levels = [np.abs(trace.log.torque[moving, 0]).mean() for trace in traces]
    assert 0.001 < np.std(levels) / np.mean(levels) < 0.03


def test_a_healthy_arm_is_rigid_body_plus_linear_friction(hardware, monkeypatch):
    """Once the bristles have slipped, nothing is left that the ordinary model can't explain: no delay, no bias."""
    monkeypatch.setattr(visibility, "STILL_RAD_S", 0.15)
    monkeypatch.setattr(visibility, "_slow", lambda values: values)  # it would carry reversals over to where all slides
    motions = plan_motions(hardware.arm, ["fourier", "chirp"], 2, 5.0, np.random.default_rng(0))
    silent = hardware.replace(sensing=hardware.sensing.silent())
    traces = Simulator(silent, np.random.default_rng(0)).run(motions, [1.0, 1.0], lambda: None)
    rows = visibility.gather(hardware, traces, "refit")
    rest = np.abs(visibility.remainder(rows)).max(axis=0)
    assert (rest < 0.05 * hardware.sensing.noise_floor).all()


def test_stiff_springs_get_small_steps(hardware):
    assert choose_step(hardware) == 5e-4
    soft = hardware.with_laws("drive", 1, elastic=True, stiffness=2e4)
    stiff = hardware.with_laws("drive", 5, elastic=True, stiffness=9e4)
    assert choose_step(stiff) < choose_step(soft) < 5e-4
    assert choose_step(stiff) < choose_step(stiff, coarse=True)


def test_other_arms_work():
    for robot in ("panda", "ur10"):
        result = simulate(SimulationOptions(robot=robot, motions=("fourier",), runs=1, duration=3.0, rate=100.0))
        run = result.session.runs[0]
        assert np.isfinite(run.effort).all()
        assert np.abs(run.position - run.position_command).max() < 0.05


def test_a_diverging_plant_is_refused(hardware, tmp_path, monkeypatch, capfd):
    """In one message: nothing stands on standard error, and no file is left."""
    monkeypatch.chdir(tmp_path)
    broken = hardware.with_laws("drive", 1, hose_stiffness=1e9)
    motion = plan_motions(hardware.arm, ["spline"], 1, 2.0, np.random.default_rng(0))
    with pytest.raises(InputError, match="diverged"):
        Simulator(broken, np.random.default_rng(1)).run(motion, [0.0], lambda: None)
    assert not list(tmp_path.iterdir())
    assert not capfd.readouterr().err


def test_individual_arms_differ(arm):
    one, other = (draw_hardware(arm, np.random.default_rng(seed)).friction.coulomb for seed in (1, 2))
    assert (np.abs(np.log(one / other)) > 1e-3).all()
