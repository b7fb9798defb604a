"""The oracle's bound: sure of what is large and alone, at a loss before twins and before nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_blind_worlds import RIGHT, outcome, world_of

from ident.benchmark.cases import name_by_evidence
from ident.benchmark.summary import BlindReport
from ident.robot.arm import ArmModel
from ident.simulation.hardware import Hardware
from ident.simulation.world import draw_world_arm, noise_density


def ask(*signatures: tuple[float, ...]) -> float:
    rows = np.array(signatures)
    return name_by_evidence(rows @ rows.T, np.random.default_rng(1))


def test_what_is_large_and_alone_is_named() -> None:
    assert ask((12.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.0, 0.0, 20.0)) > 0.99


def test_twins_are_a_coin_and_what_is_hidden_is_not_named() -> None:
    assert ask((12.0, 0.0), (12.0, 0.0)) == pytest.approx(0.5, abs=0.3)
    assert ask((0.05, 0.0), (0.0, 9.0)) < 0.2


def test_more_of_it_is_named_more_often() -> None:
    told = [ask((size, 0.3 * size), (0.0, 9.0)) for size in (0.5, 2.0, 8.0)]
    assert told == sorted(told)
    assert told[0] < 0.5 < told[-1]


def test_the_density_of_noise_holds_its_variance() -> None:
    """Over all frequencies it adds up to the variance; above half of the log rate nothing is seen."""
    arm = ArmModel.load("tm5-900")
    world = replace(world_of(1, robot="tm5-900"), rate_hz=200.0, coloured_share=0.3, corner_hz=2.0)
    world = replace(world, encoder_noise_rad=1e-6, encoder_bits=24, encoder_at="motor")
    hardware: Hardware = draw_world_arm(arm, world, np.random.default_rng(2))
    hardware = hardware.replace(sensing=hardware.sensing.replace(count_noise=0.0, count=np.full(6, 1e-12)))
    f = np.linspace(0.0, 100.0, 20001)
    variance = np.trapezoid(noise_density(hardware, world, f), f, axis=0)
    np.testing.assert_allclose(np.sqrt(variance), hardware.sensing.noise_floor, rtol=0.02)
    assert np.isinf(noise_density(hardware, world, np.array([101.0]))).all()


def test_efficiency_is_ours_over_the_oracles() -> None:
    world = world_of(3)
    cases = [replace(outcome(i, world, *([RIGHT] if i < 2 else [])), oracle=0.8) for i in range(4)]
    report = BlindReport("several", 1, {}, tuple(cases), {})
    assert report.efficiency["3"].value == pytest.approx(0.5 / 0.8)
    assert report.to_dict()["scores"]["efficiency"] == {"3": pytest.approx(0.625)}
    assert "efficiency: 3x 0.625" in report.summary()
