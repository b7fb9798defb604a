"""A diagnosis on a terminal: what explains most, what to do, the arm's numbers; the rest where it
is asked for.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from ident.checks.report import MISREAD
from ident.command_options import DiagnoseOptions
from ident.errors import plural
from ident.show.console import columns, print_issues, say, text_width
from ident.show.number_lines import print_numbers
from ident.show.report.diagnosis_actions import (
    AFTER_THE_BODY,
    PATCH,
    WRITE_NUMBERS,
    first_action,
    leads_with_friction,
    order_of,
    second_action,
)
from ident.show.report.diagnosis_doubts import describe_reservations, describe_unnamed
from ident.show.report.diagnosis_gap import (
    describe_findings,
    describe_noise,
    energy_pair,
    joints_tuned_away,
    noise_is_left,
)
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.finding_words import in_units_of, units_of
from ident.show.report.leading_joint import in_order_of_joints
from ident.show.report.numbers import (
    describe_links,
    describe_numbers,
    describe_readings,
    states_friction,
    table_of,
)
from ident.show.report.words import (
    DASH,
    TABLES,
    effect_name,
    parameters_in_words,
    percent,
    sentence,
)
from ident.show.terminal import REST, describe_name
from ident.show.untested_words import describe_limits, group_silent
from ident.units import TORQUE

# What a model is whose error has a column.
MEANINGS = {
    "untuned": "untuned: its links as your URDF has them, for tuned ones can hide what is named",
    "tuned": "tuned: with your arm's numbers above",
    "named": "named: with the named effects, too",
}


def print_diagnosis(
    console: Console, record: Mapping[str, Any], details: bool = False, call: str = PATCH
) -> None:
    """The verdict and what to do about it, the arm's numbers and errors.

    Args:
        console: Where it is printed.
        record: The diagnosis.
        details: Whether all else is printed, too.
        call: The command that writes it into a user's own file, in words.
    """
    runs = int(record["session"]["runs"])
    amount = f"{plural(runs, 'run')}, {record['session']['samples']} samples"
    say(
        console,
        f"{record['robot']}: {amount}, {record['session']['duration_s']:.0f} s",
        style="dim",
    )
    headline = diagnosis_headline(record)
    print_issues(console, untold_issues(record, headline), "warning")
    say(console, headline, style="bold")
    if action := first_action(record):
        say(console, f"Do: {action.replace(PATCH, call)}", hanging="    ")
    if second := second_action(record):
        say(console, f"Then: {second}", hanging="    ")
    is_told = record["verdict"] == "no_gap" or leads_with_friction(record)
    if not is_told and states_friction(record):
        say(console, describe_numbers(record))
    _print_findings(console, record, details)
    _print_numbers(console, record)
    _print_errors(console, record)
    if table_of(record) and action != WRITE_NUMBERS:
        say(console, f"Into your own file: {call}", hanging="    ")
    if details:
        _print_details(console, record)
    elif left := describe_rest(record):
        say(console, REST.format(left))
    if until := record.get("until"):
        say(console, describe_looks(until))
        if not until["enough"] and record["next_experiment"] is not None:
            say(console, f"Record next: {record['next_experiment']['motion']}", hanging="    ")


def patch_call(
    robot: str, sessions: Sequence[Path], record: Path | None, options: DiagnoseOptions
) -> str:
    """The command that writes a diagnosis into a user's own file, with the names of this run of it.

    Args:
        robot: As it was given.
        sessions: The recordings, on which the files are measured.
        record: Where the diagnosis was written; None where it was not, `-` where it was printed.
        options: How the recordings were read.
    """
    is_written = record is not None and str(record) != "-"
    why = shlex.quote(str(record)) if is_written else "why.json"
    given = [("--robot", robot), *(("--on", session) for session in sessions)]
    if options.topic != DiagnoseOptions().topic:
        given.append(("--topic", options.topic))
    if options.session_file is not None:
        given.append(("--session-file", options.session_file))
    given += [("--accept", issue) for issue in options.accept]
    words = " ".join(f"{name} {shlex.quote(str(value))}" for name, value in given)
    call = f"`ident patch {why} {words} --out patched --into MINE.urdf`, or MINE.xml"
    return f"{call}." if is_written else f"{call} (why.json is what `--json why.json` writes here)."


def untold_issues(record: Mapping[str, Any], headline: str) -> list[Mapping[str, Any]]:
    """Telemetry issues, without that of a factor which the headline begins with and the first
    action is about.

    A factor of one joint is all said by the headline; of several the first action has each.
    """
    issues = record["telemetry"]
    factor = headline.split(" times the model")[0]
    action = first_action(record)
    untold = []
    for issue in issues:
        begins = issue["issue"] == MISREAD and factor in issue["evidence"]
        joints = issue["joints"]
        if not begins or (len(joints) > 1 and not all(joint in action for joint in joints)):
            untold.append(issue)
    return untold


def _print_findings(console: Console, record: Mapping[str, Any], details: bool) -> None:
    """Each name with how sure it is and what it closes; what to do about those after the first."""
    runs = int(record["session"]["runs"])
    told = {action.removesuffix(".") for action in (first_action(record), second_action(record))}
    unseen = "on unseen runs" if runs > 1 else "on unseen parts"
    for number, finding in enumerate(in_order_of_joints(record), start=1):
        lead = f"{number}. "
        say(console, describe_name(finding, record, unseen), lead, " " * len(lead))
        if details:
            text = in_units_of(
                finding["joints"], record, describe_long(finding, runs), finding["effect"]
            )
            say(console, text, "   ")
        action = sentence(order_of(finding, record))
        if action and action not in told:
            say(console, f"Do: {action}.", "   ", "       ")
        if action == sentence(AFTER_THE_BODY):
            told.add(action)  # said once


def describe_long(finding: Mapping[str, Any], runs: int) -> str:
    """Its parameters with intervals, and its energy error; of one run, energy has no spread."""
    heldout = finding["heldout"]
    before, after = (energy_pair(heldout, when, runs) for when in ("before", "after"))
    shares = [
        f"{effect_name(name)} {percent(share)}" for name, share in finding["class_shares"].items()
    ]
    tied = f"; of its class {', '.join(shares)}" if len(shares) > 1 else ""
    parameters = parameters_in_words(finding["parameters"])
    closed = percent(heldout["shrink"])
    return (
        f"{parameters}; {closed} of what can be closed at its joints; "
        f"energy error {before} → {after} J{tied}"
    )


def _print_numbers(console: Console, record: Mapping[str, Any]) -> None:
    """The table of what the URDF says and what was found, then readings and links that are not as
    they should be.
    """
    print_numbers(console, record)
    for line in (*describe_readings(record), *describe_links(record)):
        say(console, f"{line}.", "  ", "    ")


def _print_errors(console: Console, record: Mapping[str, Any]) -> None:
    """Torque error of each joint: of the URDF as a simulator loads it, tuned, with the names; and
    noise.

    Where tuned links hide a name, what it closes is told against the untuned ones: these have a
    column then.
    """
    if not record["gap"]:
        return
    keys = {
        "URDF": "urdf_rms_Nm",
        "untuned": "fixed_rms_Nm",
        "tuned": "rms_Nm",
        "named": "",
        "noise": "noise_floor_Nm",
    }
    after = record["heldout"].get("rms_after_Nm", {}) if record["findings"] else {}
    shown = set()
    for gap in record["gap"].values():
        shown |= set(gap)
    if not joints_tuned_away(record):
        del keys["untuned"]
    known = [name for name, key in keys.items() if key in shown]
    if after:
        known.insert(len(known) - 1, "named")
    if len(noise_is_left(record)) == len(record["gap"]):  # the column before says it
        known.remove("noise")
    table = [["", *known]]
    for joint, gap in record["gap"].items():
        sizes = [after.get(joint) if name == "named" else gap.get(keys[name]) for name in known]
        table.append([joint, *(DASH if size is None else f"{size:.3f}" for size in sizes)])
    meanings = [MEANINGS[name] for name in known if name in MEANINGS]
    title = f"Torque error, rms [{units_of(record)}]"
    console.print()
    say(console, f"{title}; {'; '.join(meanings)}" if meanings else title)
    lines = columns(table, "l" + "r" * len(known), text_width(console))
    console.print("\n".join(lines), soft_wrap=True, highlight=False)
    if noise := describe_noise(record):
        say(console, noise, "  ")
    console.print()


def describe_rest(record: Mapping[str, Any]) -> str:
    """What a first screen leaves out."""
    parts = []
    if record["findings"]:
        parts.append("the parameters of each name")
    doubts = len(record.get("reservations", ()))
    if doubts or describe_unnamed(record):
        parts.append("what was weighed and not believed" if doubts else "what speaks for a gap")
    if record["not_testable"]:
        parts.append("what these recordings can't show")
    if record["verdict"] == "no_gap" and describe_limits(record):
        parts.append("what would have been seen")
    return ", ".join(parts)


def _print_details(console: Console, record: Mapping[str, Any]) -> None:
    """All that a first screen leaves out, a paragraph each."""
    after = record["heldout"].get("rms_after_Nm", {}) if record["findings"] else {}
    gaps = []
    for joint, gap in record["gap"].items():
        gaps.append(describe_gap(joint, gap, after.get(joint)))
    limits = describe_limits(record) if record["verdict"] == "no_gap" else ""
    lines = [describe_findings(record), *describe_reservations(record), describe_unnamed(record)]
    lines += [*gaps, limits, *group_silent(record["not_testable"])]
    for line in filter(None, lines):
        say(console, line, "  ", "    ")


def describe_gap(joint: str, gap: Mapping[str, Any], after: float | None) -> str:
    """What the error that is left at a joint depends on, beside the names; empty where nothing is
    known.
    """
    left = f"{gap['rms_Nm'] if after is None else after:.3f}"
    ceiling = f"{gap['ceiling_rms_Nm']:.3f}"
    if not gap["unexplained"] or ceiling == left:
        return ""
    unit = gap.get("unit", TORQUE)
    follows = TABLES["follows"][gap["unexplained"]]
    return (
        f"What is left at {joint} depends on {follows}: "
        f"a model of that would leave {ceiling} of {left} {unit}"
    )


def describe_looks(until: Mapping[str, Any]) -> str:
    """Whether the runs of repeated looks were enough, or what is missing, in one line."""
    amount = f"{plural(until['runs'], 'run')} ({until['minutes']:.1f} min)"
    if until["enough"]:
        return f"Sure after {amount}, looked at {len(until['looks'])} times: that much is enough."
    return f"Not sure after {amount}: {'; '.join(until['missing'])}."
