"""Measured against model over time: the numbers are those of the diagnosis, and a browser draws and zooms them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.traces import STEPS, Traces, gather_traces
from tests.accessible import PHONE, after_script, find_violations, width_on_a_phone
from tests.ident.diagnosis.planted import analyse, load_arm, stribeck_on_1
from tests.ident.show.report.reader import read

# What a user does with keys alone: zoom in twice, look, and go back to the whole run.
KEYS = """
const plot = document.querySelector(".trace-plot");
const press = key => plot.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true}));
const count = () => plot.querySelector(".curve-0").getAttribute("d").split("L").length;
const told = [count()];
press("+"); press("+"); told.push(count());
press("ArrowRight"); told.push(count());
press("Home"); told.push(count());
document.querySelector('.trace-curves input').click();
told.push(plot.querySelectorAll(".curve-0").length);
document.body.dataset.told = JSON.stringify(told);
"""


@pytest.fixture(scope="module")
def traces() -> Traces:
    """The curves of an arm with a Stribeck law at joint_1."""
    found = gather_traces(analyse(load_arm(), stribeck_on_1))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def page(traces: Traces, tmp_path_factory: pytest.TempPathFactory) -> Path:
    analysis = analyse(load_arm(), stribeck_on_1)
    path = tmp_path_factory.mktemp("traces") / "why.html"
    return write_diagnosis_report(path, analysis.diagnosis.to_dict(), traces=traces)


def test_curves_are_what_the_diagnosis_counted(traces: Traces) -> None:
    """Law: measured less each model is its residual, whose rms is the error that the record tells."""
    analysis = analyse(load_arm(), stribeck_on_1)
    first = traces.shown[0]
    joint = traces.joints[first]
    left = {name: [] for name in traces.curves}  # type: ignore[var-annotated]
    for run in traces.runs:
        for name, values in run.values.items():
            rest = (run.values["measured"] - values)[:, first]
            left[name].append(rest[np.isfinite(rest)])
    rms = {name: float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for name, parts in left.items()}
    gap = analysis.diagnosis.to_dict()["gap"][joint]
    assert len(traces.runs) == len(analysis.series)
    assert rms["URDF"] == pytest.approx(gap["urdf_rms_Nm"], rel=1e-6)
    assert rms["tuned"] == pytest.approx(gap["rms_Nm"], rel=0.05)
    assert rms["named"] < 0.7 * rms["tuned"]


def test_the_leading_joint_is_first_and_the_worst_run_too(traces: Traces) -> None:
    analysis = analyse(load_arm(), stribeck_on_1)
    assert traces.joints[traces.shown[0]] == analysis.diagnosis.where[0].joint
    named = {joint for finding in analysis.diagnosis.findings for joint in finding.joints}
    assert named <= {traces.joints[j] for j in traces.shown}
    errors = []
    for run in traces.runs:
        left = (run.values["measured"] - run.values["tuned"])[:, traces.shown[0]]
        errors.append(np.sqrt(np.nanmean(left**2)))
    assert errors == sorted(errors, reverse=True)


def test_the_page_holds_the_curves_to_a_screen_s_resolution(page: Path, traces: Traces) -> None:
    (text,) = re.findall(r'id="trace-data">(.*?)</script>', page.read_text(encoding="utf-8"))
    record = json.loads(text)
    run, own = traces.runs[0], record["runs"][0]["joints"][0]
    values = np.array(own["values"][0], dtype=float) * own["step"] + own["low"]
    measured = run.values["measured"][:, traces.shown[0]]
    stride = -(-len(measured) // len(values))
    reach = float(np.ptp(measured))
    assert values == pytest.approx(measured[::stride], abs=2.0 * reach / STEPS + 1e-5)
    assert None in own["values"][1]  # where no model is judged


def test_the_page_is_one_file_without_network(page: Path) -> None:
    reader = read(re.sub(r"<script.*?</script>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL))
    assert all(address.startswith(("#", "data:")) for address in reader.addresses)
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"\b(fetch|XMLHttpRequest|import)\b *\(", text)
    assert "Measured against model" in reader.text


def test_keys_zoom_move_and_return(page: Path, tmp_path: Path) -> None:
    """Law: in a real browser two plusses show a quarter of the samples, Home shows all; a curve can be hidden."""
    shown = re.search(r'data-told="([^"]*)"', after_script(page, tmp_path, KEYS))
    assert shown is not None
    whole, near, moved, back, hidden = json.loads(shown[1])
    assert 0.2 * whole < near < 0.35 * whole
    assert 0.2 * whole < moved < 0.35 * whole
    assert (back, hidden) == (whole, 0)


def test_everybody_can_read_it(page: Path, tmp_path: Path) -> None:
    assert find_violations(page, tmp_path) == []
    assert find_violations(page, tmp_path, dark=True) == []
    assert width_on_a_phone(page, tmp_path) <= PHONE
