"""Sections: what they compute before a template shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.model.net_shrinkage import JointGate
from ident.show.palette import RUNG_COLOURS, rung_colours, rung_name
from ident.show.report import ReportInput
from ident.show.report.evaluation import describe_steps, headline, reductions, worse_joints
from ident.show.report.evaluation_figures import (
    comparison_section,
    fits_section,
    parameters_section,
    payload_section,
    rest_spans,
    restrict,
    run_errors,
)
from ident.show.report.figures import binned, envelope, make_panel, thin, to_svg
from ident.show.report.page import render_page
from ident.show.report.words import fixed, glue, percent, places_for, significant
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


def test_joint_made_worse_is_told(source: ReportInput) -> None:
    """A last rung that harms one joint is told with that joint's name only."""
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
    for told in ("1.25 → 0.750", "3.0 → 2.0", "75 %", "1.00 → 1.50", "→ 4.00 %"):
        assert told in page
    assert "Residual net" not in read(render_page("", [parameters_section(source)])).text


def test_reduction_is_one_less_the_ratio(source: ReportInput) -> None:
    """A rung that leaves a quarter of both errors takes 75 % away."""
    text = reductions(scaled(source.evaluation.pooled, 0.25))[0].replace("\u00a0", " ")
    assert text == "+ loss: energy error −75 %, torque error −75 %"


def test_main_model_is_the_one_of_most_samples(source: ReportInput) -> None:
    assert source.evaluation.model == "nearly all"
    assert source.model.provenance["samples"] == 200


def test_payload_rows_stand_by_mass(source: ReportInput) -> None:
    """Table 2: one row without payload, then the payloads; one column a rung."""
    section = payload_section(source)
    assert section is not None
    context = section.values
    assert [score.payload_kg for score in context["scores"]] == [0.0, 0.5]
    assert [rung_name(rung) for rung in context["scores"][0].rungs] == ["analytic", "+ loss"]


def test_comparison_covers_sessions_and_their_pool(source: ReportInput) -> None:
    """Figure 9: E1, E2 and both, for every model; payloads stay out."""
    section = comparison_section(source)
    assert section is not None
    context = section.values
    assert context["sessions"] == ["E1", "E2", "E1 + E2"]
    assert [name for name, _ in context["models"]] == ["half", "nearly all"]
    score = source.evaluations[0].sessions[0]
    _, mean, std = context["tables"][0]
    assert (mean[0][0], std[0][0]) == (score.energy_mean[-1, -1], score.energy_std[-1, -1])


def test_restricted_score_is_that_of_its_joints(source: ReportInput) -> None:
    """Of one joint the total equals that joint's own figure."""
    score = source.evaluation.pooled
    alone = restrict(score, ("joint_2",))
    np.testing.assert_allclose(alone.energy_mean[:, -1], score.energy_mean[:, 1])
    np.testing.assert_allclose(alone.rmse_mean[:, -1], score.rmse_mean[:, 1])


def test_worst_run_has_the_largest_error(source: ReportInput) -> None:
    errors = run_errors(source.evaluation)
    runs = fits_section(source).values["runs"]
    assert runs[1]["error"] == fixed(errors.max())
    assert len(errors) == len(source.evaluation.traces) == 4


def test_rest_spans_cover_rest_and_nothing_else() -> None:
    time = np.arange(8.0)
    moving = np.array([False, False, True, True, False, False, False, True])
    assert rest_spans(time, moving) == [(0.0, 1.0), (4.0, 6.0)]


@given(st.integers(1, 3000), st.integers(0, 2**32 - 1))
def test_thinning_keeps_the_extremes(samples: int, seed: int) -> None:
    """A thinned line has its points in order, no more than asked, and the same least and largest value."""
    y = np.random.default_rng(seed).standard_normal(samples)
    x = np.arange(samples, dtype=float)
    thin_x, thin_y = thin(x, y, 200)
    assert len(thin_x) <= 200
    assert np.all(np.diff(thin_x) > 0)
    np.testing.assert_array_equal(y[thin_x.astype(int)], thin_y)
    assert (thin_y.min(), thin_y.max()) == (y.min(), y.max())


def test_envelope_leaves_out_what_is_no_number() -> None:
    """The envelope spans the extremes of what is there; bins of nothing are empty."""
    x = np.linspace(0.0, 1.0, 1000)
    y = np.where(x < 0.5, np.sin(40 * x), np.nan)
    centre, low, high = envelope(x, y, 50)
    assert np.nanmin(low) == np.nanmin(y)
    assert np.nanmax(high) == np.nanmax(y)
    assert np.all(np.isnan(low[centre > 0.52]))


def test_binned_median_finds_the_law() -> None:
    """The median in bins of y = 3 x plus symmetric noise is 3 x."""
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 1, 20_000)
    rows = binned(x, 3 * x + rng.normal(0, 0.1, len(x)), np.linspace(0, 1, 11))
    np.testing.assert_allclose(rows[:, 2], 3 * rows[:, 0], atol=0.02)
    assert np.all(rows[:, 1] < rows[:, 2])
    assert np.all(rows[:, 2] < rows[:, 3])


def test_picture_says_what_it_shows() -> None:
    """An SVG carries a description and fills its column."""
    figure, axes = make_panel("time [s]", "torque [N m]")
    axes.plot([0, 1], [0, 1])
    svg = to_svg(figure, 'a "quoted" <line>')
    assert svg.startswith('<svg role="img" aria-label="a &#34;quoted&#34; &lt;line&gt;" viewBox="0 0 ')
    assert "torque [N m]" in svg
    assert "metadata" not in svg


def test_a_joint_s_name_is_no_formula() -> None:
    """A name with the signs of a formula, which is none that can be set, stands in the picture as it is."""
    name = "a$x^{$b"
    figure, axes = make_panel(f"speed of {name} [rad/s]", name)
    axes.plot([0.0, 1.0], [0.0, 1.0], label=name)
    axes.set_title(name)
    axes.legend()
    assert to_svg(figure, name).count(name) >= 5


def test_numbers_have_a_true_minus_a_dash_for_nothing_and_their_units() -> None:
    assert [fixed(one) for one in (-0.001, -1.5, float("nan"), None, 12.345)] == ["0.00", "−1.50", "–", "–", "12.35"]
    told = ["0.081", "12346", "0", "1.2e−07", "−0.50"]
    assert [significant(one) for one in (0.08123, 12345.6, 0.0, 1.2e-7, -0.5)] == told
    assert glue("0.68 N m and 12 J, 5 kg") == "0.68\u00a0N\u00a0m and 12\u00a0J, 5\u00a0kg"
    assert (percent(0.5), percent(0.031), percent(1.0)) == ("50 %", "3.1 %", "100 %")
    assert [places_for([v]) for v in (2000.0, 150.0, 7.0, 0.1)] == [0, 1, 2, 3]


def test_unknown_rungs_get_colours_of_their_own() -> None:
    """Named effects between the known rungs never take a known rung's colour."""
    colours = rung_colours(("analytic", "stribeck_friction", "payload", "net"))
    assert len(set(colours.values())) == 4
    assert colours["net"] == RUNG_COLOURS["net"]
    assert rung_name("stribeck_friction") == "+ stribeck friction"
