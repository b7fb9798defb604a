"""What could stand in an effect's place: other effects, other joints, plainer laws of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ident.effects import optional
from ident.inference.scales import signed_log
from ident.inference.search import SetSearch, rest_of
from ident.regression.design import Group, Key

# Deficits beyond this many nats are all alike: nobody would call such a candidate a rival.
MOST_DEFICIT = 2000.0


def find_rivals(search: SetSearch, chosen: Sequence[Group], group: Group) -> dict[Key, float]:
    """Candidates that could stand in an effect's place, with what each explains less there [nats].

    A rival explains the same torque: beside it, the effect adds less than half of what it adds
    alone.

    Args:
        search: The candidates' sums.
        chosen: The set that has the effect.
        group: The effect.

    Returns:
        Nats by key (effect id and place); negative where a rival explains more.
    """
    others = rest_of(chosen, group)
    gains = search.gains(others)
    best: dict[Key, tuple[float, Group]] = {}
    for gain, candidate in zip(gains, search.names.groups, strict=True):
        most, _ = best.get(candidate.key, (0.0, candidate))
        if gain > most:
            best[candidate.key] = float(gain), candidate
    without = search.nats(others)
    added_alone = search.nats(chosen) - without
    rivals: dict[Key, float] = {}
    for key, (gain, candidate) in best.items():
        if key == group.key or added_alone - gain > MOST_DEFICIT:
            continue
        with_rival = search.nats([*others, candidate])
        added_beside = search.nats([*others, candidate, group]) - with_rival
        if added_beside < 0.5 * added_alone:
            rivals[key] = added_alone - (with_rival - without)
    return rivals


def of_rivals(rivals: Mapping[Key, float], group: Group) -> dict[str, float]:
    """How far behind the nearest other effect and the nearest other joint are.

    Args:
        rivals: What each rival explains less [nats], as `find_rivals` has it.
        group: The effect.

    Returns:
        The features `rival_behind` and `place_behind`, signed logarithms (`signed_log`); as far as
        any rival may be where there is none.
    """
    other_effects = [deficit for key, deficit in rivals.items() if key[0] != group.effect.id]
    other_places = [deficit for key, deficit in rivals.items() if key[0] == group.effect.id]
    return {
        "rival_behind": signed_log(min(other_effects, default=MOST_DEFICIT)),
        "place_behind": signed_log(min(other_places, default=MOST_DEFICIT)),
    }


def share_of_plain_law(search: SetSearch, chosen: Sequence[Group], group: Group) -> float:
    """Share, from 0 to 1, of an effect's evidence that its law has without the terms that only bend
    it.

    A law that bends follows much that it does not describe. 1 where the law has no such terms.
    """
    if optional.is_plain(group.effect, group.variant):
        return 1.0
    others = rest_of(chosen, group)
    before = search.nats(others)
    whole = search.nats([*others, group]) - before
    points = [point for point in search.names.groups if point.key == group.key]
    plain = [point for point in points if optional.is_plain(point.effect, point.variant)]
    most = max(search.nats([*others, point]) for point in plain)
    share = (most - before) / max(whole, 1e-6)
    return float(np.clip(share, 0.0, 1.0))
