"""Laws of the plant's friction: it sticks, it slides at its level, and it never gives energy."""

import numpy as np
import pytest

from ident.simulation.laws import (
    bristle,
    change_law,
    cool_down,
    heat_law,
    plain_friction,
    sliding_level,
    viscous_drag,
    warm_up,
)
from ident.simulation.loop import fresh_state

DT = 5e-4


def joint(**values):
    law = plain_friction(np.array([10.0]), np.array([5.0]), np.array([1.0]))
    return change_law(law, **values)[0]


def level(record, v, angle=0.0, load=0.0, acceleration=0.0, warm=0.0):
    return sliding_level(record, v, angle, load, acceleration, warm)


def test_sliding_friction_is_its_level():
    """After some presliding the bristle's torque is the level, against the motion."""
    z, torque = 0.0, 0.0
    for _ in range(2000):
        z, torque = bristle(z, 0.3, 10.0, 5e4, 100.0, DT)
    assert torque == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_rest_holds_any_torque_below_the_level(share):
    """A body pushed with less than the level creeps by no more than the presliding; with more it runs away."""
    travel = []
    for load in (share * 10.0, 1.3 * 10.0):
        z = v = x = 0.0
        for k in range(6000):
            z, torque = bristle(z, v, 10.0, 5e4, 250.0, DT)
            v += DT * (load * min(k / 3000, 1.0) - torque)
            x += DT * v
        travel.append(x)
    assert travel[0] < 2e-3
    assert travel[1] > 1.0


def test_rest_does_not_creep():
    """Held for ten times as long, the joint has not moved further."""
    z = v = x = 0.0
    marks = []
    for k in range(20000):
        z, torque = bristle(z, v, 10.0, 5e4, 250.0, DT)
        v += DT * (6.0 - torque)
        x += DT * v
        if k in (1999, 19999):
            marks.append(x)
    assert marks[1] - marks[0] < 1e-6


def test_a_cycle_loses_energy():
    """Over any closed path friction takes energy, also below the breakaway."""
    for amplitude in (1e-5, 1e-4, 1e-2):
        phase = np.linspace(0.0, 8.0 * np.pi, 8000)
        speed, z, work = amplitude * np.cos(phase) * np.pi, 0.0, 0.0
        for v in speed:
            z, torque = bristle(z, v, 10.0, 5e4, 100.0, DT)
            work += torque * v * DT
        assert work > 0.0


def test_soft_contact_remembers_displacement_not_time():
    """The torque after a reversal depends on the way gone since, whatever the speed."""
    ends = []
    for speed in (0.01, 0.05):
        z = 0.0
        for _ in range(int(0.2 / speed / DT)):
            z, torque = bristle(z, -speed, 3.0, 300.0, 0.0, DT)
        for _ in range(int(0.008 / speed / DT)):
            z, torque = bristle(z, speed, 3.0, 300.0, 0.0, DT)
        ends.append(torque)
    assert ends[0] == pytest.approx(ends[1], abs=0.02)
    assert -3.0 < ends[0] < 2.5


def test_levels_move_with_their_own_cause_only():
    """Stribeck with low speed, load with torque, seat with angle, heat with temperature, skidding with acceleration."""
    assert level(joint(stribeck=4.0), 1e-4) == pytest.approx(14.0, rel=1e-2)
    assert level(joint(stribeck=4.0), 2.0) == pytest.approx(10.0, rel=1e-6)
    assert level(joint(load=0.1), 0.5, load=50.0) > level(joint(load=0.1), 0.5, load=-50.0) > 13.0
    assert level(joint(load=0.1), 0.5) == pytest.approx(10.0, abs=0.1)
    angles = [level(joint(seat=0.2), 0.5, angle=a) for a in np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)]
    assert np.mean(angles) == pytest.approx(10.0, rel=1e-3)
    assert np.ptp(angles) == pytest.approx(4.0, rel=0.1)
    assert level(joint(thermal_coulomb=0.01), 0.5, warm=20.0) == pytest.approx(10.0 * np.exp(-0.2))
    assert level(joint(skid=3.0), 0.5, acceleration=20.0) == pytest.approx(13.0, rel=1e-3)
    assert level(joint(coulomb_skew=2.0), 0.5) - level(joint(coulomb_skew=2.0), -0.5) == pytest.approx(2.0)


def test_lubricant_thins_with_speed_and_heat():
    """Shear thinning is concave in speed; viscosity falls with temperature."""
    thin = joint(viscous=0.0, eyring=2.0)
    drag = [viscous_drag(thin, v, 0.0) for v in (0.5, 1.0, 1.5)]
    assert drag[2] - drag[1] < drag[1] - drag[0]
    warm = joint(thermal_viscous=0.02)
    assert viscous_drag(warm, 1.0, 25.0) == pytest.approx(5.0 * np.exp(-0.5))


def test_heat_settles_where_loss_and_cooling_balance():
    """Under the rated loss the lubricant ends at the stated rise, and cools down in a pause."""
    network = heat_law(np.array([6.0]), rise=25.0, time_constant=20.0)
    state, record = fresh_state(1), network[0]
    for _ in range(200000):
        warm_up(record, state[0], 6.0, 0.02)
    assert state["lubricant_rise"][0] == pytest.approx(25.0, rel=0.02)
    rise = np.column_stack([state["lubricant_rise"], state["housing_rise"]])
    assert cool_down(network, rise, 0.0) == pytest.approx(rise)
    assert cool_down(network, rise, 1e5) == pytest.approx(0.0, abs=1e-3)
    twice = cool_down(network, cool_down(network, rise, 30.0), 30.0)
    assert twice == pytest.approx(cool_down(network, rise, 60.0))
