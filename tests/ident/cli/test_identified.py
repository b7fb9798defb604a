"""`ident export` and `ident verify` as a user runs them."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.cli.app import app
from ident.files import sha256_of
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.process import NOT_PASSED
from ident.robot.arm import ArmModel
from ident.robot.names import data_path

E1 = Path(data_path("logs/tm5_900")) / "E1"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    arm = ArmModel.load("tm5-900")
    loss = LossParameters(*(np.full(6, value) for value in (0.1, 8.0, 6.0, 0.0, 0.02)))
    return HybridModel(arm, arm, arm, loss).save(tmp_path / "model")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    def call(*arguments: object) -> int:
        monkeypatch.setattr(sys, "argv", ["ident", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            app()
        return int(end.value.code or 0)

    return call


def test_export_writes_the_formats_that_were_asked_for(run: Callable[..., int], model: Path, tmp_path: Path) -> None:
    """Two formats, their files, and what was found when they were loaded back."""
    out, record = tmp_path / "out", tmp_path / "export.json"
    assert run("export", model, "--out", out, "--format", "urdf", "--format", "toml", "--json", record) == 0
    assert (out / "robot.urdf").is_file()
    assert not (out / "robot.xml").exists()
    assert json.loads(record.read_text())["files"] == ["robot.urdf", "parameters.toml"]


@pytest.mark.parametrize(("bound", "status"), [(1000.0, 0), (0.001, NOT_PASSED)])
def test_verify_is_a_gate(bound: float, status: int, run: Callable[..., int], model: Path, tmp_path: Path) -> None:
    """Exit 0 where the limit is kept, 3 where it is not; the record says which, either way."""
    limits, record = tmp_path / "limits.toml", tmp_path / "verify.json"
    limits.write_text(f"[torque_rmse_Nm]\ntotal = {bound}\n")
    assert run("verify", model, E1, "--limits", limits, "--json", record) == status
    assert json.loads(record.read_text())["passed"] is (status == 0)


def test_a_gate_on_the_data_of_the_fit_passes_by_request_alone(
    run: Callable[..., int], model: Path, tmp_path: Path
) -> None:
    """Law: one common file is enough for exit 3, whatever the limits; --in-sample accepts it; the record says so."""
    limits, record = tmp_path / "limits.toml", tmp_path / "verify.json"
    limits.write_text("[torque_rmse_Nm]\ntotal = 1000.0\n")
    fitted = HybridModel.load(model)
    data = [{"session": "E1", "file": "one", "sha256": sha256_of(sorted(E1.glob("*.parquet"))[0])}]
    replace(fitted, provenance={"data": data}).save(tmp_path / "seen")
    assert run("verify", tmp_path / "seen", E1, "--limits", limits, "--json", record) == NOT_PASSED
    assert json.loads(record.read_text())["in_sample"]
    assert run("verify", tmp_path / "seen", E1, "--limits", limits, "--in-sample") == 0
