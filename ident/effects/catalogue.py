"""The catalogue: all effects that a diagnosis may name, and how to add one.

A law of one joint's speed, load and angle is added to the package as one function in a file of `ident.laws` and one row
of its `effects.toml`; models and plans carry it then, too.

Recipe for an effect of your own: one Python file with a class derived from `Effect`, given as `--catalogue` to
`ident diagnose`, `ident patch` and `plan excite`.

    import numpy as np
    from ident.effects.base import Effect
    from ident.effects.effect_info import Typical
    from ident.effects.typical_sizes import coulomb_level
from ident.effects.intervals import coefficient_interval

    class Magnet(Effect):
        '''A magnet in the housing that pulls the joint towards one angle: τ = A sin 3q.'''

        id = "magnet"                       # what reports call it
        summary = "torque repeats three times a turn"
        nonnegative = (0,)                  # columns whose coefficient has a known sign; leave out if none has
        shown_by = "poses"                  # the motion to record, of informative_motions.SHOWINGS; else "wide"
        typical = Typical("amplitude_Nm", 0.2)   # how large `plan excite` takes it to be

        def untestable(self, session, joint):
            q = np.concatenate([run.motion.q[:, joint] for run in session.runs])
            return "the joint covers too little" if np.ptp(q) < 1.0 else None

        def columns(self, session, joint, variant):       # torque per unit of each coefficient, (T, k) for each run
            return [np.sin(3 * run.motion.q[:, [joint]]) for run in session.runs]

        def parameters(self, session, joint, variant, coefficients, covariance):
            return {"amplitude_Nm": coefficient_interval(0, coefficients, covariance)}

        def prior_scale(self, session, joint, variant):   # the largest plausible coefficients
            return np.array([coulomb_level(session, joint)])

        @staticmethod
        def law(m, j, p):                                 # its torque in a patch's module: NumPy alone
            return m.at(j, p["amplitude_Nm"] * np.sin(3 * m.q[:, j]))

Where a figure makes the torque non-linear, return `variants`, one for each value worth trying, and read the value from
`variant.inner` in `columns`. Where the torque acts on other joints too, set `rows = "all"` and return (T, n, k). Where
the effect is one of the whole arm, set `scope = "arm"`; where it acts on whole runs, as warmth does, `by_run`. All
that may be said of an effect beside its law has a default: see the attributes of `Effect`. Columns may use the motion,
the arm and the modelled torques of `RunContext`, but there is no measured torque in it: what explains a signal by
itself explains nothing.
"""

from __future__ import annotations

import importlib.util
import inspect
from pathlib import Path
from types import ModuleType

from ident.effects import (
    backlash,
    contact,
    curved_friction,
    friction,
    hysteresis_thermal,
    joint_elasticity,
    rigid_body,
    ripple,
    sensing,
    torque_delay,
    transmission,
)
from ident.effects.base import Effect
from ident.effects.informative_motions import SHOWINGS
from ident.effects.states import StatesEffect
from ident.errors import InputError
from ident.laws.table import TABLE

FILES = (backlash, contact, curved_friction, friction, hysteresis_thermal, joint_elasticity, rigid_body, ripple)
CLASSES: dict[str, type[Effect]] = {
    vars(one)["id"]: one
    for file in (*FILES, sensing, torque_delay, transmission)
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
    module = _run_file(extra)
    own = [
        kind
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, Effect) and kind.__module__ == module.__name__ and not inspect.isabstract(kind)
    ]
    if not own:
        raise InputError(
            extra,
            "it holds no complete effect",
            "derive a class from ident.effects.base.Effect with columns and parameters",
        )
    found = list(CATALOGUE)
    for kind in own:
        name = getattr(kind, "id", None)
        if not isinstance(name, str) or not name.isidentifier():
            raise InputError(
                extra, f"{kind.__name__} has no usable id ({name!r})", 'give it one, such as id = "magnet"'
            )
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


def _run_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise InputError(path, "there is no such file", "give the path of a Python file")
    spec = importlib.util.spec_from_file_location(f"armgap_effect_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(path, "it is no Python file", "name it something.py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's file may raise is the user's to mend
        reason = f"{type(error).__name__}: {error}"
        raise InputError(path, f"it doesn't run ({reason})", "mend the file") from error
    return module
