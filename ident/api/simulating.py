"""Sessions of the simulated arm: what `ident simulate` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ident.errors import InputError
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.simulation.simulate import SimulationOptions, simulate_to
from ident.simulation.simulate import simulate as run


def simulate(*effects: str, out: str | Path | None = None, **options: Any) -> Session:
    """A session of the simulated arm, its effects chosen.

    Args:
        effects: What is wrong, each ID:JOINT:SIZE; SIZE in SI units, or as a multiple of the noise (`3x`).
        out: Folder in which it is written too; in memory alone if None.
        options: Fields of `ident.simulation.simulate.SimulationOptions`: robot, seed, runs, duration, rate, payload, …

    Raises:
        InputError: An unknown effect, joint or option.
    """
    known = SimulationOptions.__dataclass_fields__
    for name in options:
        if name not in known or name == "effects":
            others = ", ".join(sorted(set(known) - {"effects"}))
            raise InputError("simulate", f"there is no option {name!r}", f"give some of: {others}")
    for effect in effects:
        if not isinstance(effect, str):
            raise InputError("simulate", f"a {type(effect).__name__} is no effect", "give ID:JOINT:SIZE as text")
    chosen = SimulationOptions(effects=effects, **options)
    if out is None:
        return run(chosen).session
    simulate_to(out, chosen)
    return load_session(out)
