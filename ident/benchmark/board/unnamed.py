"""Where the cause is that no name tells: shares of none, of other and of all listed effects.

`unnamed.toml` is written by `python -m ident.benchmark.board.fit_unnamed`, from sessions with truth
that are on no board; no number of it is set by hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ident.benchmark.board.case import NONE, OTHER
from ident.safe_read import read_toml

SCHEMA = "ident.board_unnamed/1"
FILE = Path(__file__).with_name("unnamed.toml")
LISTED = "listed"
PLACES = (NONE, OTHER, LISTED)
"""Where a cause may be: nowhere, outside the published list, in it."""
NOTHING = "nothing_named"
SOMETHING = "something_named"
UNEXPLAINED = "unexplained"
STATES = (NOTHING, SOMETHING, UNEXPLAINED)
"""What is said beside the names: that there are none, that there are some, or that a gap is left
that no listed effect explains.
"""
DIAGNOSIS = "diagnosis"
COMPARISON = "comparison"

Shares = Mapping[str, Mapping[str, float]]
"""By state, and in each by place: they add up to one."""


def load_shares(kind: str, path: Path = FILE) -> Shares:
    """The fitted shares of a diagnosis or of a comparison.

    Raises:
        InputError: No such file.
    """
    record = read_toml(path, "write it: python -m ident.benchmark.board.fit_unnamed")
    return {state: record[kind][state] for state in STATES}


def deal(left: Mapping[str, float], shares: Shares) -> dict[str, float]:
    """What no name has, dealt to the places.

    Args:
        left: Probability that is left in each state.
        shares: Of the places in each state.

    Returns:
        Probability of each place.
    """
    places = dict.fromkeys(PLACES, 0.0)
    for state, mass in left.items():
        for place in PLACES:
            places[place] += mass * shares[state][place]
    return places
