"""Laws of the losses' torque."""

import numpy as np

from ident.laws.motion import direction
from ident.model.loss import LossParameters


def test_torque_is_eq_3() -> None:
    """B ddq + C dq + f sign(dq) + offset, with tanh in place of the sign where a width is given; zero() has none."""
    params = LossParameters([2.0, 2.0], [3.0, 3.0], [5.0, 5.0], [0.5, 0.5], [0.0, 0.1])
    dq, ddq = np.array([[0.1, 0.1], [-0.1, 0.0], [0.0, -1.0]]), np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    near = np.tanh(1.0)
    expected = [[7.8, 2.8 + 5 * near], [-4.8, 0.5], [0.5, -2.5 - 5 * np.tanh(10.0)]]
    assert np.allclose(params.torque(dq, ddq), expected)
    assert np.all(LossParameters.zero(2).torque(dq, ddq) == 0.0)
    assert np.all(np.abs(direction(10 * dq, params.transition_speed)) <= 1.0)
