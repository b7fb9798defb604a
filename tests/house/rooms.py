"""Rooms and the arrows between them.

A room is a package, or a module that stands alone, at the top of `ident` or `plan`; an arrow is one
room's import of another's.
"""

from tests.house.sources import PACKAGES, Source


def arrows(sources: list[Source]) -> set[tuple[str, str]]:
    """Pairs of rooms of which the first imports the second.

    The doors of the packages, which offer all, are left out.
    """
    rooms = {source.room for source in sources} - set(PACKAGES)
    pairs = set()
    for source in sources:
        for name in source.imports():
            imported = ".".join(name.split(".")[:2])
            if imported != source.room and {imported, source.room} <= rooms:
                pairs.add((source.room, imported))
    return pairs


def depth(pairs: set[tuple[str, str]]) -> int:
    """Floors: rooms on the longest way down; 0 where the arrows run in a circle."""
    below: dict[str, set[str]] = {}
    for first, second in pairs:
        below.setdefault(first, set()).add(second)
        below.setdefault(second, set())
    floors: dict[str, int] = {}
    while len(floors) < len(below):
        waiting = [room for room in below if room not in floors]
        ready = [room for room in waiting if below[room] <= floors.keys()]
        if not ready:
            return 0
        for room in ready:
            floors[room] = 1 + max((floors[lower] for lower in below[room]), default=0)
    return max(floors.values(), default=0)
