"""Fast logs on a slower grid: the filtered signals are the same, and so is what is fitted on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ident.diagnosis.regression.baseline import fit_baseline
from ident.diagnosis.regression.decimation import decimate, decimation_factor, prepare_slower
from ident.motion.filter import FOR_DIAGNOSIS
from ident.motion.motion import Lowpass, prepare
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import healthy_torque
from tests.ident.made_up import made_motions, made_session

CUTOFF = 25.0


@pytest.mark.parametrize(("rate", "factor"), [(100.0, 1), (125.0, 1), (250.0, 1), (500.0, 4), (1000.0, 8)])
def test_only_fast_logs_are_decimated(rate: float, factor: int) -> None:
    """Law: five samples a period of the corner stay, and logs up to 250 Hz are left as they are."""
    assert decimation_factor(rate, CUTOFF) == factor


def test_filtered_signals_are_those_of_the_fast_log(short_arm: ArmModel) -> None:
    """Law: torque and states pass the common filter as they would have at 1 kHz, within 2 %."""
    session = made_session(short_arm, lambda *x: healthy_torque(short_arm, *x), (1,), 6.0, 1000.0)
    (fast,) = prepare(session, CUTOFF, settings=FOR_DIAGNOSIS)
    (slow,) = prepare_slower(session, CUTOFF)
    assert (fast.lowpass.rate, slow.lowpass.rate) == pytest.approx((1000.0, 125.0))
    assert slow.lowpass.cutoff == pytest.approx(fast.lowpass.cutoff)
    inner, whole = slice(20, -20), Lowpass(fast.lowpass.rate, CUTOFF, 1)
    for name in ("tau", "dq", "ddq"):
        exact = np.stack(
            [np.interp(slow.time[slow.coarse], fast.time, v) for v in whole(getattr(fast, name)).T], axis=1
        )
        found = slow.filtered(getattr(slow, name))
        assert np.abs(found - exact)[inner].max() < 0.02 * np.abs(exact).max()


def test_losses_are_those_of_the_fast_log(short_arm: ArmModel) -> None:
    """Bound: rotor inertia, viscous and Coulomb friction from 1 kHz and from 125 Hz agree within 2 %."""
    fast = made_motions(short_arm, lambda *x: healthy_torque(short_arm, *x), range(3), 8.0, 1000.0, noise=0.3)
    lowpass = Lowpass.design(1000.0, CUTOFF, FOR_DIAGNOSIS)
    fast = [replace(motion, lowpass=lowpass, settings=FOR_DIAGNOSIS) for motion in fast]
    slow = [decimate(motion) for motion in fast]
    losses = [fit_baseline(motions, short_arm).loss for motions in (fast, slow)]
    for name in ("motor_inertia", "viscous", "coulomb"):
        np.testing.assert_allclose(getattr(losses[1], name), getattr(losses[0], name), rtol=0.02)
