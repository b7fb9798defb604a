"""A discrepancy: it sees nothing in noise, what a law leaves, and less beside the right law than beside a wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import NO_LAW, diagnose
from ident.diagnosis.gap.ceiling import _repeated
from ident.diagnosis.gap.settings import USUAL_CEILING
from ident.diagnosis.regression.least_squares import Prior
from ident.diagnosis.regression.posterior import Posterior, estimate_variances
from ident.diagnosis.settings import USUAL
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, at_joint, loaded, record, spring_on_3

SAMPLES = 2400
SIZES = (40, 30)


def _sums(rng: np.random.Generator, deviation: float) -> Array:
    """Sums of two blocks' columns and a torque of unit noise, to which the first block adds by so much."""
    columns = rng.normal(size=(SAMPLES, sum(SIZES)))
    torque = rng.normal(size=SAMPLES)
    torque += columns[:, : SIZES[0]] @ rng.normal(size=SIZES[0]) * deviation / np.sqrt(SIZES[0])
    table = np.column_stack([columns, torque])
    return np.asarray(table.T @ table)


def test_noise_is_no_discrepancy() -> None:
    """Law: of forty draws of noise none speaks for a discrepancy by more than 5 nats."""
    rng = np.random.default_rng(11)
    found = [estimate_variances(_sums(rng, 0.0), SIZES) for _ in range(40)]
    assert max(one.evidence for one in found) < 5.0


@pytest.mark.parametrize("deviation", [0.3, 1.0, 10.0])
def test_variances_are_those_of_the_blocks(deviation: float) -> None:
    """Law: the variance of a block that acts comes back within the grid's step and the draw's error, the other's is
    none, and the block that acts is the one that explains most.
    """
    rng = np.random.default_rng(12)
    found = estimate_variances(_sums(rng, deviation), SIZES)
    assert found.kind == "state"
    assert np.log10(found.variances[0] / deviation**2) == pytest.approx(0.0, abs=0.4)
    assert found.variances[1] <= 0.1
    assert found.evidence > 30.0


def test_a_law_of_the_whole_arm_counts_all_its_joints(short_arm: ArmModel) -> None:
    """Law: beside a discrepancy at each of two joints a payload gains, and leaves, what it does at the one and the
    other; where it explains all that there is, little is left for a discrepancy and its Bayes factor is large.
    """
    analysis = analyse(short_arm, loaded, [find_effect("payload")])
    evidence, (name,) = analysis.evidence, analysis.search.named
    prior = Prior.of(evidence, analysis.baseline.prior)
    posterior = Posterior.gather(analysis.session, analysis.baseline, evidence, prior, [name.group], [1, 2])
    both, first, second = (posterior.beside(0, joints) for joints in ([1, 2], [1], [2]))
    for part in ("gain", "left", "instead"):
        assert getattr(both, part) == pytest.approx(getattr(first, part) + getattr(second, part))
    assert min(first.gain, second.gain) > 0.0
    assert both.log_bayes_factor > 30.0


def test_what_a_discrepancy_explains_as_cheaply_is_a_reservation(short_arm: ArmModel) -> None:
    """Law: of a name that is believed less than the least, the result says why, and that something is there."""
    verdict = replace(USUAL.verdict, least_believed=1.1)
    settings = replace(USUAL, verdict=verdict)
    found = diagnose(record(short_arm, spring_on_3), short_arm, CATALOGUE, common_clock=False, settings=settings)
    assert found.diagnosis.findings == ()
    assert ("spring_torque", NO_LAW) in {(one.effect, one.reason) for one in found.diagnosis.reservations}
    assert found.diagnosis.verdict == "none_of_catalogue"


def test_neighbours_of_the_angle_see_teeth_and_nothing_in_noise() -> None:
    """Bound: a wave of 70 periods a radian, as large as its noise, is foretold; of ten draws of noise none is."""
    rng = np.random.default_rng(12)
    angle = np.concatenate([np.linspace(0.0, 1.0, 1200), np.linspace(1.0, 0.0, 1200)])
    piece = np.arange(SAMPLES) * 40 // SAMPLES
    wave = np.sqrt(2.0) * np.sin(440.0 * angle)
    assert _repeated(angle, wave + rng.normal(size=SAMPLES), piece, USUAL_CEILING) > 0.2
    assert all(_repeated(angle, rng.normal(size=SAMPLES), piece, USUAL_CEILING) == 0.0 for _ in range(10))


def test_a_gap_that_is_seen_by_neighbours_alone_is_reported(short_arm: ArmModel) -> None:
    """Law: teeth at one joint, no name for them at hand: there is a gap, at that joint and of its state."""

    def teeth(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        return at_joint(1, 1.2 * np.sin(60.0 * q[:, 1]))

    diagnosis = analyse(short_arm, teeth, []).diagnosis
    assert diagnosis.verdict == "none_of_catalogue"
    assert diagnosis.gap["joint_2"].unexplained == "state"
    assert max(diagnosis.details.leftover) == diagnosis.details.leftover[1] > 1.0
