"""The one place of colours: of each rung of the ladder and each part of a gap, on pages, in
`plot()` and in the timeline; and of the pages themselves, light, dark and printed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

# Okabe and Ito's colours: distinguished by colour-blind eyes, and of different grey on paper.
MEASURED = "#111111"
# Of pictures: text and axes, the grid, and what stretches that are not judged lie on.
INK = "#333333"
GRID = "#dddddd"
REST = "#e4e4df"
# Of a gap: left by the model before tuning, by the tuned one, after the named effects, by a
# flexible function beside them, noise.
UNTUNED = "#cc79a7"
TUNED = "#d55e00"
NAMED = "#009e73"
FLEXIBLE = "#0072b2"
NOISE = "#9a9a9a"
SKY = "#56b4e9"
ORANGE = "#e69f00"
# Of our pages, by the names that style sheets know them by, where the reader prefers light ones.
LIGHT = {
    "ink": "#1a1a1a",  # text
    "soft": "#595959",  # text of less weight
    "line": "#cfcfcf",  # between parts
    "thin": "#e6e6e6",  # between rows
    "firm": "#8f8f8f",  # below the last row of a group
    "edge": "#8a8a8a",  # around what can be typed into or pressed
    "paper": "#ffffff",
    "shade": "#ececec",  # behind what stands apart
    "panel": "#f2f2f2",  # behind controls
    "link": "#0b5394",
    "focus": "#f0a500",  # around what the keyboard is at
    "good": "#006b4f",
    "warn": "#9a4a00",
    "caution": "#c77700",  # beside what weakens a result
    "danger": "#c0392b",  # beside what forbids one
    "alarm": "#fdf1ef",  # behind it
    "do": "#eef6f2",  # behind what is to be done
    "go": "#00664a",  # of what starts the work
    "on-go": "#ffffff",
    "bar": NAMED,
    "point": FLEXIBLE,
    "since": TUNED,
    "named": NAMED,
    "heat": "#f09646",
    "on-fatal": "#8e1b10",  # of severities: text, and behind it
    "fatal": "#fdecea",
    "on-warning": "#7a3b00",
    "warning": "#fff3e0",
    "on-remark": "#3d3d3d",
    "remark": "#f2f2f2",
}
# The same where the reader prefers dark ones.
DARK = LIGHT | {
    "ink": "#e8e6e3",
    "soft": "#b3aea6",
    "line": "#55524d",
    "thin": "#3a3835",
    "edge": "#8d887f",
    "paper": "#1b1a18",
    "shade": "#33312e",
    "panel": "#2a2826",
    "link": "#8cc4ff",
    "good": "#4fd1a5",
    "warn": "#ffb870",
    "alarm": "#3b2320",
    "do": "#1d2f28",
    "go": "#4fd1a5",
    "on-go": "#10201a",
    "bar": "#00664a",
    "point": SKY,
    "since": "#ff9a4d",
    "named": "#2fc79a",
    "heat": "#9c500e",
}
PRINTED = LIGHT | {"alarm": "#ffffff", "do": "#ffffff"}
# Colours of pictures that turn with the page's dark mode, each with the page's own.
OF_THE_PAGE = {
    INK: "currentColor",
    GRID: "var(--line)",
    MEASURED: "currentColor",
    REST: "var(--shade)",
}
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


def style_colours() -> str:
    """The colours of our pages as CSS, a custom property each (`--ink`), as the reader prefers."""
    dark = f"@media (prefers-color-scheme: dark) {{ {_properties(DARK)} }}"
    printed = f"@media print {{ {_properties(PRINTED, 'color-scheme: light')} }}"
    return "\n".join([_properties(LIGHT, "color-scheme: light dark"), dark, printed])


def on_page(colour: str) -> str:
    """A colour of a picture as a page has it, light, dark or printed."""
    return OF_THE_PAGE.get(colour, colour)


def _properties(colours: Mapping[str, str], *first: str) -> str:
    """A rule of CSS that sets each colour, and what stands before them."""
    settings = [*first, *(f"--{name}: {colour}" for name, colour in colours.items())]
    return f":root {{ {'; '.join(settings)}; }}"


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
