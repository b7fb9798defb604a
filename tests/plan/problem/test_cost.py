"""What a plan costs: its duration, or its energy and what the cell takes meanwhile."""

import numpy as np
import pytest

from plan.problem.cost import energy_cost, plan_cost


def test_energy_counts_the_cell_as_long_as_the_motion_lasts() -> None:
    assert energy_cost(30.0, 2.0, standby=5.0) == pytest.approx(40.0)
    assert plan_cost("energy", 2.0, lambda: 30.0, standby=5.0) == pytest.approx(40.0)


def test_a_batch_costs_as_its_members_do() -> None:
    durations = np.array([1.0, 2.0, 4.0])
    energies = np.array([9.0, 6.0, 5.0])
    costs = plan_cost("energy", durations, lambda: energies, standby=3.0)
    singly = [energy_cost(e, d, 3.0) for e, d in zip(energies, durations, strict=True)]
    assert costs == pytest.approx(singly)


def test_time_asks_for_no_energy() -> None:
    """Law: whoever wants the shortest motion need not know what it takes."""

    def energy() -> float:
        raise AssertionError("energy was asked for")

    assert plan_cost("time", 0.7, energy, standby=100.0) == 0.7
