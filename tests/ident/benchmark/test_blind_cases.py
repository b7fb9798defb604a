"""Which cases are drawn."""

from __future__ import annotations

from collections import Counter

import pytest

from ident.benchmark.cases import FULL_MIX, TWINS, apportion, draw_case, parse_mix, plan_slots
from ident.errors import InputError
from ident.simulation.causes import CATALOGUE, OUTSIDE
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import POOR, SimulationOptions

JOINTS = tuple(f"joint_{i}" for i in range(1, 7))


def draw(slot, number=0, seed=1, attempt=0):  # type: ignore[no-untyped-def]
    return draw_case(slot, number, seed, SimulationOptions(), JOINTS, attempt)


def ids(case) -> list[str]:  # type: ignore[no-untyped-def]
    return [one.effect for one in case[0].effects if isinstance(one, EffectRequest)]


def test_the_full_check_holds_every_effect_in_every_size_and_motion() -> None:
    slots = plan_slots(480, FULL_MIX, seed=1)
    singles = [slot for slot in slots if slot.kind == "single"]
    cells = Counter((slot.effect, slot.amplitude, slot.rich) for slot in singles)
    assert {effect for effect, _, _ in cells} == set(CATALOGUE)
    assert all(cells[effect, size, True] == 3 and cells[effect, size, False] == 1 for effect, size, _ in cells)
    assert Counter(slot.kind for slot in slots) == FULL_MIX


@pytest.mark.parametrize("cases", [1, 3, 40, 481])
def test_shares_add_up(cases: int) -> None:
    assert sum(apportion(cases, FULL_MIX).values()) == cases


def test_the_same_seed_draws_the_same_cases_and_another_does_not() -> None:
    slots = plan_slots(30, FULL_MIX, 5)
    assert slots == plan_slots(30, FULL_MIX, 5)
    assert [draw(slot, i) for i, slot in enumerate(slots)] == [draw(slot, i) for i, slot in enumerate(slots)]
    assert [draw(slot, i, 5)[0].seed for i, slot in enumerate(slots)] != [
        draw(slot, i, 6)[0].seed for i, slot in enumerate(slots)
    ]


def test_kinds_are_what_they_say() -> None:
    for number, slot in enumerate(plan_slots(200, FULL_MIX, 3)):
        options, excluded = case = draw(slot, number, 3)
        found = ids(case)
        count = {"healthy": 0, "decoy": 0, "pair": 2, "triple": 3}.get(slot.kind, 1)
        assert len(set(found)) == count
        assert bool(options.decoys) == (slot.kind == "decoy")
        assert all(one in (OUTSIDE if slot.kind == "outside" else CATALOGUE) for one in found)
        assert (options.motions == POOR) == (not slot.rich)
        assert bool(excluded) == (slot.kind == "excluded")
        if excluded:
            assert excluded == (found[0], *TWINS.get(found[0], ()))


def test_another_attempt_keeps_the_effect_and_draws_another_arm_then_another_effect() -> None:
    slot = next(slot for slot in plan_slots(20, {"single": 1.0}, 2))
    first, second, later = (draw(slot, 0, 2, attempt) for attempt in (0, 1, 6))
    assert ids(first) == ids(second) == [slot.effect]
    assert first[0].seed != second[0].seed
    assert [one.amplitude for one in later[0].effects] == [slot.amplitude]


@pytest.mark.parametrize("text", ["nonsense", "single=x", "single=0", "single=-1", ""])
def test_a_mix_that_means_nothing_is_the_users_error(text: str) -> None:
    with pytest.raises(InputError, match="--mix"):
        parse_mix(text)


def test_a_mix_is_read() -> None:
    assert parse_mix("single=2, healthy") == {"single": 2.0, "healthy": 60.0}
