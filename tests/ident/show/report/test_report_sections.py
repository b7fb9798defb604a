"""Sections: what they compute before a template shows it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.model.net_gate import JointGate
from ident.show.report.evaluation import (
    ReportInput,
    describe_steps,
    headline,
    reductions,
    worse_joints,
)
from ident.show.report.figures import make_panel, thin, to_svg
from ident.show.report.page import render_page
from ident.show.report.parameter_figures import parameters_section
from ident.show.report.words import fixed, pair
from tests.ident.show.report.reader import read


def scaled(score, factors):  # type: ignore[no-untyped-def]
    """A score whose last rung's errors are the first one's, scaled joint by joint."""
    squares, energy = score.squares.copy(), score.energy_error.copy()
    squares[-1], energy[-1] = squares[0] * np.square(factors), energy[0] * factors
    return replace(score, squares=squares, energy_error=energy)


@pytest.mark.parametrize(
    ("left", "words"), [(0.1, "follows the arm:"), (0.5, "follows the arm in part"), (0.9, "helps little")]
)
def test_headline_follows_the_share_left(source: ReportInput, left: float, words: str) -> None:
    """The sentence depends on how much of the URDF's torque error is left, and gives both numbers."""
    score = scaled(source.evaluation.pooled, left)
    text = headline(score)
    assert words in text
    assert f"{fixed(left * score.rmse_mean[0, -1])} N m" in text


@pytest.mark.parametrize(("factor", "said"), [(3.0, True), (-3.0, True), (1.0, False), (0.2, False)])
def test_headline_says_where_the_last_rung_errs_by_more_energy(source: ReportInput, factor: float, said: bool) -> None:
    """However much torque it explains: with both figures, root mean square over the runs."""
    score = scaled(source.evaluation.pooled, 0.1)
    score.energy_error[-1] = factor * score.energy_error[-2]
    assert ("Not in energy" in headline(score)) == said


def test_rungs_that_change_nothing_are_not_told(source: ReportInput) -> None:
    """The lead names a rung only where it takes a tenth of an error away."""
    score = source.evaluation.pooled
    assert "Friction brings the energy error of a run from" in describe_steps(score)
    assert "no rung changes that much" in describe_steps(scaled(score, 0.97))


def test_inertias_are_no_step_from_a_urdf_that_states_friction(source: ReportInput) -> None:
    """Law: fitted inertias hold no friction; beside a URDF that has some they are told together with the fitted one."""
    score = source.evaluation.pooled
    rungs = ("analytic", "urdf", "inertia", "loss")
    sizes = {
        name: np.stack([getattr(score, name)[0]] * 4) for name in ("energy_error", "squares", "rest_squares", "r2")
    }
    for name, factors in (("energy_error", (-1.0, 0.5, -1.1, 0.1)), ("squares", (1.0, 0.5, 0.4, 0.01))):
        sizes[name] = sizes[name] * np.array(factors)[:, None, None]
    stated = replace(score, rungs=rungs, **sizes)
    text = describe_steps(stated)
    assert text.startswith("Fitted inertias and friction bring")
    assert text.count("→") == 1
    assert "+ inertia: energy error +10" in reductions(stated)[1].replace("\u00a0", " ")


def test_joint_made_worse_is_told(source: ReportInput) -> None:
    """A last rung that harms one joint is reported with that joint's name only."""
    facts = worse_joints(scaled(source.evaluation.pooled, np.array([0.1, 1.5])))
    assert len(facts) == 1
    assert "joint_2" in facts[0][1]
    assert "joint_1" not in facts[0][1]
    assert worse_joints(source.evaluation.pooled) == []


def test_the_net_is_told_with_what_it_did_on_runs_held_back(source: ReportInput) -> None:
    """A row a joint with the figures and the share kept; models without a net, or of before there were shares, too."""
    gate = JointGate(1.25, 0.75, 3.0, 2.0, 0.75).to_dict()
    earlier = {name: value for name, value in JointGate(1.0, 1.5, 3.0, 4.0, 0.0).to_dict().items() if name != "weight"}
    model = replace(source.model, provenance={"net_gate": [gate, earlier]})
    page = read(render_page("", [parameters_section(replace(source, models=(model, model)))])).text
    for seen in ("1.25 → 0.750", "3.0 → 2.0", "75 %", "1.00 → 1.50", "→ 4.00 %"):
        assert seen in page
    assert "Residual net" not in read(render_page("", [parameters_section(source)])).text


@given(st.integers(1, 3000), st.integers(0, 2**32 - 1))
def test_thinning_keeps_the_extremes(samples: int, seed: int) -> None:
    """A thinned line has its points in order, no more than asked, and the same least and largest value."""
    y = np.random.default_rng(seed).standard_normal(samples)
    thin_x, thin_y = thin(np.arange(samples, dtype=float), y, 200)
    assert len(thin_x) <= 200
    assert np.all(np.diff(thin_x) > 0)
    np.testing.assert_array_equal(y[thin_x.astype(int)], thin_y)
    assert (thin_y.min(), thin_y.max()) == (y.min(), y.max())


@pytest.mark.parametrize("size", [1e-4, 0.003, 0.2, 40.0])
def test_an_energy_that_is_not_nothing_is_not_shown_as_nothing(size: float) -> None:
    shown = [float(one.replace("−", "-")) for one in pair(-size / 3.0, size).split(" ± ")]
    assert shown == pytest.approx([-size / 3.0, size], abs=0.051 * size)


def test_a_joint_s_name_is_no_formula() -> None:
    """A name with the signs of a formula, which is none that can be set, stands in the picture as it is."""
    name = "a$x^{$b"
    figure, axes = make_panel(f"speed of {name} [rad/s]", name)
    axes.plot([0.0, 1.0], [0.0, 1.0], label=name)
    axes.set_title(name)
    axes.legend()
    assert to_svg(figure, name).count(name) >= 5
