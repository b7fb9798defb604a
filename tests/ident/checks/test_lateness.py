"""Laws of channels with clocks of their own: a torque later than a diagnosis looks for is told, and nothing else is."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from faults import inspect, spoil

import ident
from ident.checks.lateness import check_lateness
from ident.checks.settings import LATENESS
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path


def moved(session: Session, delay: float) -> Session:
    """Torques later by some time [s]."""

    def change(run: Recording) -> Recording:
        columns = [np.interp(run.time - delay, run.time, effort) for effort in run.effort.T]
        return run.replace(effort=np.column_stack(columns))

    return spoil(session, change)


@pytest.mark.parametrize("delay", [0.1, 0.15, -0.1])
def test_a_torque_of_another_clock_is_told_with_its_delay(delay: float, clean: Session, arm: ArmModel) -> None:
    """Law: by how much and to which side; and nothing else is accused."""
    report = inspect(moved(clean, delay), arm)
    assert [issue.issue for issue in report.fatal] == ["effort_late"]
    evidence = report.fatal[0].evidence
    told = float(evidence.partition("about ")[2].partition(" ms")[0])
    assert told == pytest.approx(1000.0 * abs(delay), abs=30.0)
    assert ("later" if delay > 0.0 else "earlier") in evidence


@pytest.mark.parametrize("delay", [0.0, 0.01, -0.02, 0.04])
def test_a_delay_that_a_diagnosis_finds_is_none_of_the_telemetry(delay: float, clean: Session, arm: ArmModel) -> None:
    assert check_lateness(moved(clean, delay), arm) == []


@pytest.mark.parametrize("name", ["E1", "T1", "payload_1029g", "sealed_1"])
def test_torques_as_they_were_recorded_are_not_late(name: str) -> None:
    session = load_session(data_path(f"logs/tm5_900/{name}"))
    assert check_lateness(session, ArmModel.load("tm5-900")) == []


def test_its_bound_is_that_of_the_effect() -> None:
    """Law: what no diagnosis finds, the telemetry tells; the two meet."""
    path = Path(ident.__file__).with_name("effects") / "effects.toml"
    effects = tomllib.loads(path.read_text(encoding="utf-8"))["effects"]
    assert effects["torque_delay"]["bounds"]["delay_s"][1] == LATENESS.longest_s
