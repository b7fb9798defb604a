"""Where causes are that no name tells: what is fitted is what sessions with truth show."""

from pathlib import Path

import numpy as np
import pytest

from ident.benchmark.board.case import NONE, OTHER
from ident.benchmark.board.fit_unnamed import Case, fit_shares, log_scores, write_shares
from ident.benchmark.board.ours import NamedShares, as_diagnosis, read_said
from ident.benchmark.board.published import published_effects
from ident.benchmark.board.unnamed import (
    COMPARISON,
    DIAGNOSIS,
    LISTED,
    NOTHING,
    PLACES,
    SOMETHING,
    STATES,
    UNEXPLAINED,
    deal,
    load_shares,
)

EFFECTS = len(published_effects())


def session(place: str, state: str = NOTHING, named: float = 0.0) -> Case:
    """A session whose cause is in a place, and in which a name has some probability."""
    rows = ({"effect": "payload", "probability": named},)
    truth = "backlash" if place == LISTED else place
    return Case(NamedShares(rows, {state: 1.0 - named}, 0.0), (frozenset({truth}),))


def test_shares_are_those_of_the_places() -> None:
    """Law: where nothing is named, the shares are the counts with one more in each place."""
    cases = [session(NONE)] * 60 + [session(OTHER)] * 10 + [session(LISTED)] * 30
    shares = fit_shares(cases, EFFECTS)[NOTHING]
    expected = {NONE: 61 / 103, OTHER: 11 / 103, LISTED: 31 / 103}
    assert shares == pytest.approx(expected, abs=1e-5)


def test_what_is_named_says_nothing_of_what_is_not() -> None:
    """Law: sessions whose name is right and sure move no share; without any, shares are even."""
    said = NamedShares(({"effect": "payload", "probability": 1.0},), {SOMETHING: 0.0}, 0.0)
    sure = Case(said, (frozenset({"payload"}),))
    shares = fit_shares([sure] * 50, EFFECTS)
    for state in STATES:
        assert shares[state] == pytest.approx(dict.fromkeys(PLACES, 1 / 3))


def test_no_other_shares_are_likelier() -> None:
    """Law: the log score of many sessions is least at the fitted shares."""
    rng = np.random.default_rng(1)
    kinds = [(place, state) for place in PLACES for state in (NOTHING, UNEXPLAINED)]
    drawn = [kinds[int(k)] for k in rng.integers(len(kinds), size=300)]
    cases = [session(place, state, 0.3) for place, state in drawn]
    shares = fit_shares(cases, EFFECTS)
    best = np.mean(log_scores(cases, EFFECTS, shares))
    for state in (NOTHING, UNEXPLAINED):
        for place in PLACES:
            moved = {other: 0.9 * share for other, share in shares[state].items()}
            moved[place] += 0.1
            assert np.mean(log_scores(cases, EFFECTS, {**shares, state: moved})) > best - 1e-4


def test_fitted_shares_are_read_as_written(tmp_path: Path) -> None:
    shares = fit_shares([session(OTHER)] * 5, EFFECTS)
    write_shares({DIAGNOSIS: (5, shares), COMPARISON: (5, shares)}, tmp_path / "unnamed.toml")
    for kind in (DIAGNOSIS, COMPARISON):
        read = load_shares(kind, tmp_path / "unnamed.toml")
        for state in STATES:
            assert read[state] == pytest.approx(shares[state], abs=1e-4)


@pytest.mark.parametrize("kind", [DIAGNOSIS, COMPARISON])
def test_what_is_left_is_dealt_whole(kind: str) -> None:
    """Law: the shipped shares deal all that no name has, and leave no place without any."""
    shares = load_shares(kind)
    for state in STATES:
        dealt = deal({state: 0.4}, shares)
        assert sum(dealt.values()) == pytest.approx(0.4, abs=1e-3)
        assert min(dealt.values()) > 0.0


def test_a_change_by_no_law_is_no_effect_of_the_list() -> None:
    """Law: its probability is left to where unexplained causes are, not to a name."""
    change = {"effect": "unlisted_change", "joints": ["a"], "probability": 0.8}
    record = {"verdict": "changed_unexplained", "joints": ["a"], "changes": [change]}
    record["reservations"] = []
    said = read_said(as_diagnosis(record), published_effects(), ["a"])
    assert said.rows == ()
    labels = EFFECTS + 2
    assert said.left[UNEXPLAINED] == pytest.approx(0.8 * labels / (labels + 1))
