"""Laws of results in Python: from a file they are what they were, and none fills more than a screen unasked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ident
from ident.robot.names import data_path

SEALED = data_path("logs/tm5_900/sealed_2")


@pytest.fixture(scope="module")
def found() -> ident.Diagnosis:
    return ident.diagnose(SEALED, "tm5-900")


def test_a_diagnosis_from_its_file_is_shown_as_it_was(found: ident.Diagnosis, tmp_path: Path) -> None:
    found.save(tmp_path / "why.json")
    loaded = ident.Diagnosis.load(tmp_path / "why.json")
    assert loaded.verdict == found.verdict
    assert loaded.summary() == found.summary()
    assert loaded._repr_html_() == found._repr_html_()
    heights = [[bar.get_height() for bar in one.plot().axes[0].patches] for one in (found, loaded)]
    assert heights[0] == heights[1]


def test_a_file_of_another_kind_is_no_diagnosis(found: ident.Diagnosis, tmp_path: Path) -> None:
    ident.inspect(SEALED, "tm5-900").save(tmp_path / "inspect.json")
    with pytest.raises(ident.InputError, match=r"its schema is 'ident\.telemetry"):
        ident.Diagnosis.load(tmp_path / "inspect.json")


def test_a_notebook_shows_the_page_and_the_page_alone(found: ident.Diagnosis) -> None:
    html = found._repr_html_()
    assert html.startswith("<iframe srcdoc=")
    assert "&lt;section id=&quot;verdict&quot;" in html


def test_what_python_echoes_is_no_longer_than_a_screen(found: ident.Diagnosis) -> None:
    opened = ident.open_sessions(SEALED, "tm5-900")
    session = ident.simulate(runs=1, duration=2.0)
    for one in (
        found,
        ident.inspect(SEALED, "tm5-900"),
        opened,
        opened.arm,
        opened.motions[0],
        session,
        session.runs[0],
    ):
        lines = repr(one).splitlines()
        assert len(lines) <= 24
        assert sum(-(-len(line) // 80) for line in lines) <= 50
        assert type(one).__name__ in lines[0]
        assert "array(" not in repr(one)


def test_a_plot_has_the_colours_of_the_page(found: ident.Diagnosis) -> None:
    page = found._repr_html_()
    axes = found.plot().axes[0]
    for bars in axes.containers:
        red, green, blue, _ = np.round(255 * np.array(bars.patches[0].get_facecolor())).astype(int)
        assert f"background:#{red:02x}{green:02x}{blue:02x}" in page
