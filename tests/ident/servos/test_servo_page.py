"""The page of a servo: its numbers are the result's, its curves what the figures say, and a browser reads it whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ident import servo
from ident.cli.app import app
from ident.recordings.recording import Session
from ident.recordings.save import write_session
from ident.servos.servo_fit import ServoArm
from ident.show.report.servo_page import (
    SHOWN,
    gather_servo_traces,
    render_servo_report,
    servo_rows,
    write_servo_report,
)
from tests.accessible import PHONE, find_violations, width_on_a_phone
from tests.ident.servos.servo_plant import Servo, one_link, record


@pytest.fixture(scope="module")
def found() -> ServoArm:
    """What is reported of four runs of a servo that carries a known lever."""
    runs = [record(Servo(), k) for k in range(4)]
    return servo(Session("lever", tuple(runs), common_clock=False), one_link())


@pytest.fixture(scope="module")
def page(found: ServoArm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_servo_report(tmp_path_factory.mktemp("servo") / "servo.html", found)


def test_figures_leave_what_the_record_says(found: ServoArm) -> None:
    """Law: goal less measured angle is the error before, and the figures' curve leaves about the error after."""
    (joint,) = found.joints
    judged = np.concatenate([np.isfinite(run.told[:, 0]) for run in found.curves])
    before = np.concatenate([(run.goal - run.position)[:, 0] for run in found.curves])[judged]
    after = np.concatenate([(run.told - run.position)[:, 0] for run in found.curves])[judged]
    assert np.sqrt(np.mean(before**2)) == pytest.approx(joint.rms_before, rel=0.2)
    assert np.sqrt(np.mean(after**2)) < 0.3 * joint.rms_before


def test_every_figure_stands_on_the_page(found: ServoArm) -> None:
    """Each figure of the record in its cell; of the others there is a dash and a reason."""
    text = render_servo_report(found)
    (row,) = servo_rows(found.to_dict())
    (joint,) = found.joints
    told = {name for name, cell in row["cells"].items() if cell is not None}
    assert told == set(joint.figures) & set(SHOWN)
    for name in told:
        assert str(row["cells"][name]) in text
    for reason in joint.untold.values():
        assert reason in text
    assert "_rad" not in text[text.index("<main") : text.index('id="trace-data"')]


def test_the_joint_that_follows_worst_comes_first(found: ServoArm) -> None:
    traces = gather_servo_traces(found)
    assert traces is not None
    errors = [float(np.mean((run.values["goal"] - run.values["measured"]) ** 2)) for run in traces.runs]
    assert errors == sorted(errors, reverse=True)
    assert traces.curves == ("measured", "goal", "told")


def test_a_standing_servo_is_told_as_such() -> None:
    """Where nothing is reported the page asks for other motion, and has no curves."""
    still = record(Servo(), 0)
    flat = np.full_like(still.position, 0.3)
    still = still.replace(position=flat + 1e-6 * still.position, position_command=flat)
    text = render_servo_report(servo(Session("still", (still,), common_clock=False)))
    assert "These recordings tell nothing of the servos." in text
    assert "Record this again" in text
    assert "trace-data" not in text


@pytest.mark.parametrize("dark", [False, True])
def test_page_is_accessible(page: Path, tmp_path: Path, dark: bool) -> None:
    assert find_violations(page, tmp_path, dark) == []


def test_page_fits_a_phone_and_asks_nothing_of_the_network(page: Path, tmp_path: Path) -> None:
    assert width_on_a_phone(page, tmp_path) <= PHONE
    text = page.read_text(encoding="utf-8")
    assert 'src="' not in text
    assert 'href="http' not in text


def test_the_command_writes_it(tmp_path: Path) -> None:
    """With --html, beside what it prints."""
    runs = tuple(record(Servo(), k) for k in range(3))
    write_session(Session("lever", runs, common_clock=False), tmp_path / "lever")
    html = tmp_path / "servo.html"
    ended = CliRunner().invoke(app, ["servo", str(tmp_path / "lever"), "--html", str(html)])
    assert ended.exit_code == 0, ended.output
    assert "follows its goal within" in html.read_text(encoding="utf-8")


def test_what_is_not_told_of_several_joints_stands_once(found: ServoArm) -> None:
    """Law: a reason is printed once, with all of its joints; the joint that follows worst comes first."""
    (joint,) = found.joints
    untold = {"droop_rad_Nm": "hold known masses", "zero_rad": "no offset beyond chance"}
    better = replace(joint, joint="wrist", rms_before=0.1 * joint.rms_before, untold=untold)
    two = replace(found, joints=(better, replace(joint, untold={"zero_rad": untold["zero_rad"]})))
    text = " ".join(two.summary().split())
    assert text.startswith(f"Of 2 joints {joint.joint} follows worst: ")
    assert "Droop (wrist): hold known masses" in text
    assert "Error of its zero (every joint): no offset beyond chance" in text
    assert text.count(untold["zero_rad"]) == 1
