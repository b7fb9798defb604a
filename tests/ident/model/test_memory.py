"""Laws of what joints remember: kept where it helps on runs left out, silent where it can't, and never wild."""

from dataclasses import replace

import numpy as np

from ident.arrays import Array
from ident.model.boosted import fit_trees
from ident.model.hybrid import HybridModel
from ident.model.linearisation import stop_operator
from ident.model.loss import LossParameters
from ident.model.memory import JointMemory, fit_memory, lagged
from ident.model.net_options import PRESETS
from ident.model.residual_net import ResidualNet, Unexplained, fit_net_of_arm
from ident.model.sampling import sampling_interval
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, multisine

RATE = 100.0


def _runs(arm: ArmModel, count: int = 6) -> tuple[list[Motion], list[Array]]:
    """Runs whose first joint has a hysteresis of 2 N m over 0.2 rad; the second has noise alone."""
    rng, time = np.random.default_rng(3), np.arange(1200) / RATE
    motions, left = [], []
    for k in range(count):
        q, dq, ddq = multisine(rng, time, 2)
        hidden = np.column_stack([2.0 * stop_operator(np.ascontiguousarray(q[:, 0]), 0.1) / 0.1, np.zeros(len(q))])
        hidden = hidden + 0.2 * rng.standard_normal(hidden.shape)
        motion = exact_motion(time, (q, dq, ddq), arm.inverse_dynamics(q, dq, ddq) + hidden, arm.joint_names, f"r{k}")
        motions.append(motion)
        left.append(motion.filtered(hidden))
    return motions, left


def _unexplained(arm: ArmModel, motions: list[Motion], left: list[Array]) -> Unexplained:
    """Runs of which an arm leaves `left`."""
    of_arm = Unexplained.by(motions, arm, lambda _, rigid: 0.0 * rigid)
    return replace(of_arm, left=tuple(left))


def _errors(memory: JointMemory, arm: ArmModel, motion: Motion, left: Array) -> Array:
    rigid = arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    said = memory.predict(motion.q, motion.dq, motion.ddq, rigid, motion.interval)
    after = (left - motion.filtered(said))[motion.moving.all(axis=1)]
    return np.asarray(np.sqrt(np.mean(after**2, axis=0)))


def test_a_hysteresis_is_remembered_and_noise_is_not(two_joints: ArmModel) -> None:
    """On a run that it never saw the first joint's error halves; the second, with nothing to remember, stays silent."""
    motions, left = _runs(two_joints)
    memory = fit_memory(_unexplained(two_joints, motions[:5], left[:5]), seed=0)
    assert memory.kept.tolist() == [True, False]
    alone = np.sqrt(np.mean(left[5][:, 0] ** 2))
    assert _errors(memory, two_joints, motions[5], left[5])[0] < 0.5 * alone


def test_trees_stay_within_what_they_saw() -> None:
    """Far outside of the training's inputs no torque is larger than the largest seen, and the same seed is the same."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((2000, 5))
    y = np.tanh(x[:, 0]) + 0.3 * x[:, 1]
    trees = fit_trees(x, y, seed=1)
    far = 100.0 * rng.standard_normal((500, 5))
    assert np.abs(trees(far)).max() <= np.abs(y).max()
    assert np.std(y - trees(x)) < 0.4 * np.std(y)
    assert np.array_equal(trees(x), fit_trees(x, y, seed=1)(x))
    assert np.allclose(trees.scaled(0.5)(x), 0.5 * trees(x))


def test_no_answer_of_a_tree_hangs_on_the_last_bit() -> None:
    """Inputs that hold at an end, as a stop operator's and a tanh's do, are no thresholds."""
    rng = np.random.default_rng(4)
    wide = rng.standard_normal((2000, 2))
    x = np.column_stack([np.clip(wide[:, 0], -1.0, 1.0), np.tanh(20.0 * wide[:, 1])])
    y = x[:, 0] + (x[:, 1] > -1.0) + 0.1 * rng.standard_normal(2000)
    trees = fit_trees(x, y, seed=2)
    said = trees(x)
    assert np.std(y - said) < 0.5 * np.std(y)
    for towards in (-2.0, 2.0):
        assert np.array_equal(trees(np.nextafter(x, towards)), said)


def test_only_states_that_follow_one_another_have_a_past() -> None:
    """A run tells its interval; shuffled or drawn states tell none, and neither does one that stands."""
    rng, time = np.random.default_rng(1), np.arange(500) / RATE
    q, dq, _ = multisine(rng, time, 2)
    interval = sampling_interval(q, dq)
    assert interval is not None
    assert abs(interval * RATE - 1.0) < 0.01
    order = rng.permutation(500)
    assert sampling_interval(q[order], dq[order]) is None
    assert sampling_interval(np.zeros((50, 2)), np.zeros((50, 2))) is None
    assert sampling_interval(q[:2], dq[:2]) is None


def test_an_average_starts_at_the_first_value_and_lags() -> None:
    """A constant stays; a step is at 63 % after the time."""
    assert np.allclose(lagged(np.full(100, 2.0), 0.01, 0.3), 2.0)
    step = np.concatenate([np.zeros(1), np.ones(1000)])
    assert abs(lagged(step, 0.001, 0.3)[301] - (1.0 - np.exp(-1.0))) < 0.01


def test_a_model_gives_its_memory_along_a_motion_alone_and_keeps_it(two_joints: ArmModel, tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Along a run memory stands in for the net; at shuffled states the net counts; saved and read they are alike."""
    motions, left = _runs(two_joints)
    unexplained = _unexplained(two_joints, motions, left)
    net: ResidualNet = fit_net_of_arm(unexplained, PRESETS["default"], None, None)
    memory = fit_memory(unexplained, seed=0)
    model = HybridModel(two_joints, two_joints, two_joints, LossParameters.zero(2), net, memory)
    loaded = HybridModel.load(model.save(tmp_path / "model"))
    run = motions[0].q, motions[0].dq, motions[0].ddq
    assert np.allclose(loaded.torque(*run), model.torque(*run), atol=1e-9)
    order = np.random.default_rng(0).permutation(len(run[0]))
    mixed = [part[order] for part in run]
    without = HybridModel(two_joints, two_joints, two_joints, LossParameters.zero(2), net)
    assert np.allclose(model.torque(*mixed), without.torque(*mixed))  # type: ignore[arg-type]
    assert not np.allclose(model.torque(*run), without.torque(*run))


def test_a_memory_that_holds_near_what_was_seen_alone_fades_with_distance(two_joints: ArmModel) -> None:
    """A torque of its own in every run, at poses of its own: another run's memory counts for little there.

    Where poses are the same in all runs, nothing falls on them.
    """
    motions, _ = _runs(two_joints, 4)
    left = []
    for number, motion in enumerate(motions):
        away = replace(motion, q=motion.q + 3.0 * number)
        sign = 1.0 if number % 2 else -1.0
        left.append(np.tile([sign, 0.0], (motion.filtered_length, 1)))
        motions[number] = away
    memory = fit_memory(_unexplained(two_joints, motions, left), seed=0)
    assert memory.kept[0]
    assert memory.nearness.reach[0] < 3.0
    near = memory.nearness.fall(motions[0].q)[:, 0]
    far = memory.nearness.fall(motions[0].q + 30.0)[:, 0]
    assert near.min() > 0.5
    assert far.max() < 0.05
