"""Slopes of a torque model by differences: an independent way to the derivatives that planners use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ident.arrays import Array
from plan.dynamics.power import ChainTorque, differentiate_torque


def slopes_by_differences(arm: ChainTorque, states: Sequence[Array]) -> Iterator[tuple[int, int, Array]]:
    """Central differences of the torque by (order, joint): position, speed or acceleration of each."""
    for order in range(len(states)):
        for joint in range(states[0].shape[1]):
            ends = []
            for sign in (1.0, -1.0):
                moved = [state.copy() for state in states]
                moved[order][:, joint] += sign * 1e-6
                ends.append(differentiate_torque(arm, *moved).tau)
            yield order, joint, (ends[0] - ends[1]) / 2e-6
