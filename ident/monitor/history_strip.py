"""A parameter over the sessions as a small inline SVG: points, their intervals, and where a change began.

Drawn by hand: a page of an arm holds dozens, for which a plotting library takes minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from markupsafe import Markup, escape

from ident.monitor.alarms import Point
from ident.show.report.numbers import significant

WIDTH, HEIGHT = 240, 84
LEFT, RIGHT, TOP, BOTTOM = 44, 6, 6, 16
# An interval that is this many times the range of the values is cut: it would hide them.
WIDEST = 1.0


def draw_strip(points: Sequence[Point], changes: Sequence[str], description: str) -> Markup:
    """One parameter over time.

    Args:
        points: In order of time.
        changes: Names of the sessions from which on it had changed.
        description: What it shows, for those who can't see it.
    """
    try:  # dates as days, or places in the row where one is no date
        times = [datetime.fromisoformat(point.date).timestamp() / 86400.0 for point in points]
    except ValueError:
        times = [float(i) for i in range(len(points))]
    values = [point.value for point in points]
    reach = max(max(values) - min(values), 1e-3 * max(map(abs, values)), 1e-12)
    low = max(min(point.low for point in points), min(values) - WIDEST * reach)
    high = min(max(point.high for point in points), max(values) + WIDEST * reach)
    span = max(times[-1] - times[0], 1e-9)

    def x(time: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * ((time - times[0]) / span if len(times) > 1 else 0.5)

    def y(value: float) -> float:
        inside = min(max(value, low), high)
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (inside - low) / max(high - low, 1e-12)

    parts = [f'<path d="M{LEFT} {TOP}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}" fill="none" stroke="currentColor"/>']
    for time, point in zip(times, points, strict=True):
        if point.session in changes:
            line = f"M{x(time):.1f} {TOP}V{HEIGHT - BOTTOM}"
            parts.append(f'<path d="{line}" class="since"/>')
        parts.append(
            f'<path d="M{x(time):.1f} {y(point.low):.1f}V{y(point.high):.1f}" class="reach"/>'
            f'<circle cx="{x(time):.1f}" cy="{y(point.value):.1f}" r="2.2" class="point">'
            f"<title>{escape(point.session)}: {significant(point.value, 3)}</title></circle>"
        )
    style = 'font-size="9" font-family="sans-serif" fill="currentColor"'
    parts += [
        f'<text x="{LEFT - 3}" y="{TOP + 8}" text-anchor="end" {style}>{significant(high, 3)}</text>',
        f'<text x="{LEFT - 3}" y="{HEIGHT - BOTTOM}" text-anchor="end" {style}>{significant(low, 3)}</text>',
        f'<text x="{LEFT}" y="{HEIGHT - 4}" {style}>{escape(points[0].date[:10])}</text>',
        f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 4}" text-anchor="end" {style}>{escape(points[-1].date[:10])}</text>',
    ]
    head = f'<svg role="img" aria-label="{escape(description)}" viewBox="0 0 {WIDTH} {HEIGHT}">'
    return Markup(head + "".join(parts) + "</svg>")
