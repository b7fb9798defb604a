"""Laws of a fit's page: the record's numbers, curves of the model as it torques, one file, readable by everyone."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from reader import Reader

from ident.command_options import FitOptions
from ident.fitting.fit import FitResults, fit_hybrid
from ident.fitting.identified_numbers import identified_numbers
from ident.model.carried import CarriedEffect
from ident.robot.arm import ArmModel
from ident.show.fit_lines import describe_carried, foretold_of
from ident.show.report.fit_page import gather_fit_traces, render_fit_report
from tests.accessible import PHONE, find_violations, width_on_a_phone
from tests.ident.model.test_choice import loaded, made_runs


@cache
def fit(arm: ArmModel) -> FitResults:
    return fit_hybrid(made_runs(arm, loaded, runs=3), arm, FitOptions(net="none"))


@pytest.fixture
def page(two_joints: ArmModel, tmp_path: Path) -> Path:
    path = tmp_path / "fit.html"
    path.write_text(render_fit_report(fit(two_joints), made_runs(two_joints, loaded, runs=3)), encoding="utf-8")
    return path


def test_the_record_has_what_the_urdf_says_and_what_was_found(two_joints: ArmModel) -> None:
    """Law: every fitted number of every joint, its interval around it, beside the URDF's or none."""
    result = fit(two_joints)
    identified = result.to_dict()["identified"]
    for figure in result.model.figures:
        matching = [number for number in identified[figure.joint].values() if number["value"] == figure.value]
        assert matching
        assert matching[0]["low"] <= figure.value <= matching[0]["high"]
    for numbers in identified.values():
        assert numbers["armature_kgm2"]["nominal"] is None


def test_a_stated_friction_is_the_nominal_one(two_joints: ArmModel) -> None:
    """Law: what <dynamics> say stands beside what was found."""
    damped = re.sub(r'(<joint name="[^"]*" type="revolute">)', r'\1<dynamics damping="3.5"/>', two_joints.urdf)
    assert damped.count("<dynamics") >= two_joints.n
    arm = ArmModel.from_urdf(damped)
    model = replace(fit(two_joints).model, nominal=arm)
    numbers = identified_numbers(model)
    assert {joint["viscous_Nms_rad"]["nominal"] for joint in numbers.values()} == {3.5}


def test_every_number_and_error_stands_on_the_page(page: Path, two_joints: ArmModel) -> None:
    """Law: each joint's error on unseen parts, and its damping with the URDF's before it."""
    reader = Reader()
    reader.feed(page.read_text(encoding="utf-8"))
    text = " ".join(reader.text.split())
    for joint in foretold_of(fit(two_joints).model):
        error, torque, share = joint.cells[1:]
        assert f"{error.split()[0]} of {torque.split()[0]} ({share})" in text
    assert text.count("→") >= 2 * two_joints.n
    assert "Measured against the model" in text
    assert not [address for address in reader.addresses if not address.startswith(("#", "data:"))]


def test_the_curves_are_the_model_s_torque(page: Path, two_joints: ArmModel) -> None:
    """Law: measured less fitted is small beside measured less URDF, in every run."""
    traces = gather_fit_traces(fit(two_joints).model, made_runs(two_joints, loaded, runs=3))
    assert traces is not None
    assert traces.curves == ("measured", "URDF", "fitted")
    for run in traces.runs:
        left = {name: np.nanstd(run.values["measured"] - run.values[name]) for name in ("URDF", "fitted")}
        assert left["fitted"] < 0.1 * left["URDF"]
    held = re.search(r'id="trace-data">(.*?)</script>', page.read_text(encoding="utf-8"), re.S)
    assert held is not None
    assert len(json.loads(held[1])["runs"]) == 3


def test_page_is_accessible_and_fits_a_phone(page: Path, tmp_path: Path) -> None:
    assert find_violations(page, tmp_path) == []
    assert find_violations(page, tmp_path, dark=True) == []
    assert width_on_a_phone(page, tmp_path) <= PHONE


def test_carried_effects_are_told_with_whose_interval_it_is(two_joints: ArmModel) -> None:
    """Law: place, name, sizes with unit and the diagnosis' own interval; without one that is said."""
    known = CarriedEffect("torque_offset", 0, {"offset_Nm": 1.5}, {"offset_Nm": (1.25, 1.75)})
    bare = CarriedEffect("torque_offset", 1, {"offset_Nm": 2.5})
    assert CarriedEffect.from_dict(known.to_dict(), 2) == known
    model = fit(two_joints).model
    first, second = describe_carried(replace(model, carried=(known, bare)))
    assert two_joints.joint_names[0] in first
    assert "1.50 N m [1.25, 1.75]" in first
    assert "diagnosis' own" in first
    assert "without an interval" in second
