"""Pushes from outside: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class ContactSettings(Numbers):
    """Pushes from outside."""

    shortest_window: float = number(
        0.5,
        "s",
        "shortest window of a push",
        "chosen: a hand pushes longer",
    )
    edge: float = number(
        0.1,
        "s",
        "time in which its force sets in and fades",
        "chosen: as fast as a hand",
    )
    swelling: float = number(
        2.5,
        "1",
        "how much longer a push that swells lasts than it is strong",
        "law: a squared sine is above three quarters of its height for a third of its time, above "
        "half for a half",
    )
    largest_force_share: float = number(
        3.5,
        "1",
        "largest force, over the one with which the strongest joint's rated torque pushes at the "
        "arm's reach",
        "chosen: near the base links bear more",
    )
    screen_ratio: float = number(
        4.0,
        "1",
        "mean square of a stretch over the usual one, over all joints, from which on it may be a "
        "push",
        "chosen: far beyond chance",
    )
    screen_one_ratio: float = number(
        7.0,
        "1",
        "the same at one joint",
        "chosen: far beyond chance",
    )
    most_pushes: int = number(
        3,
        "1",
        "pushes of a session that are asked for",
        "chosen: more are no event",
    )
    most_windows: int = number(
        40,
        "1",
        "windows that are looked at for them",
        "chosen: a limit on work",
    )
    usual_samples: int = number(
        200000,
        "1",
        "samples, evenly over the session, that tell what is usually left",
        "chosen: a limit on work",
    )
    least_explained: float = number(
        0.6,
        "1",
        "share of what changes in its window that a constant force at a link's point must "
        "explain, over all joints",
        "chosen: most of it",
    )
    most_cuts: int = number(
        200,
        "1",
        "places in a window and around it where its push may begin or end",
        "chosen: a limit on work; within 4 s each sample",
    )
    reach: float = number(
        1.5,
        "s",
        "time before and after a window in which its push may have begun or ended",
        "chosen: longer than a hand's",
    )
    around: float = number(
        0.5,
        "s",
        "what is left so long before and after a window is left during it, too",
        "chosen: friction that is another in this run",
    )


CONTACT = ContactSettings()
