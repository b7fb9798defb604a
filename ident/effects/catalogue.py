"""The catalogue: all effects that a diagnosis may name, and those of a user's file.

How to add one stands in `docs/how-to.md`: a file with a class derived from `Effect`, given as
`--catalogue`, or, for a law of one joint's speed, load and angle, one function in a file of
`ident.laws` and one row of `effects.toml`, which models and plans carry, too. What may be said of
an effect beside its law has a default: see `EffectRecord`.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from ident.effects import (
    contact,
    friction,
    gear,
    hysteresis_thermal,
    rigid_body,
    ripple,
    sensing,
    transmission,
)
from ident.effects.base import Effect
from ident.effects.check import require_record
from ident.effects.states_effect import StatesEffect
from ident.errors import InputError
from ident.files import run_python
from ident.laws.carried import TABLE

FILES = (
    contact,
    friction,
    gear,
    hysteresis_thermal,
    rigid_body,
    ripple,
    sensing,
    transmission,
)


def classes_of(module: ModuleType) -> Iterator[type[Effect]]:
    """The classes of effects that a module defines and that can be made."""
    for _, member in inspect.getmembers(module, inspect.isclass):
        if member.__module__ != module.__name__ or not issubclass(member, Effect):
            continue
        if not inspect.isabstract(member):
            yield member


def _build_catalogue() -> tuple[Effect, ...]:
    """All effects in the table's order; rows without a class are effects by their law alone."""
    classes = {kind.id: kind for module in FILES for kind in classes_of(module)}
    return tuple(
        classes[effect]() if effect in classes else StatesEffect(effect)
        for effect in TABLE["effects"]
    )


CATALOGUE = _build_catalogue()
# Effects that have no joint of their own.
OF_THE_ARM = {effect.id for effect in CATALOGUE if effect.scope == "arm"}


def find_effect(effect_id: str, catalogue: tuple[Effect, ...] = CATALOGUE) -> Effect:
    """The effect of an id.

    Raises:
        InputError: There is none; lists those that there are.

    Args:
        effect_id: The id.
        catalogue: Where to look.
    """
    for effect in catalogue:
        if effect.id == effect_id:
            return effect
    known = ", ".join(effect.id for effect in catalogue)
    raise InputError("effect", f"there is no effect {effect_id!r}", f"give one of: {known}")


def load_catalogue(extra: Path | None = None) -> tuple[Effect, ...]:
    """The catalogue, and after it the effects of a user's file.

    The file is run as Python: it can do whatever its author wants.

    Args:
        extra: The file; the catalogue alone if None.

    Raises:
        InputError: The file can't be run, holds no effect, or one whose id is missing or taken, or
            whose record can't be right.
    """
    if extra is None:
        return CATALOGUE
    module = _run(extra)
    classes = list(classes_of(module))
    if not classes:
        remedy = "derive a class from ident.effects.base.Effect with columns and parameters"
        raise InputError(extra, "it holds no complete effect", remedy)
    effects = list(CATALOGUE)
    for kind in classes:
        taken = {effect.id for effect in effects}
        effects.append(_make(kind, extra, taken))
    return tuple(effects)


def _run(path: Path) -> ModuleType:
    """A user's file, run."""
    if not path.is_file():
        raise InputError(path, "there is no such file", "give the path of a Python file")
    if path.suffix != ".py":
        raise InputError(path, "it is no Python file", "name it something.py")
    try:
        return run_python(path, f"armgap_effect_{path.stem}")
    except Exception as error:  # whatever a user's file may raise is the user's to mend
        reason = f"{type(error).__name__}: {error}"
        raise InputError(path, f"it doesn't run ({reason})", "mend the file") from error


def _make(kind: type[Effect], path: Path, taken: set[str]) -> Effect:
    """An effect of a user's class."""
    name = getattr(kind, "id", None)
    if not isinstance(name, str) or not name.isidentifier():
        what = f"{kind.__name__} has no usable id ({name!r})"
        raise InputError(path, what, 'give it one, such as id = "magnet"')
    if name in taken:
        what = f"the id {name!r} of {kind.__name__} is taken"
        raise InputError(path, what, "choose another")
    require_record(kind, path)
    try:
        return kind()
    except Exception as error:
        what = f"{kind.__name__} can't be made ({error})"
        raise InputError(path, what, "let it need no arguments") from error
