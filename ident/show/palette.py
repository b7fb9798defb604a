"""One colour for each rung of the ladder and each part of a gap: on pages, in `plot()` and in the timeline."""

from __future__ import annotations

from collections.abc import Sequence

# Okabe and Ito's colours: distinguished by colour-blind eyes, and of different grey on paper.
MEASURED = "#111111"
# Of a gap: left by the model before tuning, by the tuned one, after the named effects, by a flexible function beside
# them, noise.
UNTUNED, TUNED, NAMED, FLEXIBLE, NOISE = "#cc79a7", "#d55e00", "#009e73", "#0072b2", "#9a9a9a"
SKY, ORANGE = "#56b4e9", "#e69f00"
RUNG_COLOURS = {
    "analytic": TUNED,
    "urdf": ORANGE,
    "inertia": UNTUNED,
    "loss": FLEXIBLE,
    "named": SKY,
    "net": NAMED,
}
OTHER_RUNGS = ("#7a5195", "#8c6d31", "#b8860b")
MODEL_COLOURS = ("#332288", "#cc6677", "#44aa99", "#999933", "#aa4499", "#88ccee")
RUNG_NAMES = {
    "analytic": "rigid body",
    "urdf": "URDF",
    "inertia": "+ inertia",
    "loss": "+ loss",
    "named": "+ named",
    "net": "+ net",
}
RUNG_MEANINGS = {
    "analytic": "the URDF's bodies, without friction",
    "urdf": "URDF as a simulator loads it, with the friction of its <dynamics>",
    "inertia": "link inertias from the recordings",
    "loss": "friction and rotor inertia",
    "named": "laws of joints that a diagnosis named",
    "net": "neural net for the rest",
}


def rung_colours(rungs: Sequence[str]) -> dict[str, str]:
    """Colour of each rung; a rung that is not one of these gets one of its own."""
    others = iter(OTHER_RUNGS * (1 + len(rungs)))
    return {rung: RUNG_COLOURS.get(rung) or next(others) for rung in rungs}


def rung_name(rung: str) -> str:
    """Name of a rung for tables: from the second on, what it adds."""
    return RUNG_NAMES.get(rung, f"+ {rung.replace('_', ' ')}")


def model_colour(index: int) -> str:
    """Colour of the n-th model compared."""
    return MODEL_COLOURS[index % len(MODEL_COLOURS)]
