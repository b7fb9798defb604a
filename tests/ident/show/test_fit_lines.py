"""Laws of what a fit says: what it errs by on what it did not see, its laws' figures by name, what comes next."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest

from ident.command_options import FitOptions
from ident.fitting.fit import FitResults, fit_hybrid
from ident.laws.carried import KINDS, NamedLaw
from ident.robot.arm import ArmModel
from ident.show.fit_lines import describe_foretold, foretold_lines, foretold_of
from tests.ident.model.test_choice import loaded, made_runs

SHAPE = {"stribeck_velocity_rad_s": 0.05, "exponent": 1.0, "terms": 4.0, "load_Nm": 2.0, "order": 3.0}


@cache
def fit(arm: ArmModel) -> FitResults:
    return fit_hybrid(made_runs(arm, loaded), arm, FitOptions(net="none"))


def test_what_the_fit_did_not_see_is_foretold_as_what_it_saw(two_joints: ArmModel) -> None:
    """Law: of an arm that the model can be, parts left out are foretold little worse than what the fit saw."""
    tau = np.concatenate([run.tau for run in made_runs(two_joints, loaded)])
    result = fit(two_joints)
    seen = result.loss.residual_rms
    for joint, size, torque in zip(foretold_of(result.model), seen, tau.T, strict=True):
        assert 0.8 * size < joint.error < 1.5 * size
        assert joint.torque == pytest.approx(np.sqrt(np.mean(torque**2)), rel=0.1)
        assert joint.share == joint.error / joint.torque


def test_the_first_sentence_and_the_table_have_every_joint(two_joints: ArmModel) -> None:
    """Law: error in N m and in per cent of the torque, joint by joint; the sentence has the worst."""
    model = fit(two_joints).model
    lines = foretold_lines(model)
    for joint, line in zip(foretold_of(model), lines[1:], strict=True):
        assert re.match(rf"  {joint.joint} +[\d.]+ N m +[\d.]+ N m +[\d.]+ %$", line)
    worst = max(foretold_of(model), key=lambda joint: joint.share)
    assert f"most at {worst.joint}" in describe_foretold(model)
    told = fit(two_joints).summary()
    assert told.startswith(model.robot.name)
    assert "Next: `ident evaluate" in told


def test_figures_of_what_can_t_be_negative_end_at_zero(two_joints: ArmModel) -> None:
    """Law: no interval of damping, dry friction or a rotor reaches below zero; an offset's may."""
    lows = {figure.low for figure in fit(two_joints).loss.figures() if figure.name != "offset"}
    assert min(lows) >= 0.0


@pytest.mark.parametrize("effect", KINDS)
def test_every_figure_of_a_law_has_name_unit_and_interval(effect: str) -> None:
    """Law: joint, what the coefficient is, unit, interval; what can't be negative ends at zero."""
    kind = KINDS[effect]
    names = (*kind.shape, *kind.optional)
    law = NamedLaw(effect, 1, {name: SHAPE.get(name, 0.1) for name in names})
    law = NamedLaw(effect, 1, law.shape, tuple((0.5, -0.1, 1.1) for _ in range(law.size)))
    told = law.describe(["first", "second"])
    assert told.startswith("second: ")
    figures = told.split(": ")[-1].split("], ")
    assert len(figures) == law.size
    for number, figure in enumerate(figures):
        unit = kind.units[min(number, len(kind.units) - 1)]
        low = "0" if number in kind.nonnegative else "-0.1"
        assert f"{kind.labels[number]} 0.5 {unit} [{low}, 1.1" in figure


def test_a_law_that_was_found_is_told_with_its_joint(two_joints: ArmModel) -> None:
    told = fit(two_joints).summary()
    assert f"{two_joints.joint_names[1]}: friction that grows with the load: driving 0.1" in told
