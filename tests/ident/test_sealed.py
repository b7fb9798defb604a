"""Sessions whose truth is known: causes are named, at their joints, and healthy arms are quiet.

The three shipped sealed sessions are opened with the key of `logs/make.py` after the diagnosis. Twelve sessions of
another simulator lie outside the repository: in the folder that `IDENT_OTHER_WORLD` names, or beside it.
"""

import json
import os
import sys
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from ident import diagnose
from ident.diagnosis.result import Diagnosis
from ident.robot.names import data_path
from ident.simulation.request import open_envelope
from ident.simulation.simulate import SimulationOptions, simulate

REPOSITORY = Path(__file__).parents[2]
OTHER_WORLD = Path(os.environ.get("IDENT_OTHER_WORLD", REPOSITORY.parent / "shared/otherworld"))
OTHER_SESSIONS = [f"session_{half}0{number}" for half in "ab" for number in range(6)]
HEALTHY_SEEDS = range(60321, 60326)


@cache
def logs_code() -> ModuleType:
    """The code that made the shipped recordings."""
    spec = spec_from_file_location("shipped_logs", REPOSITORY / "logs/make.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def first_name(diagnosis: Diagnosis) -> tuple[str, tuple[str, ...]] | None:
    """Effect and joints of the first name; None where nothing is named."""
    if not diagnosis.findings:
        return None
    first = diagnosis.findings[0]
    return first.effect, first.joints


def is_quiet(diagnosis: Diagnosis) -> bool:
    """Whether nothing is named and no gap is told."""
    return diagnosis.verdict == "no_gap" and not diagnosis.findings


@pytest.mark.parametrize("name", ["sealed_1", "sealed_2", "sealed_3"])
def test_a_sealed_session_is_named_right(name: str) -> None:
    """Law: the first name is the cause that the envelope holds, at its joint."""
    folder = Path(data_path("logs/tm5_900")) / name
    said = first_name(diagnose(folder, "tm5-900"))
    (true,) = open_envelope(folder, logs_code().sealed_key(name)).effects
    assert said is not None
    effect, joints = said
    assert effect == true.effect
    assert set(true.joints) <= set(joints)


@cache
def other_answers() -> dict[str, Any]:
    """What was wrong in each session of the other world."""
    answers: dict[str, Any] = json.loads((OTHER_WORLD / "answers.json").read_text(encoding="utf-8"))
    return answers


@pytest.mark.parametrize("name", OTHER_SESSIONS)
def test_a_session_of_another_world_is_told_right(name: str) -> None:
    """Law: a healthy arm has no gap and no name; of any other the first name is the cause, at its joint."""
    if not OTHER_WORLD.is_dir():
        pytest.skip(f"no sessions of another world at {OTHER_WORLD} (set IDENT_OTHER_WORLD)")
    diagnosis = diagnose(OTHER_WORLD / name, OTHER_WORLD / "robot.urdf")
    effects = other_answers()[name]["effects"]
    if not effects:
        assert is_quiet(diagnosis)
        return
    (true,) = effects
    said = first_name(diagnosis)
    assert said is not None
    effect, joints = said
    assert effect == true["effect"]
    assert true["joint"] in (None, *joints)


@pytest.mark.parametrize("seed", HEALTHY_SEEDS)
def test_a_healthy_simulated_session_is_quiet(seed: int) -> None:
    """Law: of an arm whose inertias are near the URDF's and whose friction is plain, nothing is told."""
    options = SimulationOptions(seed=seed, runs=8, duration=6.0, rate=100.0)
    session = simulate(options).session
    assert is_quiet(diagnose(session, "tm5-900"))
