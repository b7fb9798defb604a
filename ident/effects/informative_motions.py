"""Which motion shows an effect, and what tells two effects apart that one recording cannot.

Running a path both ways parts odd torques from even ones, a ladder of speeds parts the laws of friction, a change of
pose parts what follows the load from what follows the angle. Where two effects are the same torque in every motion,
only another set-up of the arm parts them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations


@dataclass(frozen=True)
class Showing:
    """A kind of motion and what it takes.

    Attributes:
        family: Short name; `plan excite` has motions of these names.
        words: What to do, with {joint} for the joint.
        minutes: Usual length [min].
    """

    family: str
    words: str
    minutes: float


SHOWINGS: dict[str, Showing] = {
    one.family: one
    for one in (
        Showing("ladder", "{joint} there and back at steady speeds from 0.02 rad/s to its fastest", 4),
        Showing("reversals", "{joint} slowly to and fro between ever nearer turning points", 3),
        Showing("chirp", "{joint} and its neighbours swept in frequency, to 10 Hz or so, about poses under load", 3),
        Showing("holds", "standstill in many poses, each approached from both sides, and {joint} both ways between", 4),
        Showing("poses", "the same path of {joint} both ways, repeated in other poses of the other joints", 4),
        Showing("wide", "all joints fast over wide poses", 4),
        Showing("vias", "all joints by clamped splines through chosen via points", 4),
        Showing("random", "all joints there and back through random points, as fast as their limits allow", 4),
        Showing("jointwise", "one joint after the other, the rest at standstill", 4),
        Showing("slow", "{joint} at two slow steady speeds, 0.02 and 0.04 rad/s", 4),
        Showing("repeat", "one motion of {joint} cold, after ten minutes of fast work, and after a rest", 25),
        Showing("loaded", "{joint} at its highest loads: arm stretched out, fast starts and stops", 3),
        Showing("free", "the same motion again in free space, with nothing near the arm", 2),
    )
}

# The motion without which an effect can't be seen, from the catalogue's column "seen only with".
SHOWN_BY: dict[str, str] = {
    "stribeck_friction": "ladder",
    "nonlinear_viscous_friction": "ladder",
    "load_dependent_friction": "poses",
    "thermal_friction": "repeat",
    "presliding_hysteresis": "reversals",
    "position_dependent_friction": "poses",
    "asymmetric_friction": "ladder",
    "joint_coupling": "jointwise",
    "joint_elasticity": "chirp",
    "backlash": "reversals",
    "torque_ripple": "slow",
    "spring_torque": "poses",
    "payload": "wide",
    "link_inertial_error": "wide",
    "gravity_misalignment": "wide",
    "torque_gain_error": "wide",
    "torque_offset": "holds",
    "torque_delay": "chirp",
    "torque_saturation": "loaded",
    "encoder_offset": "wide",
    "external_contact": "free",
}

# What parts two effects, where it is not simply the motion that shows one of them.
_PARTED_BY: dict[frozenset[str], str] = {
    frozenset(pair): family
    for *pair, family in (
        ("stribeck_friction", "presliding_hysteresis", "ladder"),
        ("stribeck_friction", "thermal_friction", "repeat"),
        ("nonlinear_viscous_friction", "thermal_friction", "repeat"),
        ("nonlinear_viscous_friction", "presliding_hysteresis", "ladder"),
        ("torque_offset", "asymmetric_friction", "ladder"),
        ("torque_offset", "thermal_friction", "repeat"),
        ("spring_torque", "gravity_misalignment", "poses"),
        ("spring_torque", "link_inertial_error", "poses"),
        ("joint_elasticity", "link_inertial_error", "chirp"),
        ("joint_coupling", "link_inertial_error", "jointwise"),
    )
}

_KNOWN_MASS = (
    "hang a known mass on the flange, give it as [payload] in session.toml, and record the same motion again: its "
    "torque is known, so the gain is; a wrong mass of the links changes nothing about it"
)
# Two effects that are the same torque, or nearly so, in every motion: what parts them is another set-up.
_SETUPS: dict[frozenset[str], str] = {
    frozenset(pair): advice
    for *pair, advice in (
        (
            "payload",
            "link_inertial_error",
            "take everything off the flange, note it in session.toml, and record the same motion again: what stays "
            "belongs to the last link; or hang a known mass on and give it as [payload]",
        ),
        ("torque_gain_error", "link_inertial_error", _KNOWN_MASS),
        ("torque_gain_error", "all_masses", _KNOWN_MASS),
        (
            "torque_gain_error",
            "payload",
            "record the same motion with a known mass on the flange ([payload] of session.toml) and without it: the "
            "difference is known, so the gain is",
        ),
        (
            "torque_offset",
            "asymmetric_friction",
            "log ten seconds at standstill with the brakes closed and the drives idle, before and after the motion: no "
            "friction reaches the motor then, and what its torque reads is the offset; standstill under control does "
            "not do, friction stays in the joint there",
        ),
        (
            "gravity_misalignment",
            "link_inertial_error",
            "turn the base by a quarter about the vertical, or level it with a spirit level, and record the same "
            "motion again: a tilt turns with the base, the links' masses don't",
        ),
        (
            "gravity_misalignment",
            "encoder_offset",
            "turn the base by a quarter about the vertical and record the same motion again: a tilt changes its sign "
            "over the joints, an encoder's zero doesn't",
        ),
    )
}


def family_for(effects: Sequence[str]) -> str:
    """The kind of motion that shows effects, or parts the first pair of them that has one of its own."""
    for pair in combinations(effects, 2):
        if frozenset(pair) in _PARTED_BY:
            return _PARTED_BY[frozenset(pair)]
    known = [SHOWN_BY[effect] for effect in effects if effect in SHOWN_BY]
    return max(known, key=known.count) if known else "wide"


def describe_motion(family: str, joint: str) -> str:
    """A kind of motion in words, for one joint."""
    return SHOWINGS[family].words.format(joint=joint)


def setup_for(effects: Sequence[str]) -> str | None:
    """The change of set-up that parts effects which no motion, or hardly any, can part; None where motion does."""
    for pair in combinations(effects, 2):
        if frozenset(pair) in _SETUPS:
            return _SETUPS[frozenset(pair)]
    return None
