"""What each format can say of each effect, and why not where it can't.

`yes`: the format states the same law. `approximate`: it states something near, told in the reason. `no`: it has no
words for it; the module does. An effect's class says what its formats are; what it doesn't speak of is friction.
"""

from __future__ import annotations

from collections.abc import Sequence

from ident.effects.knowledge import Expression, exactly_as, nearly_as, not_at_all
from ident.patches.change import Change

FORMATS = ("urdf", "mjcf", "parameters", "module")
_FRICTION = "knows damping and dry friction only; the pair that fits best without the effect is written instead"
_FRICTIONS = {
    "urdf": not_at_all(f"<dynamics> {_FRICTION}"),
    "mjcf": not_at_all(f"<joint> {_FRICTION}; add the module's torque to qfrc_applied"),
}
_UNKNOWN = not_at_all("an effect outside the catalogue, whose law is known to its file only: give it with --catalogue")
_LAWLESS = not_at_all("its class gives no `law` for the module")


def express(change: Change, form: str) -> Expression:
    """How a format (`urdf`, `mjcf`, `parameters`, `module`) expresses an effect."""
    if form == "parameters":
        return exactly_as("all figures with their intervals")
    effect = change.kind
    if effect is None:
        return _UNKNOWN
    if form != "module":
        return effect.expressed(form, change.values) or _FRICTIONS[form]
    if not change.has_law:
        return not_at_all(effect.left_open) if effect.left_open else _LAWLESS
    return nearly_as(effect.left_open) if effect.left_open else exactly_as("the law")


def untold(changes: Sequence[Change], form: str) -> set[int]:
    """Joints with an effect that a format has no words for, and whose losses have to stand in for it."""
    return {
        change.joint
        for change in changes
        if change.joint >= 0 and not change.of_the_log and express(change, form).answer == "no"
    }
