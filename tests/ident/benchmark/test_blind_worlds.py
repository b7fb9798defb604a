"""Scores by the worlds of the cases."""

from __future__ import annotations

import html
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.benchmark.cases import FULL_MIX, Slot, draw_case, draw_world_of, plan_slots
from ident.benchmark.pages import write_blind_pages
from ident.benchmark.scoring import Outcome, auroc, score_case
from ident.benchmark.summary import NUMBERS, WORDS, BlindReport, world_axes
from ident.simulation.simulate import SimulationOptions
from ident.simulation.world import PRESETS, World, find_worlds

RIGHT = finding("stribeck_friction", "joint_2", amplitude_Nm=(0.9, 1.1))
WRONG = finding("torque_delay", "joint_1", "joint_2")


def world_of(number: int, **changes: object) -> World:
    return replace(PRESETS["any"].draw(np.random.default_rng(number)), **{"copied_link": False, **changes})


def outcome(number: int, world: World, *found: dict, hidden: bool = True, verdict: str = "named") -> Outcome:  # type: ignore[type-arg]
    true = answer(*([truth(amplitude_Nm=1.0)] if hidden else []))
    slot = Slot(f"case_{number:02d}", "single" if hidden else "healthy", amplitude=3.0 if hidden else 0.0)
    return score_case(slot, replace(true, world=world.to_dict()), result(*found, verdict=verdict))


def fine_and_coarse() -> tuple[Outcome, ...]:
    """With fine encoders every effect is named and every arm healthy; with coarse ones none is."""
    cases = []
    for i in range(32):
        coarse, hidden = i % 2 == 1, i % 4 < 2
        noise = 5e-4 if coarse else 5e-6
        world = world_of(
            i, encoder_noise_rad=noise, encoder_bits=24, encoder_at="link", link_error=0.0, com_error_m=0.0
        )
        found = [WRONG] if coarse else [RIGHT] if hidden else []
        cases.append(outcome(i, world, *found, hidden=hidden, verdict="named" if found else "no_gap"))
    return tuple(cases)


def report_of(cases: tuple[Outcome, ...]) -> BlindReport:
    return BlindReport("several", 7, {}, cases, {})


def test_strata_part_the_worlds_that_differ() -> None:
    worlds = report_of(fine_and_coarse()).worlds
    fine, coarse = worlds["encoder_noise_rad"]
    assert (fine["low"], fine["high"]) == pytest.approx((1e-6, 1e-5))
    assert (coarse["low"], coarse["high"]) == pytest.approx((1e-4, 1e-3))
    assert [(one["strict"], one["told_gap"], one["cases"]) for one in (fine, coarse)] == [
        (1.0, 0.0, 16),
        (0.0, 1.0, 16),
    ]
    assert "encoder_at" not in worlds  # the same in all
    assert all(sum(one["cases"] for one in strata) == 32 for strata in worlds.values())


def test_the_worst_stratum_is_reported_and_thin_ones_are_not() -> None:
    worst = report_of(fine_and_coarse()).worst
    assert worst is not None
    assert worst["strict"] == 0.0
    assert report_of(fine_and_coarse()[:8]).worst is None


def test_what_a_wrong_urdf_makes_true_is_no_false_name() -> None:
    link = finding("link_inertial_error", "joint_3")
    wrong, sound = world_of(1, link_error=0.2), world_of(1, link_error=0.01, com_error_m=0.001)
    excused, blamed = (outcome(1, world, link, hidden=False) for world in (wrong, sound))
    assert not excused.has_false_name
    assert excused.urdf_wrong
    assert blamed.has_false_name
    beside = outcome(2, wrong, link, RIGHT)
    assert beside.strict
    assert not beside.has_companion
    assert outcome(2, sound, RIGHT, link).has_companion


def test_rounding_counts_as_noise() -> None:
    coarse = world_of(3, encoder_noise_rad=1e-6, encoder_bits=12, encoder_at="link")
    assert world_axes(coarse.to_dict())["encoder_noise_rad"] == pytest.approx(2 * np.pi / 4096 / np.sqrt(12), rel=1e-3)


def test_the_curve_of_refusals() -> None:
    assert auroc([0.9, 0.8], [0.1, 0.2]).value == 1.0
    assert auroc([0.5, 0.5], [0.5]).value == 0.5
    assert auroc([0.1], [0.2, 0.05]).value == 0.5
    assert auroc([], [0.1]).value is None


def test_cases_take_the_worlds_in_turn_and_again_the_same() -> None:
    worlds = find_worlds("fine-encoder,hobby,scara")
    drawn = [draw_world_of(i, 4, worlds) for i in range(30)]
    assert [draw_world_of(i, 4, worlds) for i in range(30)] == drawn
    names = [one.name for one in drawn if one]
    assert all(set(names[i : i + 3]) == {"fine-encoder", "hobby", "scara"} for i in range(0, 30, 3))
    assert draw_world_of(0, 4, ()) is None


def test_a_case_is_what_its_world_says() -> None:
    world = world_of(5)
    base = SimulationOptions().in_world(world)
    slot = plan_slots(1, FULL_MIX, 1)[0]
    options, _ = draw_case(slot, 0, 1, base, ("a", "b"))
    assert (options.robot, options.runs, options.rate) == (world.robot, world.runs, world.rate_hz)
    assert options.world == world


def test_the_page_has_the_scores_over_each_property(tmp_path: Path) -> None:
    report = report_of(fine_and_coarse())
    record = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    first = record["worlds"]["encoder_noise_rad"][0]
    assert {"low", "high", "cases", "strict", "false_alarm", "told_gap"} <= set(first)
    assert record["worst_stratum"]["strict"] == 0.0
    page = html.unescape(write_blind_pages(report, {}, tmp_path).read_text())
    assert all({**NUMBERS, **WORDS}[axis] in page for axis in report.worlds)
    assert "encoder noise and rounding" in page
