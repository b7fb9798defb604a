"""Draws docs/diagnosis.svg: the flow of a diagnosis, read from the imports of its files.

    python docs/draw_flow.py

A file of the inference stands below those that it imports, for what they make goes down to it.
An arrow is drawn where no longer way leads from one to the other. As narrow as a phone's screen.
"""

import ast
import textwrap
from html import escape
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
OUT = HERE / "diagnosis.svg"
DOOR = "ident.diagnosis.diagnose"
STAGE = "ident.inference."
# Numbers, and what types say: no step on the way.
ASIDE = ("settings", "searchable")
# Sizes in the picture's units, which are pixels on a phone [px].
WIDTH = 390
LEFT = 66
MARGIN = 8
LINE = 15
PAD = 9
GAP = 14
LANE = 9
# Characters of a line of words in a box.
CHARACTERS = 46
COLOURS = {
    "before": ("#eef3f8", "#0072b2"),
    "inference": ("#fdf3e7", "#d55e00"),
    "after": ("#eaf6f1", "#009e73"),
}

Imports = dict[str, set[str]]
Span = tuple[float, float]


def read_module(module: str) -> ast.Module:
    """The syntax tree of a module of ours."""
    path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(module: str) -> set[str]:
    """Modules of ours that a module imports when it is loaded."""
    names = set()
    for statement in read_module(module).body:
        if isinstance(statement, ast.ImportFrom) and (statement.module or "").startswith("ident."):
            names.add(statement.module or "")
    return names


def first_sentence(module: str) -> str:
    """What a module says of itself first."""
    words = " ".join((ast.get_docstring(read_module(module)) or "").split())
    return words.partition(". ")[0].rstrip(".")


def read_flow() -> Imports:
    """What each file of the inference on the diagnosis' way imports, of others of them."""
    waiting = [DOOR]
    flow: Imports = {}
    while waiting:
        module = waiting.pop()
        needed = {name for name in imported(module) if name.startswith(STAGE)}
        flow[module] = {name for name in needed if name.rpartition(".")[2] not in ASIDE}
        waiting += [name for name in flow[module] if name not in flow]
    return flow


def all_below(module: str, flow: Imports) -> set[str]:
    """All modules that one needs, by whatever way."""
    below = set(flow[module])
    for name in flow[module]:
        below |= all_below(name, flow)
    return below


def in_order(flow: Imports) -> list[str]:
    """The modules, each below all that it needs, and as near as may be to its first user."""
    order: list[str] = []

    def place(module: str) -> None:
        """Places what a module needs, what needs most first, and then the module."""
        if module in order:
            return
        for name in sorted(flow[module], key=lambda name: (-len(all_below(name, flow)), name)):
            place(name)
        order.append(module)

    place(DOOR)
    return order


def direct_arrows(flow: Imports) -> list[tuple[str, str]]:
    """Pairs of a module and one that uses it, without those that a longer way joins."""
    pairs = []
    for user, needs in flow.items():
        for needed in needs:
            others = needs - {needed}
            if not any(needed in all_below(other, flow) for other in others):
                pairs.append((needed, user))
    return pairs


def names_in(room: str, modules: set[str]) -> str:
    """Modules of a room that some of the flow import, by their short names."""
    names = set()
    for module in modules:
        for name in imported(module):
            if name.startswith(f"{room}.") and name not in modules:
                names.add(name.rpartition(".")[2].replace("_", " "))
    return ", ".join(sorted(names))


def draw_box(top: float, kind: str, title: str, words: str) -> tuple[str, float]:
    """A box with a title and words; its SVG and its height."""
    lines = textwrap.wrap(words, CHARACTERS)
    height = 2 * PAD + LINE * (1 + len(lines)) - 2
    fill, stroke = COLOURS[kind]
    width = WIDTH - LEFT - MARGIN
    shape = f'x="{LEFT}" y="{top}" width="{width}" height="{height}" rx="8"'
    parts = [f'<rect {shape} fill="{fill}" stroke="{stroke}"/>']
    x = LEFT + PAD
    base = top + PAD + LINE - 4
    parts.append(f'<text x="{x}" y="{base}" font-weight="600">{escape(title)}</text>')
    for k, line in enumerate(lines):
        y = base + LINE * (k + 1)
        parts.append(f'<text x="{x}" y="{y}" font-size="12">{escape(line)}</text>')
    return "\n".join(parts), height


def choose_lanes(spans: list[Span]) -> list[int]:
    """A lane for each span, counted from the boxes outwards, so that none lie on one another.

    Args:
        spans: Top and bottom of each arrow [px], the shortest first.
    """
    lanes: list[int] = []
    for k, (top, bottom) in enumerate(spans):
        taken = set()
        for lane, (other_top, other_bottom) in zip(lanes, spans[:k], strict=True):
            if other_top < bottom and top < other_bottom:
                taken.add(lane)
        lanes.append(min(set(range(len(spans))) - taken))
    return lanes


def draw_arrow(top: float, bottom: float, lane: int) -> str:
    """A line from one box's left side down to another's."""
    x = LEFT - LANE * (lane + 1) - 4
    path = f"M{LEFT} {top} H{x} V{bottom} H{LEFT - 2}"
    return f'<path d="{path}" marker-end="url(#head)"/>'


def draw_boxes(flow: Imports) -> tuple[list[str], list[Span]]:
    """All boxes from above, and the top and height of each [px]."""
    rows = [("before", "ident/regression", names_in("ident.regression", set(flow)))]
    for module in in_order(flow):
        kind = "after" if module == DOOR else "inference"
        short = module.removeprefix("ident.").replace(".", "/")
        rows.append((kind, f"{short}.py", first_sentence(module)))
    rows.append(("after", "ident/diagnosis", names_in("ident.diagnosis", {DOOR})))
    boxes = []
    places = []
    top: float = MARGIN
    for k, (kind, title, words) in enumerate(rows):
        # Room for an arrow between what stands before, the inference, and what comes after.
        if k in (1, len(rows) - 1):
            top += GAP
        box, height = draw_box(top, kind, title, words)
        boxes.append(box)
        places.append((top, height))
        top += height + GAP
    return boxes, places


def draw_arrows(flow: Imports, places: list[Span]) -> list[str]:
    """Arrows between the files beside the boxes, and down from and to the other rooms."""
    place_of = dict(zip(in_order(flow), places[1:-1], strict=True))
    spans = []
    for needed, user in direct_arrows(flow):
        above, above_height = place_of[needed]
        below, below_height = place_of[user]
        spans.append((above + 0.7 * above_height, below + 0.3 * below_height))
    spans.sort(key=lambda span: span[1] - span[0])
    lanes = choose_lanes(spans)
    arrows = [draw_arrow(*span, lane) for span, lane in zip(spans, lanes, strict=True)]
    centre = (LEFT + WIDTH) / 2
    for upper, lower in ((places[0], places[1]), (places[-2], places[-1])):
        path = f"M{centre} {sum(upper)} V{lower[0] - 2}"
        arrows.append(f'<path d="{path}" marker-end="url(#head)"/>')
    return arrows


def draw() -> str:
    """The whole picture, as SVG."""
    flow = read_flow()
    boxes, places = draw_boxes(flow)
    arrows = draw_arrows(flow, places)
    height = sum(places[-1]) + MARGIN
    names = [module.rpartition(".")[2] for module in in_order(flow)]
    title = f"The flow of a diagnosis: {', '.join(names)}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'width="{WIDTH}" height="{height}" '
        'font-family="system-ui, sans-serif" font-size="13" role="img">',
        f"<title>{escape(title)}</title>",
        '<defs><marker id="head" viewBox="0 0 6 6" refX="5" refY="3" markerWidth="6" '
        'markerHeight="6" orient="auto"><path d="M0 0 L6 3 L0 6 Z" fill="#555"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{height}" rx="10" fill="#ffffff"/>',
        '<g fill="#1a1a1a">',
        *boxes,
        "</g>",
        '<g stroke="#555" stroke-width="1.3" fill="none">',
        *arrows,
        "</g>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


if __name__ == "__main__":
    OUT.write_text(draw(), encoding="utf-8")
