"""Log evidence of linear Gaussian models, the variances where it is greatest, and sums that are positive."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime, minimize
from scipy.stats import multivariate_normal

from ident.arrays import Array
from ident.inference import evidence
from ident.inference.evidence import factorise, log_evidence, optimise
from ident.inference.sums import without_negative_directions

SAMPLES = 2400
SIZES = (40, 30)
STARTS = (1e-4, 1e-1)


def sums_of(rng: np.random.Generator, deviation: float) -> Array:
    """Sums of two blocks' columns and a torque of unit noise, to which the first block adds by so much."""
    columns = rng.standard_normal((SAMPLES, sum(SIZES)))
    coefficients = rng.standard_normal(SIZES[0]) * deviation / np.sqrt(SIZES[0])
    torque = rng.standard_normal(SAMPLES) + columns[:, : SIZES[0]] @ coefficients
    table = np.column_stack([columns, torque])
    return np.asarray(table.T @ table)


def best_variances(sums: Array) -> evidence.BlockVariances:
    """Variances of the two blocks, the better of two starts."""
    fits = [optimise(sums[:-1, :-1], sums[:-1, -1], SIZES, np.full(2, start)) for start in STARTS]
    return max(fits, key=lambda fit: fit.nats)


@pytest.mark.parametrize("seed", range(5))
def test_log_evidence_is_that_of_the_dense_gaussian(seed: int) -> None:
    """Law: it is the marginal likelihood of the rows; means and variances are those of the posterior."""
    rng = np.random.default_rng(seed)
    columns, torque = rng.standard_normal((30, 6)), 2.0 * rng.standard_normal(30)
    deviation = np.exp(rng.standard_normal(6))
    solved = log_evidence(columns.T @ columns, columns.T @ torque, deviation)
    covariance = columns @ np.diag(deviation**2) @ columns.T + np.eye(30)
    dense = multivariate_normal(cov=covariance).logpdf(torque)
    none = multivariate_normal(cov=np.eye(30)).logpdf(torque)
    assert solved.nats == pytest.approx(float(dense - none), abs=1e-8)
    posterior = np.linalg.inv(columns.T @ columns + np.diag(deviation**-2.0))
    assert solved.variance == pytest.approx(np.diag(posterior), abs=1e-10)
    assert solved.mean == pytest.approx(posterior @ columns.T @ torque, abs=1e-10)


def test_a_coefficient_without_deviation_is_not_there() -> None:
    """Law: a deviation of zero is as good as leaving the column out."""
    rng = np.random.default_rng(7)
    columns, torque = rng.standard_normal((30, 4)), rng.standard_normal(30)
    gram, target = columns.T @ columns, columns.T @ torque
    whole = log_evidence(gram, target, np.array([1.0, 2.0, 0.0, 0.5]))
    fewer = [0, 1, 3]
    without = log_evidence(gram[np.ix_(fewer, fewer)], target[fewer], np.array([1.0, 2.0, 0.5]))
    assert whole.nats == pytest.approx(without.nats, abs=1e-9)
    assert whole.mean[2] == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_the_gradient_is_that_of_the_evidence(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: what the optimiser is told of the slope is what finite differences say, anywhere."""
    seen = []

    def spy(function, first, **options):  # type: ignore[no-untyped-def]
        seen.append(function)
        return minimize(function, first, **options)

    monkeypatch.setattr(evidence, "minimize", spy)
    rng = np.random.default_rng(seed)
    best_variances(sums_of(rng, 1.0))
    for _ in range(3):
        logs = rng.uniform(-8.0, 4.0, 2)
        by_differences = approx_fprime(logs, lambda at: seen[0](at)[0], 1e-6)
        assert seen[0](logs)[1] == pytest.approx(by_differences, rel=1e-3, abs=1e-2)


@pytest.mark.parametrize("deviation", [0.3, 1.0, 10.0])
def test_variances_are_those_of_the_blocks(deviation: float) -> None:
    """Law: the variance of a block that acts comes back within a factor of two, and the other's is far below it."""
    found = best_variances(sums_of(np.random.default_rng(12), deviation))
    expected = deviation**2 / SIZES[0]
    assert found.variances[0] == pytest.approx(expected, rel=1.0)
    assert found.variances[0] > 0.5 * expected
    assert found.variances[1] < 0.05 * found.variances[0]
    assert found.nats > 30.0


def test_noise_is_no_discrepancy() -> None:
    """Law: of forty draws of noise none speaks for a discrepancy by more than 5 nats."""
    rng = np.random.default_rng(11)
    found = [best_variances(sums_of(rng, 0.0)).nats for _ in range(40)]
    assert max(found) < 5.0


def test_variances_are_found_in_any_unit_of_the_columns() -> None:
    """Law: columns in a unit 300 times smaller are worth as much, and their variance is less by the square."""
    sums = sums_of(np.random.default_rng(12), 0.3)
    unit = np.append(np.full(sum(SIZES), 300.0), 1.0)
    found, large = best_variances(sums), best_variances(unit[:, None] * sums * unit)
    assert large.nats == pytest.approx(found.nats, abs=0.5)
    assert found.variances[0] / large.variances[0] == pytest.approx(300.0**2, rel=0.2)


@pytest.mark.parametrize("seed", range(5))
def test_positive_sums_are_left_as_they_are(seed: int) -> None:
    root = np.random.default_rng(seed).standard_normal((6, 6))
    sums = root @ root.T + 1e-3 * np.eye(6)
    np.testing.assert_array_equal(without_negative_directions(sums), sums)


@pytest.mark.parametrize("seed", range(5))
def test_sums_lose_their_negative_directions_and_no_other(seed: int) -> None:
    """Law: correlations keep all positive eigenvalues, negative ones are zero; units do not matter."""
    rng = np.random.default_rng(seed)
    vectors = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    sums = vectors @ np.diag([-0.4, -0.01, 0.2, 1.0, 2.0, 5.0]) @ vectors.T
    sums[np.diag_indices(6)] = np.maximum(np.diag(sums), 0.1)
    unit = 10.0 ** rng.uniform(-3.0, 3.0, 6)
    sums = unit[:, None] * sums * unit
    root = np.sqrt(np.diag(sums))
    before = np.linalg.eigvalsh(sums / np.outer(root, root))
    after = without_negative_directions(sums) / np.outer(root, root)
    assert before.min() < -1e-3
    assert np.linalg.eigvalsh(after) == pytest.approx(np.maximum(before, 0.0), abs=1e-10)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_factor_is_found_where_rounding_leaves_less_than_nothing(seed: int) -> None:
    """Law: L Lᵀ is the matrix to rounding, of any units; L has a positive diagonal, as the determinant asks for."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((12, 9)) * 10.0 ** rng.uniform(-4.0, 4.0, 9)
    units = 10.0 ** rng.uniform(-5.0, 5.0, 12)
    matrix = (root @ root.T) * np.outer(units, units)  # of twelve directions three are empty
    size = np.sqrt(np.diag(matrix))
    matrix -= np.diag(1e-14 * size**2)
    factor = factorise(matrix)
    assert (np.diag(factor) > 0.0).all()
    assert np.allclose(np.triu(factor, 1), 0.0)
    assert np.abs((factor @ factor.T - matrix) / np.outer(size, size)).max() < 1e-11


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e6])
def test_a_column_of_less_than_nothing_leaves_the_others_theirs(unit: float) -> None:
    """Law: a column whose square rounding put below zero has a factor, too; the rest of L is that without it."""
    rng = np.random.default_rng(5)
    root = rng.standard_normal((4, 6))
    others = unit * (root @ root.T)
    matrix = np.zeros((5, 5))
    matrix[:4, :4] = others
    matrix[4, 4] = -1e-16 * unit
    factor = factorise(matrix)
    assert (np.diag(factor) > 0.0).all()
    assert factor[4, 4] ** 2 < 1e-9 * unit
    assert np.allclose(factor[:4, :4], np.linalg.cholesky(others), rtol=1e-9)
