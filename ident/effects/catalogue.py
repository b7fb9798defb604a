"""The catalogue: all effects that a diagnosis may name, and those of a user's file.

How to add one stands in `docs/how-to.md`: a file with a class derived from `Effect`, given as `--catalogue`, or, for a
law of one joint's speed, load and angle, one function in a file of `ident.laws` and one row of `effects.toml`, which
models and plans carry, too. What may be said of an effect beside its law has a default: see `Effect`.
"""

from __future__ import annotations

import inspect
from pathlib import Path

from ident.effects import contact, friction, gear, hysteresis_thermal, rigid_body, ripple, sensing, transmission
from ident.effects.base import Effect, StatesEffect
from ident.effects.effect_info import SHOWINGS
from ident.errors import InputError
from ident.files import run_python
from ident.laws.carried import TABLE

FILES = (contact, friction, gear, hysteresis_thermal, rigid_body, ripple, sensing, transmission)
CLASSES: dict[str, type[Effect]] = {
    vars(one)["id"]: one
    for file in FILES
    for one in vars(file).values()
    if inspect.isclass(one) and issubclass(one, Effect) and "id" in vars(one)
}
# In the table's order; rows without a class of their own are effects by their law alone.
CATALOGUE: tuple[Effect, ...] = tuple(
    CLASSES[effect]() if effect in CLASSES else StatesEffect(effect) for effect in TABLE["effects"]
)


def find_effect(effect_id: str, catalogue: tuple[Effect, ...] = CATALOGUE) -> Effect:
    """The effect of an id.

    Raises:
        InputError: There is none; lists those that there are.
    """
    for effect in catalogue:
        if effect.id == effect_id:
            return effect
    known = ", ".join(effect.id for effect in catalogue)
    raise InputError("effect", f"there is no effect {effect_id!r}", f"give one of: {known}")


def load_catalogue(extra: Path | None = None) -> tuple[Effect, ...]:
    """The catalogue, and after it the effects of a user's file.

    The file is run as Python: it can do whatever its author wants.

    Raises:
        InputError: The file can't be run, holds no effect, or one whose id is missing or taken.
    """
    if extra is None:
        return CATALOGUE
    if not extra.is_file():
        raise InputError(extra, "there is no such file", "give the path of a Python file")
    if extra.suffix != ".py":
        raise InputError(extra, "it is no Python file", "name it something.py")
    try:
        module = run_python(extra, f"armgap_effect_{extra.stem}")
    except Exception as error:  # whatever a user's file may raise is the user's to mend
        reason = f"{type(error).__name__}: {error}"
        raise InputError(extra, f"it doesn't run ({reason})", "mend the file") from error
    own = [
        kind
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, Effect) and kind.__module__ == module.__name__ and not inspect.isabstract(kind)
    ]
    if not own:
        remedy = "derive a class from ident.effects.base.Effect with columns and parameters"
        raise InputError(extra, "it holds no complete effect", remedy)
    found = list(CATALOGUE)
    for kind in own:
        name = getattr(kind, "id", None)
        if not isinstance(name, str) or not name.isidentifier():
            what = f"{kind.__name__} has no usable id ({name!r})"
            raise InputError(extra, what, 'give it one, such as id = "magnet"')
        if any(effect.id == name for effect in found):
            raise InputError(extra, f"the id {name!r} of {kind.__name__} is taken", "choose another")
        if kind.shown_by not in SHOWINGS:
            what = f"{kind.__name__} is shown by {kind.shown_by!r}, which is no kind of motion"
            raise InputError(extra, what, f"give one of: {', '.join(SHOWINGS)}")
        try:
            found.append(kind())
        except Exception as error:
            what = f"{kind.__name__} can't be made ({error})"
            raise InputError(extra, what, "let it need no arguments") from error
    return tuple(found)
