"""Works out the next motion to record: what `plan excite` does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ident.api.diagnosing import Catalogue, gather_effects
from ident.diagnosis.result import Diagnosis
from ident.progress import stage
from ident.results import Provenance
from ident.sessions import Robot, load_robot
from plan.command_options import ExciteOptions
from plan.experiment.design import Designer
from plan.experiment.feasible import surroundings_of
from plan.experiment.hypotheses import ask
from plan.experiment.result import Excitation
from plan.geometry.tool import hang


def excite(
    robot: Robot = "tm5-900",
    *,
    diagnosis: Diagnosis | Mapping[str, Any] | str | Path | None = None,
    catalogue: Catalogue | None = None,
    **options: Any,
) -> Excitation:
    """The motion that tells two effects apart, in the fewest minutes.

    Args:
        robot: URDF path, name or arm.
        diagnosis: A diagnosis, its record, or the file of `ident diagnose --json`: its open
            question, sizes and noise.
        catalogue: Further effects, or a Python file with them (which is run).
        options: Any field of `ExciteOptions`, as the options of `plan excite`: `separate`, `joint`,
            `minutes` …

    Raises:
        InputError: Unknown effects or joint, or a diagnosis of another arm.
        TypeError: No such option.
    """
    chosen = ExciteOptions(**options)
    arm = load_robot(robot, ())
    around = surroundings_of(arm, chosen)
    _, payload, _ = hang(arm, around.attached, around.payload, around.payload_link)
    if payload is not None:
        arm = arm.with_payload(payload)
    record = diagnosis.to_dict() if isinstance(diagnosis, Diagnosis) else diagnosis
    hypotheses = ask(arm, chosen.separate, chosen.joint, record, gather_effects(catalogue))
    stage("searching for motions")
    excitation = Designer(arm, hypotheses, chosen, around).best()
    settings: dict[str, object] = {
        "robot": arm.name,
        "diagnosis": str(diagnosis) if isinstance(diagnosis, str | Path) else None,
    }
    for name, value in asdict(chosen).items():
        settings[name] = str(value) if isinstance(value, Path) else value
    return excitation.with_provenance(Provenance("plan excite", settings=settings))
