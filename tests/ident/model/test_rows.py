"""Laws of the rows that a fit's parameters come from: whitened, or plain where these foretell better."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.arrays import Array
from ident.command_options import FitOptions
from ident.fitting.fit import choose_and_gather
from ident.fitting.held_out_sums import part_of_blocks, split_parts
from ident.fitting.identification import identify
from ident.model.linearisation import stop_operator
from ident.motion.motion import Motion
from ident.regression.partition import partition_motions
from ident.robot.arm import ArmModel
from tests.ident.made_up import exact_motion, multisine

TRUTH = np.array([[0.6, 10.0, 8.0], [0.8, 6.0, 5.0]])  # rotor inertia, viscous, Coulomb of each joint
RATE = 100.0
OPTIONS = FitOptions(net="none", laws="none")


def made_runs(arm: ArmModel, reach: float, seed: int, colour: float = 0.97, count: int = 6) -> list[Motion]:
    """Runs whose dry friction turns round over a travel [rad], under coloured noise of half a N m."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(12.0 * RATE)) / RATE
    motions = []
    for k in range(count):
        q, dq, ddq = multisine(rng, time, 2)
        bristles = np.sign(dq)
        if reach > 0.0:
            bristles = np.stack([stop_operator(np.ascontiguousarray(angle), reach) for angle in q.T], axis=1) / reach
        white = rng.standard_normal(dq.shape)
        noise = 0.5 * np.sqrt(1.0 - colour**2) * lfilter([1.0], [1.0, -colour], white, axis=0)
        tau = arm.inverse_dynamics(q, dq, ddq) + TRUTH[:, 0] * ddq + TRUTH[:, 1] * dq + TRUTH[:, 2] * bristles
        motions.append(exact_motion(time, (q, dq, ddq), tau + noise, arm.joint_names, f"run_{k}"))
    return motions


def errors(arm: ArmModel, motions: list[Motion], whitened: bool | None) -> tuple[Array, bool]:
    """Relative error of each loss by some rows, or those that are chosen; and whether they are plain ones."""
    choice, sums = choose_and_gather(motions, arm, OPTIONS, ())
    found = identify(sums, choice if whitened is None else choice.with_rows(whitened))
    loss = found.loss.params
    values = np.stack([loss.motor_inertia, loss.viscous, loss.coulomb], axis=1)
    return values / TRUTH - 1.0, found.plain_rows


def test_rows_are_whitened_where_they_foretell_as_well(two_joints: ArmModel) -> None:
    """Of arms with nothing but coloured noise most take whitened rows: chance alone speaks for plain ones at others."""
    plain = []
    for seed in range(3):
        losses, is_plain = errors(two_joints, made_runs(two_joints, 0.0, seed), None)
        assert np.all(np.abs(losses[:, 1:]) < 0.05)
        plain.append(is_plain)
    assert sum(plain) <= 1


def test_rows_may_be_asked_for(two_joints: ArmModel) -> None:
    """What is asked for is not put to the runs left out."""
    motions = made_runs(two_joints, 0.0, 0)
    assert errors(two_joints, motions, False)[1]
    assert not errors(two_joints, motions, True)[1]


def test_rows_are_plain_where_reversals_are_another_matter(two_joints: ArmModel) -> None:
    """Friction that turns round over a third of a radian is no Coulomb friction: rows through reversals foretell it."""
    _, plain = errors(two_joints, made_runs(two_joints, 0.3, 0), None)
    assert plain


def test_every_block_belongs_to_the_part_of_its_samples(two_joints: ArmModel) -> None:
    """Law: blocks of eight runs lie in eight parts, in order, and all samples of a block in the block's part."""
    motions = made_runs(two_joints, 0.0, 0, count=8)
    partition = partition_motions(motions)
    parts = part_of_blocks(motions, partition)
    assert np.array_equal(np.unique(parts), np.arange(8))
    assert np.all(np.diff(parts) >= 0)
    for run, of_samples in enumerate(split_parts(motions)):
        blocks = partition.blocks_of(run, len(of_samples))
        assert np.mean(parts[blocks] == of_samples) == pytest.approx(1.0)
