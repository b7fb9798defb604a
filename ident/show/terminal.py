"""A comparison in plain lines for the terminal, and what it shares with a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console

from ident.effects.catalogue import OF_THE_ARM
from ident.errors import join_words, plural
from ident.show.console import print_issues, say
from ident.show.palette import NAMED, NOISE, TUNED
from ident.show.report.diagnosis_actions import order_of
from ident.show.report.finding_words import (
    MOST_TIED,
    in_units_of,
    is_likely,
    name_with_rivals,
    place_words,
    units_of,
)
from ident.show.report.numbers import MOST_NAMED
from ident.show.report.words import (
    TABLES,
    effect_name,
    fixed,
    parameters_in_words,
    percent,
    sentence,
    significant,
    with_units,
)
from ident.show.results import draw_bars
from ident.show.untested_words import Record, group_silent
from ident.units import TORQUE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STILL = "only torque beyond its static friction shows"
# Times its noise from which on torque that is not foretold is worth a word.
HARDLY_ABOVE_NOISE = 2.0
# Sessions that one line names.
MOST_SESSIONS = 6
# Where the rest is of a result whose first screen leaves something out.
REST = "More: `--details` prints {}; `--html PAGE` has it with pictures."
ASSUMED = "how much friction differs from run to run is assumed, for single runs can't say"


def headline(record: Record) -> tuple[str, str]:
    """The verdict as a sentence, and what to do where no change is named."""
    from ident.diagnosis.change.laws import PLAIN_FRICTION  # a diagnosis compares nothing

    changes = _named_together(record["changes"], record.get("joints", ()))
    risen = join_words(describe_risen(record))
    unforetold = join_words(describe_unforetold(record))
    kind = record["verdict"]
    untested = [row["effect"] for row in record["not_testable"]]
    most = ""
    if kind == "no_change" and PLAIN_FRICTION in untested:
        kind = "friction_unseen"
    elif kind == "no_change":
        most = _most_beside_noise(record)
        kind = "small_unseen" if most else kind
    if kind == "changed_unexplained" and not changes and (unforetold or risen):
        kind = "unforetold" if unforetold else "risen"
    words, order = TABLES["changes"][kind]
    colon = f": {changes}" if changes else ""
    told = words.format(changes=changes, colon=colon, risen=risen, unforetold=unforetold, most=most)
    return told, "" if changes else order


def _most_beside_noise(record: Record) -> str:
    """Where torque that is not foretold lies furthest above its noise: nothing where it hardly
    does.

    A change has to stand out against that, not against the noise.
    """
    heldout = record["heldout"]
    left = heldout["rms_before_Nm"]
    times = {
        joint: left[joint] / noise
        for joint, noise in heldout["noise_Nm"].items()
        if left.get(joint) is not None and noise
    }
    joint = max(times, key=lambda name: times[name], default="")
    if not joint or times[joint] < HARDLY_ABOVE_NOISE:
        return ""
    unit = in_units_of([joint], record, TORQUE)
    size = f"{significant(left[joint])} {unit} (rms) at {joint}"
    return f"up to {size}, {times[joint]:.1f} times its noise"


def _named_together(changes: Sequence[Record], joints: Sequence[str]) -> str:
    """The first changes by their names, those of one name together, and how many more there are."""
    places = _places_by_name(changes)
    if len(places) == 1 and len(joints) > 1 and set(joints) == set(*places.values()):
        return f"{next(iter(places))} at every joint"
    shown = _places_by_name(changes[:MOST_NAMED])
    words = [_placed(name, wheres) for name, wheres in shown.items()]
    told = "; ".join(words) if any(" and " in name for name in words[:-1]) else join_words(words)
    more = len(changes) - MOST_NAMED
    return f"{told}, and {more} more" if more > 0 else told


def _places_by_name(changes: Sequence[Record]) -> dict[str, list[str]]:
    """Where each name stands among some changes, in their order."""
    places: dict[str, list[str]] = {}
    for change in changes:
        name, where = _called(change)
        places.setdefault(name, []).append(where)
    return places


def _placed(name: str, wheres: Sequence[str]) -> str:
    """A name with its places, where it has any."""
    where = join_words([where for where in wheres if where])
    return f"{name} in {where}" if where else name


def _called(change: Record) -> tuple[str, str]:
    """The name of a change, and its place; one of the whole arm has none."""
    from ident.diagnosis.change.candidates import CARRIED  # a diagnosis compares nothing

    if change["effect"] == CARRIED:
        mass = change["parameters"]["mass_kg"]["value"]
        side = "more" if mass > 0.0 else "less"
        return f"{significant(abs(mass), 3)} kg {side} at the flange", ""
    tied = [] if is_likely(change) else change.get("class", [])[:MOST_TIED]
    name = " or ".join(map(effect_name, tied or [change["effect"]]))
    where = places_of(change)
    if where and len(change["joints"]) > MOST_NAMED:
        where = "the whole arm"
    return name, where


def describe_unforetold(record: Record) -> list[str]:
    """How far off each joint is that one set's model does not foretell and no change is named at;
    the worst first.
    """
    named = {joint for change in record["changes"] for joint in change["joints"]}
    rows = [row for row in record.get("unforetold", ()) if row["joint"] not in named]
    lines = []
    for row in sorted(rows, key=lambda row: -row["ratio"]):
        unit = in_units_of([row["joint"]], record, TORQUE)
        error = f"{row['joint']} is off by {significant(row['error_Nm'])} {unit} (rms)"
        usual = f"({row['low']:.1f} to {row['high']:.1f})"
        lines.append(f"{error}, {row['ratio']:.1f} times the usual {usual}")
    return lines


def describe_risen(record: Record) -> list[str]:
    """By how much each joint's residual rose beside what every law explains."""
    lines = []
    for row in record.get("risen", ()):
        what = f"that of {row['joint']} is {row['ratio']:.1f} times what it was"
        lines.append(f"{what} (rms; {row['low']:.1f} to {row['high']:.1f})")
    return lines


def places_of(change: Record) -> str:
    """A change's joints, and those where it may be as well; nothing of one of the whole arm."""
    return "" if change["effect"] in OF_THE_ARM else with_others(change)


def with_others(cause: Record) -> str:
    """The joints of a finding or change, and those where the same effect may be as well."""
    same = [place for place in cause.get("elsewhere", ()) if place["effect"] == cause["effect"]]
    others = [place["joint"] for place in same if place["joint"]]
    joints = join_words(cause["joints"])
    return f"{joints} (or {join_words(others)})" if others else joints


def print_comparison(console: Console, record: Record, details: bool = False) -> None:
    """Verdict and changes with what to do; all else where `details` are asked for."""
    for name in ("before", "after"):
        console.print(f"{name}: {describe_side(record[name])}")
    say(console, describe_known(record), hanging="  ")
    print_issues(console, record["telemetry"], "warning")
    words, order = headline(record)
    say(console, words, style="bold")
    if order:
        say(console, f"Do: {sentence(order)}.", hanging="    ")
    for number, change in enumerate(record["changes"], start=1):
        say(console, describe_name(change, record, "in the later set"), f"{number}. ", "   ")
        if details:
            say(console, f"{sentence(describe_sizes(change, record))}.", "   ")
        say(console, f"Do: {sentence(order_of(change, record))}.", "   ", "       ")
    lines = [*describe_unnamed_changes(record), *describe_still(record)]
    rest = [*describe_unreported(record), *describe_used(record), describe_spread(record)]
    rest += group_silent(without_still(record))
    for line in filter(None, [*lines, *rest] if details else lines):
        say(console, f"{sentence(line)}.", "  ", "    ")
    if not details:
        left = ["the sizes of each change"] if record["changes"] else []
        left += ["what fits and is not reported"] if record["reservations"] else []
        left += ["how much friction differs from run to run, what these recordings can't show"]
        say(console, REST.format(", ".join(left)))


def describe_side(side: Record) -> str:
    """The sessions of a set, and how much was recorded."""
    sessions = ", ".join(side["sessions"][:MOST_SESSIONS])
    more = " …" if len(side["sessions"]) > MOST_SESSIONS else ""
    samples = f"{side['samples']} samples, {side['duration_s']:.0f} s"
    return f"{sessions}{more}; {plural(side['runs'], 'run')}, {samples}"


def describe_known(record: Record) -> str:
    """Which loads and which mount of the base were taken as known, in a sentence or two."""
    loads = [_load_of(record[name]) for name in ("before", "after")]
    carried = (
        f"{loads[0]} before, {loads[1]} after"
        if loads[0] != loads[1]
        else f"{loads[0]} before and after"
    )
    mount = record["before"]["gravity_mps2"]
    later = record["after"]["gravity_mps2"]
    told = f"Taken as known: payload {carried}; the base {_mount_of(mount)}."
    if later is not None and later != mount:
        told += f" After, torque is read {_mount_of(later)}: that is not used."
    return told


def _load_of(side: Record) -> str:
    """The load of one set's sessions by their session.toml."""
    loads = sorted(set(side.get("payload_kg", ())))
    if not any(loads):
        return "none"
    return f"{' to '.join(f'{load:.4g}' for load in dict.fromkeys([loads[0], loads[-1]]))} kg"


def _mount_of(gravity: Sequence[float] | None) -> str:
    """How a base is mounted [m/s²]."""
    if gravity is None:
        return "as the URDF has it"
    return f"under gravity along [{', '.join(fixed(value, 2) for value in gravity)}] m/s²"


def without_still(record: Record) -> list[Record]:
    """What could not be tested for another reason than that a joint stood still."""
    said = {row["reason"] for row in record.get("still", ())}
    return [row for row in record["not_testable"] if row["reason"] not in said]


def describe_name(cause: Record, record: Record, measured: str) -> str:
    """A name in one sentence: where, how sure, what it closes at the joint where it closes most.

    Args:
        cause: A finding or a change.
        record: The result that holds it.
        measured: Where the error was measured.
    """
    where = f" in {with_others(cause)}"
    if cause["effect"] in OF_THE_ARM:
        where = place_words(cause["effect"], cause["joints"])
    name = sentence(name_with_rivals(cause))
    closes = f"torque error {measured} {describe_fall(cause, record)}"
    rivals = cause.get("class", ())[1:]
    if rivals and not is_likely(cause):
        sure = percent(cause["class_probability"])
        return f"{name}{where}: {sure} sure that it is one of these; {closes}"
    tied = " or ".join(map(effect_name, rivals))
    others = f"; can't be told from {tied} by these recordings" if tied else ""
    return f"{name}{where}: {percent(cause['probability'])} sure; {closes}{others}"


def describe_fall(cause: Record, record: Record) -> str:
    """The torque error without and with a cause, at the joint where it closes most."""
    before = cause["heldout"]["rms_before_Nm"]
    after = cause["heldout"]["rms_after_Nm"]
    worst = max(before, key=lambda joint: before[joint] ** 2 - after[joint] ** 2)
    old = significant(before[worst])
    new = significant(after[worst])
    fall = f"{old} → {new}" if old != new else f"stays at {old}"
    return f"{fall} {in_units_of([worst], record, TORQUE)} at {worst}"


def describe_sizes(change: Record, record: Record) -> str:
    """How large a change is, and what it explains at each of its joints."""
    heldout = change["heldout"]
    after = heldout["rms_after_Nm"]
    errors = []
    for joint, before in heldout["rms_before_Nm"].items():
        unit = in_units_of([joint], record, TORQUE)
        errors.append(f"{joint} {fixed(before)} → {fixed(after[joint])} {unit}")
    words = parameters_in_words(change["parameters"])
    sizes = in_units_of(change["joints"], record, words, change["effect"])
    closed = f"{percent(heldout['shrink'])} of what can be closed"
    return f"{sizes}; error in the later set {', '.join(errors)} ({closed})"


def describe_notes(record: Record) -> list[str]:
    """What is not reported, what has no name, and joints of which little was used."""
    lines = [*describe_unreported(record), *describe_unnamed_changes(record)]
    return [*lines, *describe_used(record), *describe_still(record)]


def describe_unreported(record: Record) -> list[str]:
    """What fits and is not reported, a line for each reason."""
    effects: dict[str, list[str]] = {}
    for row in record["reservations"]:
        reason = in_units_of(row["joints"], record, with_units(row["reason"]), row["effect"])
        name = f"{effect_name(row['effect'])} in {join_words(row['joints'])}"
        effects.setdefault(reason, []).append(name)
    return [f"not reported: {join_words(names)}: {reason}" for reason, names in effects.items()]


def describe_unnamed_changes(record: Record) -> list[str]:
    """What changed beside the changes that have a name."""
    if not record["changes"]:
        return []
    grown = "torque that follows no law has grown beside the changes"
    lines = [f"{grown}: {line}" for line in describe_risen(record)]
    unnamed = "no change is named where one set does not foretell the other"
    return lines + [f"{unnamed}: {line}" for line in describe_unforetold(record)]


def describe_still(record: Record) -> list[str]:
    """Joints that stood still."""
    return [f"of {row['joint']} {STILL}: {row['reason']}" for row in record.get("still", ())]


def describe_spread(record: Record) -> str:
    """How much friction differs from run to run of one set, or is taken to where each has a single
    run.
    """
    spread = record["friction_run_spread"]
    if not spread:
        return ""
    if record["before"]["runs"] + record["after"]["runs"] <= 2:
        return f"{ASSUMED}: record three a side"
    shares = [f"{joint} {percent(share)}" for joint, share in spread.items()]
    return f"friction differs from run to run of one set by: {', '.join(shares)}"


def describe_used(record: Record) -> list[str]:
    """Joints whose friction is known in less than half of their samples, a line each: what the
    others are.
    """
    lines = []
    seldom = [row for row in record.get("samples_used", ()) if row["in_motion"] < 0.5]
    for row in seldom:
        shares = [
            f"{percent(row['in_motion'])} in motion",
            f"{percent(row['at_rest'])} at rest "
            f"({plural(row['holds'], 'hold')}, each one observation)",
            f"{percent(row['turning'])} near stops and turns",
            f"{percent(row['left_out'])} left out ({row['why']})",
        ]
        lines.append(f"samples of {row['joint']}: {', '.join(shares)}")
    return lines


def draw_comparison(record: Record) -> Figure:
    """Error of the common model in the later set, without and with the changes."""
    heldout = record["heldout"]
    names: list[str] = list(heldout["rms_before_Nm"]) or list(record["joints"])
    bars = [("without the changes", TUNED, "rms_before_Nm")]
    if record["changes"]:
        bars.append(("with them", NAMED, "rms_after_Nm"))
    bars.append(("noise", NOISE, "noise_Nm"))
    rows = {}
    for words, colour, key in bars:
        rows[words] = (colour, [heldout[key].get(name) for name in names])
    title = f"{record['robot']}: {record['verdict']}"
    return draw_bars(names, rows, f"torque [{units_of(record)}]", title)
