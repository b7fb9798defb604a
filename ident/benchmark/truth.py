"""What is true of a case: which names are, at which joints, and with which numbers.

A name of the catalogue is true of the effect that was hidden, where that shows; names of bodies
are true of an arm whose URDF is wrong, too.
"""

from __future__ import annotations

from collections.abc import Sequence

from ident.benchmark.cases import Slot
from ident.effects import optional
from ident.effects.catalogue import CATALOGUE
from ident.records import JsonTable
from ident.simulation.request import Answer, TrueEffect

# An effect of several joints shows at those whose visible amplitude is at least this share of the
# largest.
SHOWN_SHARE = 1.0 / 3.0
# Causes outside the catalogue are none of these.
KNOWN = {effect.id: effect for effect in CATALOGUE}
# Beyond these a URDF is wrong rather than imprecise: that links weigh something else is then true
# [1], [m].
WRONG_LINK_ERROR = 0.08
WRONG_COM_M = 0.008
# Names that are true of an arm whose URDF is wrong, whatever else was hidden in it.
EXCUSED_BY_URDF = tuple(effect.id for effect in CATALOGUE if effect.as_change.body)


def match_truth(finding: JsonTable, answer: Answer) -> TrueEffect | None:
    """The true effect that a name is of; None if it is of none."""
    for effect in answer.effects:
        if is_true(effect, finding, answer):
            return effect
    return None


def visible_amplitude(slot: Slot, answer: Answer) -> float:
    """Visible amplitude of a case's effects [noise floors].

    Of single effects as it was asked for, of others as measured.
    """
    if slot.kind == "single":
        return slot.amplitude
    largest = [
        max(amplitude_shares(effect, answer).values(), default=0.0) for effect in answer.effects
    ]
    return max([float(f"{amplitude:.2g}") for amplitude in largest], default=0.0)


def urdf_is_wrong(world: JsonTable) -> bool:
    """Whether links of a world's arms weigh something else than any tolerance allows."""
    if not world:
        return False
    return bool(
        world["link_error"] > WRONG_LINK_ERROR
        or world["com_error_m"] > WRONG_COM_M
        or world["copied_link"]
    )


def amplitude_shares(effect: TrueEffect, answer: Answer) -> dict[str, float]:
    """Its visible amplitude at each joint [noise floors]."""
    return {
        joint: value / max(answer.noise_floor_Nm[joint], 1e-12)
        for joint, value in effect.visible_Nm.items()
    }


def name_joint(effect: TrueEffect) -> str:
    """Its joint; none where a diagnosis names it without one, even where the cause has one (a push
    at a link).
    """
    whole = effect.effect in KNOWN and KNOWN[effect.effect].scope == "arm"
    return "" if whole or not effect.joints else effect.joints[0]


def shown_joints(effect: TrueEffect, answer: Answer) -> list[str]:
    """Joints at which an effect is visible."""
    seen = amplitude_shares(effect, answer)
    least = SHOWN_SHARE * max(seen.values(), default=0.0)
    return [joint for joint, value in seen.items() if value >= least] or list(answer.noise_floor_Nm)


def is_true(true: TrueEffect, finding: JsonTable, answer: Answer) -> bool:
    """Whether a name is that of a true effect, at a joint where it may stand."""
    same = bool(true.effect == finding["effect"])
    return same and (not name_joint(true) or may_stand_at(true, finding["joints"], answer))


def may_stand_at(true: TrueEffect, joints: Sequence[str], answer: Answer) -> bool:
    """Whether a name for an effect may stand there.

    At its joint, or where it shows; either of a coupled pair.
    """
    joint = name_joint(true)
    allowed = [joint] if joint else shown_joints(true, answer)
    partner = KNOWN[true.effect].partner if true.effect in KNOWN else ""
    if joint and true.parameters.get(partner):
        allowed.append(str(true.parameters[partner]))
    return any(name in joints for name in allowed)


def comparable(true: TrueEffect, starts: Sequence[float]) -> dict[str, float]:
    """True parameters in the conventions of the diagnosis."""
    if true.effect not in KNOWN:
        return {}
    return optional.simulated_answer(KNOWN[true.effect], true.parameters, starts)
