"""Laws of the gate that a net must pass.

Laws of what a fit leaves out in turn.
"""

import numpy as np
import pytest

from ident.arrays import Array
from ident.model.joint_nets import JointNets
from ident.model.net_shrinkage import FOLDS, describe_gate, make_folds, shrink_net
from ident.model.residual_net import fit_residual_net

RUN = np.repeat(np.arange(8), 100)


def _judged(predicted: Array, left: Array) -> list[bool]:
    travel = np.full(left.shape, 0.01)
    return [one.kept for one in shrink_net(predicted, left, np.ones(left.shape, dtype=bool), travel, RUN)]


def test_a_joint_keeps_what_helps_on_every_run() -> None:
    """A net that halves the error in torque and energy stays; one that predicts noise goes; none is no help."""
    rng = np.random.default_rng(1)
    left = np.sin(np.arange(800) / 7.0)[:, None] * np.ones(3) + 0.1
    predicted = np.stack([0.5 * left[:, 0], rng.standard_normal(800), np.zeros(800)], axis=1)
    assert _judged(predicted, left) == [True, False, False]


def test_a_net_that_spoils_the_energy_goes() -> None:
    """Less torque error does not excuse more energy error."""
    left = np.sin(np.arange(800) / 7.0)[:, None] * np.ones(2)
    predicted = 0.5 * left
    predicted[:, 1] += 0.6
    assert _judged(predicted, left) == [True, False]


def test_what_says_twice_too_much_counts_by_half() -> None:
    """The weight is the share that leaves least on runs held back, and the told error is that of the share."""
    rng = np.random.default_rng(3)
    law = np.sin(np.arange(800) / 7.0)[:, None]
    left = law + 0.3 * rng.standard_normal((800, 1))
    (one,) = shrink_net(2.0 * law, left, np.ones(left.shape, dtype=bool), np.full(left.shape, 0.01), RUN)
    assert one.weight == 0.5
    assert one.rmse_with == pytest.approx(np.sqrt(np.mean((left - law) ** 2)))


def test_help_on_one_run_alone_is_no_help() -> None:
    """A gain within its standard error over the runs is chance."""
    left = np.sin(np.arange(800) / 7.0)[:, None]
    predicted = np.where(RUN == 0, 0.9, -0.05)[:, None] * left
    assert _judged(predicted, left) == [False]


def test_the_total_energy_is_no_worse_either() -> None:
    """Two joints whose energy errors cancel: a net that takes away one of them alone is let go."""
    left = np.sin(np.arange(800) / 7.0)[:, None] * np.ones(2) + np.array([1.0, -1.0])
    predicted = np.stack([0.9 * left[:, 0], np.zeros(800)], axis=1)
    assert _judged(predicted, left) == [False, False]


def test_a_silent_joint_gives_nothing() -> None:
    """And one that keeps half gives half; the other's net is as it was."""
    rng = np.random.default_rng(0)
    layers = [rng.standard_normal(shape) for shape in ((6, 6, 4), (6, 4, 1))]
    nets = JointNets(2, 3, tuple(layers), (np.ones((6, 1, 4)), np.ones((6, 1, 1))))
    x = rng.standard_normal((5, 3, 6))
    before = nets(x)
    after = nets.scaled([1.0, 0.0, 0.5])(x)
    assert np.all(after[..., 1] == 0.0)
    assert np.array_equal(after[..., 0], before[..., 0])
    assert np.allclose(after[..., 2], 0.5 * before[..., 2], rtol=1e-6)


def test_trained_nets_are_judged_on_runs_that_they_never_saw() -> None:
    """What differs from run to run teaches nothing about the next one; a law of the state does."""
    rng, states, residuals = np.random.default_rng(2), [], []
    for run in range(8):
        q, dq, ddq = (rng.uniform(-1, 1, (120, 2)) for _ in range(3))
        states.append((q, dq, ddq, np.zeros((120, 2))))
        residuals.append(np.stack([np.tanh(3 * dq[:, 0]), (-1.0) ** run * np.ones(120)], axis=1))
    net = fit_residual_net(states, residuals)
    assert [one.kept for one in net.gate] == [True, False]
    assert np.all(net.predict(*states[0])[:, 1] == 0.0)
    told = describe_gate(net.gate, ("a", "b"))
    assert told.startswith("residual net, on runs held back: kept for a (")
    assert f"{net.gate[0].rmse_without:.3g} → {net.gate[0].rmse_with:.3g} N m" in told
    assert "; left out for b (" in told


def test_a_run_of_few_samples_has_no_more_say_than_they() -> None:
    """One sample on which the net is far off doesn't silence what helps on hundreds of others."""
    rng = np.random.default_rng(7)
    left = rng.standard_normal((801, 1))
    predicted, moving, run = 0.8 * left, np.ones((801, 1), dtype=bool), np.r_[np.repeat(np.arange(8), 100), 8]
    predicted[-1] = left[-1] + 6.0
    travel = rng.choice([-1e-3, 1e-3], (801, 1))
    assert shrink_net(predicted, left, moving, travel, run)[0].kept


@pytest.mark.parametrize("lengths", [(900, 400, 700), (500, 300, 800, 600, 450), (100,) * 12])
def test_whole_runs_are_left_out_where_there_are_three(lengths: tuple[int, ...]) -> None:
    """All samples of a run lie in one part, and there is more than one part."""
    parts, _ = make_folds(lengths, 2, np.random.default_rng(0))
    runs = np.repeat(np.arange(len(lengths)), lengths)
    assert all(len(np.unique(parts[runs == run])) == 1 for run in range(len(lengths)))
    assert len(np.unique(parts)) == min(FOLDS, len(lengths))


@pytest.mark.parametrize("lengths", [(900,), (900, 30), (5, 900, 411), (3,)])
def test_a_witness_lies_in_one_run(lengths: tuple[int, ...]) -> None:
    """No group goes on into the next run; of one run there are parts to leave out."""
    parts, groups = make_folds(lengths, 1, np.random.default_rng(0))
    runs = np.repeat(np.arange(len(lengths)), lengths)
    assert len(parts) == len(groups) == sum(lengths)
    assert all(len(np.unique(runs[groups == group])) == 1 for group in np.unique(groups))
    assert len(np.unique(parts)) == min(FOLDS, len(np.unique(groups))) or len(lengths) >= 3
