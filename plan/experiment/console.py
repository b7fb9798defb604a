"""`plan excite` in plain lines for the terminal."""

from __future__ import annotations

from functools import partial

from rich.console import Console

from ident.console import styled
from ident.effects.effect_info import describe_motion
from ident.errors import plural
from plan.experiment.result import Excitation, odds_of

AIMS = {"separate": "tells {effects} apart", "show": "shows {effects}", "identify": "identifies the base parameters"}


def print_excitation(console: Console, found: Excitation) -> None:
    """The set-up where it must change, the motion, what it tells, and what random motion would."""
    say = partial(console.print, soft_wrap=True)
    say(f"{found.robot}: {', '.join(found.noise)}", highlight=False)
    effects, aim = " and ".join(found.effects), "the difference of the two recordings tells"
    if found.status == "needs_set_up":
        say(styled((f"no motion tells {effects} apart", "bold"), f": {found.set_up}"))
        say("a motion of all joints to be recorded before and after:")
    elif found.status == "one_sided":
        untold: dict[str, list[str]] = {}
        for true, rival in found.distances:
            if (true, rival) not in (found.testable or ()):
                untold.setdefault(true, []).append(rival)
        for true, rivals in untold.items():
            told = f"if it is {true}, no motion tells: {' and '.join(rivals)} can fit as well"
            say(styled((told, "bold"), f": {found.set_up}"))
        aim = f"shows {' or '.join(name for name in found.effects if name not in untold)} if it is that"
    else:
        aim = AIMS[found.aim].format(effects=effects)
    length = f"{found.duration / 60:.1f} min in {plural(len(found.runs), 'run')}"
    say(styled((describe_motion(found.run_set.family, found.joint), "bold"), f": {length}; {aim}"))
    say(f"  {', '.join(f'{name} {value:.3g}' for name, value in found.run_set.figures.items())}", highlight=False)
    for pair, value in found.distances.items():
        by_chance = f"random motion of that length {found.random[pair]:.3g}"
        say(f"  {' against '.join(pair)}: {value:.3g} nats; {by_chance}")
    (proposed, chance), (took, took_by_chance) = (
        found.smallest,
        ("for ever" if value is None or value > 1e4 else f"{value:.2g} min" for value in found.minutes),
    )
    if found.distances:
        odds = f"odds to be expected {_odds(proposed)}, by random motion {_odds(chance)}"
        say(f"  {odds}; 20 : 1 takes {took}, random motion {took_by_chance}")
    else:
        say(f"  information gained: {proposed:.3g} nats; by random motion {chance:.3g}")
    if found.set_up is not None and found.status == "ready":
        say(f"surer still: {found.set_up}")
    say(f"  noise: {found.sources['noise']}")
    clear = "nothing was looked at" if found.clearance is None else f"{1000 * found.clearance:.0f} mm, proven"
    scene = found.scene
    around = " and ".join(["itself", *(box.name for box in scene.obstacles)])
    say(f"  distance of the arm from {around}{'' if scene.obstacles else '; no obstacle was named'}: {clear}")
    for one in found.carried:
        say(f"  carried: {one['name']} on {one['link']}", highlight=False)
    for line in scene.limits_of_proof:
        say(f"  {line}")


def _odds(distance: float) -> str:
    return "over 10⁶ : 1" if (odds := odds_of(distance)) > 1e6 else f"{odds:.3g} : 1"
