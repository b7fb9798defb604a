"""What a candidate must show for a name, and what is told of one that shows less."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from ident.diagnosis.alternate import _or_doubted
from ident.diagnosis.reservations import Reservation
from ident.diagnosis.selection.gates import Gates, Named, SearchResults

CLEAR = Gates(
    p_value=0.001,
    log_score=(300.0, 60.0),
    closed=(0.3, 0.05),
    rms_fall=0.05,
    gap_fall=0.6,
    own_share=0.5,
    evidence=280.0,
    absorbed=False,
)
ABSORBED = replace(CLEAR, absorbed=True, p_value=1.0, log_score=(-2.0, 5.0), rms_fall=0.0, gap_fall=0.0)
EVENT = replace(CLEAR, event=True, p_value=1e-9, rms_fall=0.001, log_score=(0.0, 0.0))


@pytest.mark.parametrize(
    ("gates", "passed"),
    [
        (CLEAR, True),
        (replace(CLEAR, p_value=0.06), False),
        (replace(CLEAR, p_value=0.06, rms_fall=0.26), True),
        (replace(CLEAR, p_value=0.06, rms_fall=0.24), False),
        (replace(CLEAR, p_value=0.06, rms_fall=0.6, log_score=(50.0, 60.0), closed=(0.1, 0.2)), False),
        (replace(CLEAR, log_score=(50.0, 60.0), closed=(0.1, 0.2)), False),
        (replace(CLEAR, rms_fall=0.019), False),
        (replace(CLEAR, gap_fall=0.09), False),
        (replace(CLEAR, own_share=0.014), False),
        (replace(CLEAR, bursts=True, rms_fall=0.001), True),
        (replace(CLEAR, bursts=True, rms_fall=0.001, evidence=19.0), False),
        (ABSORBED, True),
        (replace(ABSORBED, evidence=11.0), False),
        (replace(ABSORBED, evidence=11.0, absorbed_nats=5.0), True),
        (replace(ABSORBED, own_share=0.01), False),
        (EVENT, True),
        (replace(EVENT, gap_fall=0.4), False),
        (replace(EVENT, evidence=19.0), False),
    ],
)
def test_every_gate_can_close(gates: Gates, passed: bool) -> None:
    """A candidate passes if nothing is missing, and each thing that is missing alone keeps it from a name."""
    assert gates.passed is passed


@pytest.mark.parametrize(
    ("gates", "told"),
    [
        (replace(CLEAR, rms_fall=0.016), True),
        (replace(CLEAR, rms_fall=0.014), False),
        (replace(CLEAR, rms_fall=0.016, p_value=0.02), False),
        (replace(CLEAR, rms_fall=0.016, evidence=4.0), False),
        (replace(CLEAR, rms_fall=0.016, log_score=(-1.0, 5.0), closed=(-0.1, 0.2)), False),
        (replace(EVENT, gap_fall=0.4, evidence=10.0), False),
    ],
)
def test_what_is_beyond_chance_is_told_without_a_name(gates: Gates, told: bool) -> None:
    """Significant, with evidence, better on unseen runs, and not negligible: then it is told, if not named."""
    assert not gates.passed
    assert gates.beyond_chance is told


def test_a_name_that_was_struck_for_its_unevenness_is_something_there() -> None:
    """Law: without names, the best of what was struck for its figures counts as refused, and so as a hint; what may as
    well be zero does not, and beside names or another hint nothing changes.
    """
    some: Any = SimpleNamespace()
    weak, strong = (Named(some, replace(CLEAR, evidence=nats), some, some) for nats in (50.0, 90.0))

    def struck(item: Named | None) -> Reservation:
        return Reservation("stribeck_friction", ("joint_1",), "its size differs between runs", {}, item)

    nothing = SearchResults((), (some,), None)
    doubted = (struck(weak), struck(strong), struck(None))
    assert _or_doubted(nothing, doubted).hint is strong
    assert _or_doubted(nothing, (struck(None),)) is nothing
    named = SearchResults((cast(Named, weak),), (some, some), None)
    assert _or_doubted(named, doubted) is named
    hinted = SearchResults((), (some,), replace(weak, gates=replace(CLEAR, rms_fall=0.016)))
    assert _or_doubted(hinted, doubted) is hinted
