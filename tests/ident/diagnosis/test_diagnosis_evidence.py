"""Block sums say the same as the rows that they are made of."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.arrays import Array, freeze
from ident.diagnosis.diagnose import Analysis
from ident.effects import optional
from ident.effects.catalogue import CATALOGUE
from ident.inference.search import SetSearch
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion
from ident.regression import block_sums
from ident.regression import rows as rows_module
from ident.regression.block_sums import SymmetricSums
from ident.regression.cross_validation import HeldOut
from ident.regression.design import LOSS_PARAMETERS, Group, Layout, build_layout
from ident.regression.discrepancy import unusual_torque
from ident.regression.dwells import HeldFriction
from ident.regression.gather import gather
from ident.regression.gram import Evidence
from ident.regression.least_squares import RIDGE, Prior, project
from ident.regression.noise import estimate_noise, shorter_filters, whiten_after_gaps
from ident.regression.partition import build_partition
from ident.regression.rows import Rows, compute_rows
from ident.regression.runs import leftover_torque
from ident.regression.spooled import SpooledArrays
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import all_evidence, analyse, gain_on_2, scorer_of, search_of


@pytest.fixture(scope="module")
def healthy(healthy: Analysis) -> Analysis:
    """The same with sums of rows in motion alone, without its holds."""
    known = all_evidence(healthy)
    session, rank = healthy.session, healthy.baseline.base.rank
    unusual = unusual_torque(session, leftover_torque(session))
    screened = [optional.screened(effect, session, unusual) for effect in CATALOGUE]
    layout = build_layout(session, rank, screened, beside=(HeldFriction(),))
    moving = gather(session, healthy.baseline, layout, known.whitening)
    return replace(healthy, evidence=moving.with_run_spread(known.spread))


@pytest.fixture(scope="module")
def all_rows(healthy: Analysis) -> list[Rows]:
    partition = build_partition(healthy.session)
    return list(compute_rows(healthy.session, healthy.baseline, healthy.evidence.layout, partition))


@pytest.fixture(scope="module")
def whitened(healthy: Analysis, all_rows: list[Rows]) -> tuple[Array, Array, Array]:
    """All joints' whitened rows as one tall table, zeros where a joint has no such column; block; joint.

    Rows of a run are whitened for its own friction by the inverse square root of their covariance I + F Fᵀ.
    """
    return tall_rows(healthy.evidence, all_rows)


def tall_rows(evidence: Evidence, all_rows: list[Rows]) -> tuple[Array, Array, Array]:
    spread = evidence.spread[:, None] * evidence.friction.level
    tall, blocks, joints = [], [], []
    for rows in all_rows:
        for j, local in enumerate(evidence.layout.local):
            table = rows.tables[j] / evidence.scale[local]
            whole = rows.counts[:, j]
            filters = shorter_filters(evidence.whitening.coefficients[j], float(evidence.whitening.innovation[j]))
            white = whiten_after_gaps(table, whole, filters)
            wide = np.zeros((int(whole.sum()), evidence.layout.size + 1))
            friction = white[whole][:, evidence.layout.rank + 1 : evidence.layout.rank + 3] * spread[j]
            values, vectors = np.linalg.eigh(np.eye(len(wide)) + friction @ friction.T)
            wide[:, local] = (vectors / np.sqrt(values)) @ (vectors.T @ white[whole])
            tall.append(wide)
            blocks.append(rows.blocks[whole])
            joints.append(np.full(len(wide), j))
    return np.concatenate(tall), np.concatenate(blocks), np.concatenate(joints)


def prior_rows(information: Array) -> Array:
    """Rows R with Rᵀ R = information, to stand below a least-squares problem."""
    values, vectors = np.linalg.eigh(information)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


def least_squares(tall: Array, inside: Array, prior: Prior, ridge: float = RIDGE) -> tuple[Array, float]:
    """Coefficients and misfit (prior included) of the columns `inside`, by numpy on the rows themselves."""
    x, y = tall[:, inside], tall[:, -1]
    information = np.diag(ridge * (x**2).sum(axis=0) + 1e-9)
    rank = len(prior.base)
    information[:rank, :rank] += prior.base + ridge * np.diag(np.diag(prior.base))
    if prior.further is not None:
        further = slice(rank + LOSS_PARAMETERS * 3, rank + LOSS_PARAMETERS * 3 + len(prior.further))
        information[further, further] += np.diag((1.0 + ridge) * prior.further)
    below = prior_rows(information)
    estimate = np.linalg.lstsq(np.vstack([x, below]), np.concatenate([y, np.zeros(len(below))]), rcond=None)[0]
    misfit = float(np.sum((y - x @ estimate) ** 2) + np.sum((below @ estimate) ** 2))
    return estimate, misfit


def test_gram_is_the_product_of_the_rows(healthy: Analysis, whitened: tuple[Array, Array, Array]) -> None:
    """Law: Σ_b G_b = XᵀX, to rounding, and each joint counts as many samples as it has rows."""
    tall, _, joints = whitened
    gram = healthy.evidence.gram()
    assert np.allclose(gram, tall.T @ tall, rtol=0, atol=1e-9 * np.abs(gram).max())
    assert np.array_equal(healthy.evidence.samples, np.bincount(joints))


def test_sums_that_wait_on_disk_are_the_same(healthy: Analysis, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: to the bit, whatever column ceases to be zero in which run, and so is what folds are made of."""
    known = healthy.evidence
    monkeypatch.setattr(block_sums, "HELD_NUMBERS", 0)
    spooled = gather(healthy.session, healthy.baseline, known.layout, known.whitening).with_run_spread(known.spread)
    columns = np.arange(known.layout.rank + LOSS_PARAMETERS)
    for j, (one, other) in enumerate(zip(known.free, spooled.free, strict=True)):
        assert isinstance(other.half, SpooledArrays)
        assert np.array_equal(one.over(), other.over())
        assert np.array_equal(known.times(j, np.ones(one.size)), spooled.times(j, np.ones(one.size)))
        for ours, theirs in zip(known.fold_sums(j, columns), spooled.fold_sums(j, columns), strict=True):
            assert np.array_equal(ours, theirs)
        assert np.array_equal(known.plain[j].part(columns), spooled.plain[j].part(columns))


@pytest.mark.parametrize(("count", "shown"), [(6, 7), (300, 9)])
def test_rows_that_are_added_are_in_all_that_is_made_of_the_sums(count: int, shown: int) -> None:
    """Law: totals, parts, squares and products are those of matrices to which the rows were added, in any units."""
    rng = np.random.default_rng(3)
    tables = rng.standard_normal((4, 30, 9)) * rng.permutation(np.arange(9) < shown)  # others are in the rows alone
    rows, place = rng.standard_normal((count, 9)), rng.choice([0, 1, 3], count)
    plain = np.stack([table.T @ table for table in tables])
    sums = SymmetricSums.of(plain).divided(2.0).with_rows(rows, place).divided(0.5)
    expected = plain + 2.0 * np.stack([rows[place == block].T @ rows[place == block] for block in range(4)])
    columns, weights = np.array([7, 0, 3]), rng.standard_normal(9) * (np.arange(9) % 2)
    assert np.allclose(sums.part(np.arange(9)), expected)
    assert np.allclose(sums.over([1, 3]), expected[[1, 3]].sum(axis=0))
    assert np.allclose(sums.part(columns), expected[:, columns[:, None], columns])
    assert np.allclose(sums.diagonal(), np.diag(expected.sum(axis=0)))
    assert np.allclose(sums.times(weights), expected @ weights)


def test_projection_is_least_squares(healthy: Analysis, whitened: tuple[Array, Array, Array]) -> None:
    """Law: the solution from sums is numpy's least squares on the rows, the prior as further rows; to 1e-6."""
    prior = Prior.of(healthy.evidence, healthy.baseline.prior)
    projection = project(healthy.evidence.gram(), healthy.evidence, prior)
    estimate, _ = least_squares(whitened[0], projection.inside, prior)
    assert np.allclose(projection.estimate, estimate, rtol=1e-6, atol=1e-6 * np.abs(estimate).max())


def test_gain_of_a_group_is_the_fall_of_the_misfit(healthy: Analysis, whitened: tuple[Array, Array, Array]) -> None:
    """Law (Frisch, Waugh, Lovell): what a group of free signs gains by the Schur complement is the fall of the misfit
    of a regression with its columns, to 0.1 % of the misfit's unit or of the gain.
    """
    prior = Prior.of(healthy.evidence, healthy.baseline.prior)
    projection = project(healthy.evidence.gram(), healthy.evidence, prior)
    _, before = least_squares(whitened[0], projection.inside, prior)
    tried = 0
    for group in healthy.evidence.layout.groups:
        clear = projection.visibility(group.columns).min() > 0.05
        if group.effect.nonnegative or not clear or tried >= 8:
            continue
        tried += 1
        _, after = least_squares(whitened[0], np.concatenate([projection.inside, group.columns]), prior)
        assert projection.gain(group)[0] == pytest.approx(before - after, rel=1e-3, abs=1e-3), group.key
    assert tried >= 5


def test_a_model_seen_by_some_columns_says_the_same_of_them(healthy: Analysis) -> None:
    evidence = healthy.evidence
    gram, prior = evidence.gram(), Prior.of(evidence, healthy.baseline.prior)
    whole = project(gram, evidence, prior)
    for group in evidence.layout.groups[::7]:
        part = project(gram, evidence, prior, (), np.append(group.columns, len(gram) - 1))
        for name in ("rest", "visibility", "seen"):
            assert getattr(part, name)(group.columns) == pytest.approx(getattr(whole, name)(group.columns))
        assert part.gain(group)[0] == pytest.approx(whole.gain(group)[0])
        assert part.gain(group)[1] == pytest.approx(whole.gain(group)[1])


def test_held_out_score_is_a_refit_without_the_fold(healthy: Analysis, whitened: tuple[Array, Array, Array]) -> None:
    """Law: the score of a fold comes from coefficients that never saw it: refitted rows give the same misfit."""
    tall, blocks, joints = whitened
    evidence = healthy.evidence
    prior = Prior.of(evidence, healthy.baseline.prior)
    score = HeldOut(evidence, prior).score()
    inside = np.arange(evidence.layout.tuned)
    for fold in (0, 3):
        held = evidence.fold_of_block[blocks] == fold
        estimate, _ = least_squares(tall[~held], inside, prior, ridge=1e-8)
        left = tall[:, -1] - tall[:, inside] @ estimate
        expected = [np.sum(left[held & (joints == j)] ** 2) for j in range(evidence.layout.n)]
        assert np.allclose(score.misfit[fold], expected, rtol=1e-5)


def test_a_score_is_the_same_whatever_was_scored_before(healthy: Analysis) -> None:
    """Law: sums that are kept from one model to the next change nothing."""
    prior = Prior.of(healthy.evidence, healthy.baseline.prior)
    several = HeldOut(healthy.evidence, prior)
    for groups in ((), *((group,) for group in healthy.evidence.layout.groups[::9])):
        alone = HeldOut(healthy.evidence, prior).score(groups)
        assert np.array_equal(several.score(groups).misfit, alone.misfit)
        assert np.array_equal(several.score(groups).squares, alone.squares)


def test_chunks_change_nothing(healthy: Analysis, all_rows: list[Rows], monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: how many runs are in memory, and wait there, changes neither the rows nor, in N m, their sums."""
    monkeypatch.setattr(rows_module, "CHUNK_SIZE", 500 * 9)
    layout = healthy.evidence.layout
    partition = build_partition(healthy.session)
    assert len(list(rows_module._chunks(healthy.session, range(len(healthy.session.runs))))) >= 3
    for one, other in zip(compute_rows(healthy.session, healthy.baseline, layout, partition), all_rows, strict=True):
        assert one.run == other.run
        assert np.array_equal(one.blocks, other.blocks)
        for a, b in zip(one.tables, other.tables, strict=True):
            assert np.allclose(a, b, rtol=1e-9, atol=1e-12)
    monkeypatch.setattr(rows_module, "WAITING_SIZE", 0)  # and on disk they wait as in memory
    chunked = gather(healthy.session, healthy.baseline, layout).with_run_spread(healthy.evidence.spread)
    assert np.array_equal(chunked.weights, healthy.evidence.weights)
    for local, a, b in zip(layout.local, chunked.plain, healthy.evidence.plain, strict=True):
        ours, theirs = np.outer(chunked.scale[local], chunked.scale[local]), healthy.evidence.scale[local]
        assert np.allclose(a.over() * ours, b.over() * np.outer(theirs, theirs), rtol=1e-7, atol=1e-9)


ONE_JOINT = Layout(0, 1, (), (np.zeros(0, dtype=int),), np.zeros(0, dtype=int), ())


def rows_of(table: Array, run: int = 0, counts: bool = True, drawn: tuple[Array, ...] | None = None) -> Rows:
    """A run's rows of one joint in one block."""
    size = len(table)
    return Rows(run, 0, (table,), np.full((size, 1), counts), np.zeros(size, dtype=int), drawn)


@pytest.mark.parametrize("bursts", [0, 2])
def test_whitening_finds_an_autoregression(bursts: int) -> None:
    """Law: of noise e_t = 0.6 e_{t−1} + 0.2 u_t the filter is (1, −0.6, 0, …) to 0.05, the innovation 0.2 and the level
    0.2 / √(1 − 0.36) to 5 %, whatever the columns beside it explain, and though some stretches of a run swing.
    """
    rng = np.random.default_rng(11)
    held = []
    for run in range(4):
        columns = rng.standard_normal((1500, 3))
        noise = lfilter([0.2], [1.0, -0.6], rng.standard_normal(1500))
        noise[: 100 * bursts] += 3.0 * np.sin(np.arange(100 * bursts))
        table = np.column_stack([columns, columns @ [3.0, -1.0, 0.5] + noise])
        held.append(rows_of(table, run))
    noise = estimate_noise(ONE_JOINT, held)
    assert np.allclose(noise.coefficients[0], [1.0, -0.6, 0.0, 0.0, 0.0], atol=0.05)
    assert noise.innovation[0] == pytest.approx(0.2, rel=0.05)
    assert noise.level[0] == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize("count", [90, 200])
def test_noise_over_fewer_rows_than_columns(count: int) -> None:
    """Bound: beside 300 columns of a smooth motion white noise of 0.4 N m over fewer rows comes back, in the mean of 20
    draws within a tenth and none beyond a third: what columns could explain of noise is not taken for theirs.
    """
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        waves = np.cos(np.pi * np.arange(count)[:, None] / count * np.arange(20))
        columns = waves @ rng.standard_normal((20, 303))
        torque = columns[:, 10:13] @ [3.0, -2.0, 4.0] + 0.4 * rng.standard_normal(count)
        rows = rows_of(np.column_stack([columns, torque]))
        found.append(float(estimate_noise(ONE_JOINT, [rows]).level[0]))
    assert np.mean(found) == pytest.approx(0.4, rel=0.1)
    assert all(0.27 < one < 0.6 for one in found)


def test_a_column_of_encoder_noise_explains_no_noise() -> None:
    """Law: what is mostly encoder noise knows that of the model's own columns; the level is what it is without it."""
    rng = np.random.default_rng(5)
    held = []
    for run in range(4):
        error = rng.standard_normal(1500)
        candidate = error + 0.05 * rng.standard_normal(1500)
        table = np.column_stack([rng.standard_normal((1500, 3)), candidate, 0.4 * error])
        drawn = np.zeros_like(table)
        drawn[:, 3] = rng.standard_normal(1500)
        held.append(rows_of(table, run, drawn=(drawn,)))
    assert estimate_noise(ONE_JOINT, held).level[0] == pytest.approx(0.4, rel=0.05)


def test_whitening_finds_the_noise_of_the_recordings(healthy: Analysis) -> None:
    """Bound: white noise of 0.3 N m at 50 Hz, filtered at 10 Hz, leaves 0.3 √(10 / 25) N m of level; to 15 %."""
    assert np.allclose(healthy.evidence.whitening.level, 0.3 * np.sqrt(10.0 / 25.0), rtol=0.15)


def test_noise_of_a_joint_that_stands_still() -> None:
    """Bound: of a joint without a row that counts the noise is that of its torque from sample to sample, to a tenth."""
    rng = np.random.default_rng(3)
    torque = 5.0 * np.sin(np.arange(2000) / 300.0) + 0.05 * rng.standard_normal(2000)
    rows = rows_of(torque[:, None], counts=False)
    assert estimate_noise(ONE_JOINT, [rows]).level[0] == pytest.approx(0.05, rel=0.1)


def test_a_column_that_was_encoder_noise_stays_out_of_the_model(healthy: Analysis) -> None:
    """What is left of it after the noise was taken off is anything; its coefficient, and all others, are not."""
    evidence, gram = healthy.evidence, healthy.evidence.gram().copy()
    prior = Prior.of(evidence, healthy.baseline.prior)
    groups = [one for one in evidence.layout.groups if len(one.columns) == 1][:2]
    column, noise = int(groups[1].columns[0]), evidence.noise_power.copy()
    noise[column] = 10.0 * gram[column, column]
    others = project(gram, evidence, prior, groups[:1]).estimate
    for share in (-0.05, 0.0):
        gram[column, column] = share * noise[column]
        found = project(gram, replace(evidence, noise_power=noise), prior, groups)
        assert abs(found.estimate[-1]) * np.sqrt(noise[column]) < 1e-2 * np.sqrt(gram[-1, -1])
        np.testing.assert_allclose(found.estimate[:-1], others, atol=1e-2 * np.abs(others).max())
    clear = project(evidence.gram(), evidence, prior)
    seen = np.setdiff1d(np.flatnonzero(clear.seen(np.arange(len(gram) - 1))), clear.inside)
    hidden = seen[[np.argmin(clear.visibility(seen))]]
    noise[:] = np.where(np.arange(len(gram)) < evidence.layout.tuned, np.diag(evidence.gram()), 0.0)
    assert not project(evidence.gram(), replace(evidence, noise_power=noise), prior).seen(hidden).any()


def test_signed_coefficients_are_not_negative(healthy: Analysis) -> None:
    """Law: columns of known sign never get a negative coefficient, and the sign costs gain or nothing."""
    prior = Prior.of(healthy.evidence, healthy.baseline.prior)
    projection = project(healthy.evidence.gram(), healthy.evidence, prior)
    signed = [group for group in healthy.evidence.layout.groups if group.effect.nonnegative]
    assert signed
    for group in signed:
        gain, beta = projection.gain(group)
        assert gain >= 0.0
        assert beta[[c for c in group.effect.nonnegative if c < len(beta)]].min() >= 0.0


def moved(q: np.ndarray) -> Motion:
    """One joint at 100 Hz on a known way."""
    dq = np.gradient(q, 0.01)
    states = [freeze(one[:, None]) for one in (q, dq, np.zeros_like(q), q)]
    time, std = np.arange(len(q)) / 100.0, np.full((3, 1), 1e-6)
    return Motion("one", ("a",), freeze(time), *states, Lowpass.design(100.0), freeze(std))


def test_reversals_do_not_count() -> None:
    """Law: of a swing sin 2πt/4 s no sample counts within 0.08 s of a reversal, and every one beyond 0.2 s does."""
    time = np.arange(800) / 100.0
    motion = moved(np.sin(2 * np.pi * time / 4.0))
    coarse = time[motion.coarse]
    distance = np.abs((coarse - 1.0 + 1.0) % 2.0 - 1.0)  # to the reversals at 1, 3, 5, 7 s
    inner = (coarse > 0.5) & (coarse < 7.5)
    assert not motion.settled[distance < 0.08].any()
    assert motion.settled[(distance > 0.2) & inner].all()


@pytest.mark.parametrize("creep", [0.004, 0.02])
def test_a_joint_counts_once_it_slides(creep: float) -> None:
    """Law: behind a turn no sample counts on the first 2 mrad, however long they take; further on all do."""
    time = np.arange(1200) / 100.0
    back = np.where(time < 4.0, 0.0, creep * np.minimum(time - 4.0, 3.0) + 0.3 * np.maximum(time - 7.0, 0.0))
    motion = moved(0.3 * np.minimum(time, 4.0) - back)
    coarse, gone = time[motion.coarse], back[motion.coarse]
    behind = (coarse > 4.3) & (coarse < 11.0)
    assert np.array_equal(motion.settled[behind, 0], gone[behind] > 0.002)


def friction_and_gain(search: SetSearch) -> tuple[list[Group], Group]:
    """Candidates for friction by load at joint 2, and that for a gain there."""
    at_2 = [group for group in search.names.groups if group.joint == 1]
    friction = [group for group in at_2 if group.effect.id == "load_dependent_friction"]
    (gain,) = (group for group in at_2 if group.effect.id == "torque_gain_error")
    return friction, gain


def test_a_law_in_the_model_keeps_its_signs(short_arm: ArmModel) -> None:
    """Law: friction by load that may push one way would be a wrong gain. Beside it, its coefficients not negative as
    no arm's are, a gain of 15 % keeps most of its evidence, and held-out runs speak for it.
    """
    analysis = analyse(short_arm, gain_on_2)
    search, held_out = search_of(analysis), scorer_of(analysis)
    every, gain = friction_and_gain(search)
    for friction in every:
        own = search.coefficients([friction])[friction]
        assert own[list(friction.signed)].min() >= 0.0
        assert search.nats([friction, gain]) - search.nats([friction]) > 0.5 * search.nats([gain])
        alone = held_out.score([gain]).gain_over(held_out.score())[0]
        beside = held_out.score([friction, gain]).gain_over(held_out.score([friction]))[0]
        assert beside > 0.25 * alone


def test_friction_by_load_beside_a_gain_is_known_in_its_sum(short_arm: ArmModel) -> None:
    """Law: a gain adds to one way what it takes from the other: each alone is hardly known, their sum is, one of them
    at its bound or not.
    """
    search = search_of(analyse(short_arm, gain_on_2))
    every, gain = friction_and_gain(search)
    friction = next(group for group in every if len(group.columns) == 2)
    chosen = [friction, gain]
    assert (search.coefficients(chosen)[friction] == 0.0).any()
    covariance = search.covariance(chosen, friction)
    assert np.sqrt(covariance.sum()) < 0.2 * np.sqrt(np.diag(covariance)).sum()
