"""What each format can say of each effect, and why not where it can't.

`yes`: the format states the same law. `approximate`: it states something near, told in the reason. `no`: it has no
words for it; the module does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ident.patches.change import Change
from ident.patches.standalone.laws import KNOWN
from ident.patches.standalone.log import SENSING

Answer = Literal["yes", "approximate", "no"]
FORMATS = ("urdf", "mjcf", "parameters", "module")


@dataclass(frozen=True)
class Expression:
    """How a format expresses an effect: the answer, and the reason or the place."""

    answer: Answer
    words: str

    def to_dict(self) -> dict[str, str]:
        return {"expressed": self.answer, "how": self.words}


def _yes(words: str) -> Expression:
    return Expression("yes", words)


def _near(words: str) -> Expression:
    return Expression("approximate", words)


def _no(words: str) -> Expression:
    return Expression("no", words)


_FRICTION = "knows damping and dry friction only; the pair that fits best without the effect is written instead"
_URDF_FRICTION = _no(f"<dynamics> {_FRICTION}")
_MJCF_FRICTION = _no(f"<joint> {_FRICTION}; add the module's torque to qfrc_applied")
_URDF_LOG = "describes the arm, not its log; correct the log with the module's torque_of_log"
_EVENT = _no("an event of the recording, not a property of the arm; the diagnosis gives no direction of the force")

URDF: dict[str, Expression] = {
    "spring_torque": _no("a joint has no spring; add the module's torque"),
    "joint_elasticity": _no("a joint has no spring between motor and link; add the module's torque"),
    "backlash": _no("a joint has no play; add the module's torque"),
    "torque_ripple": _no("a joint has no torque that depends on its angle; add the module's torque"),
    "payload": _yes("link `payload`, fixed to the last link"),
    "link_inertial_error": _yes("<inertial> of the link"),
    "gravity_misalignment": _yes("fixed joint `level_to_base` above the base, turned by the tilt"),
    "encoder_offset": _yes("<origin> of the joint, turned about its axis; its limits are moved along"),
    "torque_gain_error": _no(_URDF_LOG),
    "torque_offset": _no(_URDF_LOG),
    "torque_delay": _no(_URDF_LOG),
    "torque_saturation": _no(f"{_URDF_LOG}; no effort limit: the motion shows that the joint got more"),
    "external_contact": _EVENT,
}
MJCF: dict[str, Expression] = {
    "nonlinear_viscous_friction": _near("polynomial damping and frictionloss, fitted up to the joint's velocity limit"),
    "joint_coupling": _no("a tendon couples both joints, the finding says torque on one; add the module's torque"),
    "torque_ripple": _no("no torque that depends on an angle but a spring's; add the module's torque to qfrc_applied"),
    "spring_torque": _yes("stiffness and springref of the joint"),
    "joint_elasticity": _yes("a second joint `<joint>_spring` with stiffness and damping behind the motor's"),
    "backlash": _no("stops of a joint are softened by the step, not stiff as teeth; add the module's torque"),
    "payload": _yes("body `payload` in the last link"),
    "link_inertial_error": _yes("inertial of the body"),
    "gravity_misalignment": _yes("gravity of option"),
    "encoder_offset": _yes("ref of the joint"),
    "torque_gain_error": _yes("gear of the motor: ctrl and its force sensor are in the log's units"),
    "torque_offset": _yes("constant bias of the motor: ctrl is in the log's units; a drift is left out"),
    "torque_delay": _yes(
        "delay of the motor's force sensor: the log is late, not the motor; a logged ctrl goes earlier"
    ),
    "torque_saturation": _yes("cutoff of the motor's force sensor: the log is flat, the joint gets more"),
    "external_contact": _EVENT,
}
# Figures of a spring with two rests a turn.
PERIODIC = ("cosine_Nm", "sine_Nm")
# A reading that loses all but this share of what lies above its knee is flat there.
FLAT = 0.05
# What the reported figures leave open, and what is written then.
OPEN = {
    "thermal_friction": "warmth is left open: give `warmth` from 0 (coldest moment of the session) to 1 (warmest)",
    "joint_coupling": "whether the joints' sum or difference rubs is read from the sign of the viscous part",
    "torque_offset": "the instant to which a drift refers is not reported: only the constant is used",
    "external_contact": _EVENT.words,
}


def express(change: Change, form: str) -> Expression:
    """How a format (`urdf`, `mjcf`, `parameters`, `module`) expresses an effect."""
    effect = change.effect
    if form == "parameters":
        return _yes("all figures with their intervals")
    if effect == "nonlinear_viscous_friction" and form == "mjcf" and change.values["exponent"] == 2.0:
        return _yes("second coefficient of damping")
    if form == "mjcf" and effect == "spring_torque" and any(change.values[name] for name in PERIODIC):
        return _no("a joint's spring is a cubic, this one has two rests a turn; add the module's torque")
    if form == "mjcf" and effect == "torque_saturation" and abs(change.values["lost"] - 1.0) > FLAT:
        return _near("cutoff of the motor's force sensor: flat from the limit on, without the bend before it")
    if effect not in KNOWN:
        return _EVENT if effect in OPEN else _no("an effect outside the catalogue, whose law is known to its file only")
    if form == "module":
        return _near(OPEN[effect]) if effect in OPEN else _yes("the law")
    table, default = (URDF, _URDF_FRICTION) if form == "urdf" else (MJCF, _MJCF_FRICTION)
    return table.get(effect, default)


def untold(changes: Sequence[Change], form: str) -> set[int]:
    """Joints with an effect that a format has no words for, and whose losses have to stand in for it."""
    return {
        change.joint
        for change in changes
        if change.joint >= 0 and change.effect not in SENSING and express(change, form).answer == "no"
    }
