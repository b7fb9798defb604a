"""Laws of what all modules ask of arrays."""

import numpy as np
import pytest

from ident.arrays import least_squares


def test_least_squares_come_to_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: where LAPACK's fast way gives up, the solution is the same one, columns of zeros or of one kind included."""
    rng = np.random.default_rng(0)
    table, target = rng.normal(size=(20, 6)), rng.normal(size=20)
    table[:, 2], table[:, 4] = 0.0, 2.0 * table[:, 3]
    fast = least_squares(table, target, 1e-8)

    def give_up(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr("numpy.linalg.lstsq", give_up)
    np.testing.assert_allclose(least_squares(table, target, 1e-8), fast, atol=1e-12)
