"""Works out the next motion to record: what `plan excite` does."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ident.api.diagnosing import Catalogue, gather_effects
from ident.diagnosis.result import Diagnosis
from ident.progress import stage, step
from ident.provenance import Provenance
from ident.sessions import Robot, load_robot
from plan.experiment import design
from plan.experiment.around import surroundings_of
from plan.experiment.hypotheses import ask
from plan.experiment.result import Excitation
from plan.geometry.tool import place_payload


def excite(
    robot: Robot = "tm5-900",
    *,
    separate: str | None = None,
    diagnosis: Diagnosis | Mapping[str, Any] | str | Path | None = None,
    joint: str | None = None,
    catalogue: Catalogue | None = None,
    minutes: float | None = None,
    evaluations: int = 120,
    seed: int = 0,
    shapes: str | None = None,
    scene: str | Path | None = None,
    floor: str = "0",
    top_speed: float | None = None,
) -> Excitation:
    """The motion that tells two effects apart, in the fewest minutes.

    Args:
        robot: URDF path, name or arm.
        separate: Effects to tell apart, or one to show: "id,id".
        diagnosis: A diagnosis, its record, or the file of `ident diagnose --json`: its open question, sizes and noise.
        joint: The joint in question: its name or number from 1.
        catalogue: Further effects, or a Python file with them (which is run).
        minutes: Length of the motion; as long as odds of 20 : 1 take if None.
        evaluations: Most motions that the search judges.
        seed: Of all randomness.
        shapes: What stands in for links without a collision shape: `visual`, `capsules` or `boxes`.
        scene: Scene file: obstacles, floor, what is carried, limits; its task is left aside.
        floor: Height of the floor above the base [m], or `none`; a scene's own floor counts instead.
        top_speed: Top speed of every joint [deg/s].

    Raises:
        InputError: Unknown effects or joint, or a diagnosis of another arm.
    """
    arm = load_robot(robot, ())
    around = surroundings_of(arm, None if scene is None else Path(scene), floor, top_speed)
    if around.payload is not None:
        arm = arm.with_payload(place_payload(arm, around.payload, around.payload_link))
    record = diagnosis.to_dict() if isinstance(diagnosis, Diagnosis) else diagnosis
    question = ask(arm, separate, joint, record, gather_effects(catalogue))
    kind: Any = shapes
    stage("searching motions")
    found = design.excite(arm, question, minutes, evaluations, seed, step, kind, around)
    settings = {
        "robot": arm.name,
        "separate": separate,
        "diagnosis": str(diagnosis) if isinstance(diagnosis, str | Path) else None,
        "joint": joint,
        "minutes": minutes,
        "evaluations": evaluations,
        "seed": seed,
        "shapes": shapes,
        "scene": None if scene is None else str(scene),
        "floor": floor,
        "top_speed_deg_s": top_speed,
    }
    return found.with_provenance(Provenance("plan excite", settings=settings))
