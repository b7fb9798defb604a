"""Sensors that tell something else than what is."""

from __future__ import annotations

from ident.simulation.causes.base import Cause, Circumstances, Parameters, between
from ident.simulation.hardware import Hardware

# What a wrong calibration makes of a drive that still follows its reference: current gains, ages of readings [s],
# encoder zeros [rad].
GAINS, LARGEST_DELAY_S, ENCODER_ZEROS = (-0.4, 0.6), 0.05, (-0.1, 0.1)


def _gain(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    sensing = scene.hardware.sensing.set(scene.joint, gain=1.0 + size)
    return scene.hardware.replace(sensing=sensing), {"gain": size}


def _offset(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """An offset that drifts by about a tenth of itself in a minute, and wanders a little."""
    drift = float(size * scene.rng.uniform(-0.1, 0.1) / 60.0)
    sensing = scene.hardware.sensing.set(scene.joint, offset=size, drift=drift, wander=0.03 * abs(size))
    return scene.hardware.replace(sensing=sensing), {"offset_Nm": size, "drift_Nm_s": drift}


def _delay(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    return scene.hardware.replace(sensing=scene.hardware.sensing.replace(delay=size)), {"delay_s": size}


def _saturation(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    sensing = scene.hardware.sensing.set(scene.joint, limit=size)
    return scene.hardware.replace(sensing=sensing), {"limit_Nm": size}


def _encoder(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    sensing = scene.hardware.sensing.set(scene.joint, encoder_offset=size)
    return scene.hardware.replace(sensing=sensing), {"offset_rad": size}


def _delay_bounds(scene: Circumstances) -> tuple[float, float]:
    """Drives whose readings are older have lost them; none is older than the shortest run."""
    return 0.0, min(LARGEST_DELAY_S, *(motion.duration for motion in scene.motions))


SENSOR = (
    Cause("torque_gain_error", "gain", lambda s: 0.06, between(*GAINS), _gain, view="loss"),
    Cause("torque_offset", "offset_Nm", lambda s: 0.004 * s.rated, lambda s: (-s.rated, s.rated), _offset, view="raw"),
    Cause("torque_delay", "delay_s", lambda s: 0.008, _delay_bounds, _delay, whole_arm=True),
    Cause(
        "torque_saturation",
        "limit_Nm",
        lambda s: 0.75 * s.peak_torque(),
        lambda s: (1e-3 * s.rated, 2.0 * s.rated),
        _saturation,
        inverse=True,
    ),
    Cause("encoder_offset", "offset_rad", lambda s: 0.015, between(*ENCODER_ZEROS), _encoder, view="loss"),
)
