"""`plan excite` in plain lines for the terminal."""

from __future__ import annotations

from rich.console import Console

from ident.console import styled
from ident.effects.effect_info import describe_motion
from ident.errors import plural
from plan.experiment.result import Excitation, minutes_to_odds, odds_of
from plan.geometry.scene import limits_of_proof

AIMS = {"separate": "tells {effects} apart", "show": "shows {effects}", "identify": "identifies the base parameters"}


def print_excitation(console: Console, found: Excitation) -> None:
    """The set-up where it must change, the motion, what it tells, and what random motion would."""
    console.print(f"{found.robot}: {', '.join(found.noise)}", soft_wrap=True, highlight=False)
    effects = " and ".join(found.effects)
    set_up = found.set_up or ""
    if found.status == "needs_set_up":
        console.print(styled((f"no motion tells {effects} apart", "bold"), f": {set_up}"), soft_wrap=True)
        console.print("a motion of all joints to be recorded before and after:", soft_wrap=True)
    for true, rivals in _untold(found).items():
        told = f"if it is {true}, no motion tells: {' and '.join(rivals)} can fit as well"
        console.print(styled((told, "bold"), f": {set_up}"), soft_wrap=True)
    words = describe_motion(found.programme.family, found.joint)
    length = f"{found.duration / 60:.1f} min in {plural(len(found.runs), 'run')}"
    console.print(styled((words, "bold"), f": {length}; {_aim(found, effects)}"), soft_wrap=True)
    figures = ", ".join(f"{name} {value:.3g}" for name, value in found.programme.figures.items())
    console.print(f"  {figures}", highlight=False, soft_wrap=True)
    for (true, rival), value in found.distances.items():
        by_chance = found.random[(true, rival)]
        console.print(
            f"  {true} against {rival}: {value:.3g} nats; random motion of that length {by_chance:.3g}", soft_wrap=True
        )
    _print_odds(console, found)
    if found.set_up is not None and found.status == "ready":
        console.print(f"surer still: {set_up}", soft_wrap=True)
    console.print(f"  noise: {found.sources['noise']}", soft_wrap=True)
    clear = "nothing was looked at" if found.clearance is None else f"{1000 * found.clearance:.0f} mm, proven"
    around = " and ".join(["itself", *found.obstacles]) if found.obstacles else "itself; no obstacle was named"
    console.print(f"  distance of the arm from {around}: {clear}", soft_wrap=True)
    for one in found.carried:
        console.print(f"  carried: {one['name']} on {one['link']}", soft_wrap=True, highlight=False)
    for line in limits_of_proof(found.shapes, found.unchecked):
        console.print(f"  {line}", soft_wrap=True)


def _untold(found: Excitation) -> dict[str, list[str]]:
    """Of a question that motion answers in part: what it can't tell, and from which rivals."""
    untold: dict[str, list[str]] = {}
    for true, rival in found.distances:
        if found.status == "one_sided" and (true, rival) not in (found.tellable or ()):
            untold.setdefault(true, []).append(rival)
    return untold


def _aim(found: Excitation, effects: str) -> str:
    if found.status == "needs_set_up":
        return "the difference of the two recordings tells"
    if found.status == "ready":
        return AIMS[found.aim].format(effects=effects)
    shown = [name for name in found.effects if name not in _untold(found)]
    return f"shows {' or '.join(shown)} if it is that"


def _print_odds(console: Console, found: Excitation) -> None:
    proposed, by_chance = found.smallest
    if not found.distances:
        console.print(f"  information gained: {proposed:.3g} nats; by random motion {by_chance:.3g}")
        return
    took, chance = (minutes_to_odds(value, found.duration) for value in (proposed, by_chance))
    console.print(
        f"  odds to be expected {_odds(proposed)}, by random motion {_odds(by_chance)}; "
        f"20 : 1 takes {_minutes(took)}, random motion {_minutes(chance)}",
        soft_wrap=True,
    )


def _odds(distance: float) -> str:
    odds = odds_of(distance)
    return "over 10⁶ : 1" if odds > 1e6 else f"{odds:.3g} : 1"


def _minutes(value: float | None) -> str:
    return "for ever" if value is None or value > 1e4 else f"{value:.2g} min"
