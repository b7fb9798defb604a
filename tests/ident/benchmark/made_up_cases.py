"""Answers and results of diagnoses, made up for the scoring."""

from typing import Any

from ident.simulation.request import Answer, TrueEffect

JOINTS = tuple(f"joint_{i}" for i in range(1, 7))
FLOOR = dict.fromkeys(JOINTS, 0.1)


def truth(effect: str = "stribeck_friction", joint: str = "joint_2", **parameters: float | str) -> TrueEffect:
    visible = {name: 0.3 if name in (joint, "joint_3") else 0.0 for name in JOINTS}
    return TrueEffect(effect, True, (joint,) if joint else (), 1.0, "size", parameters, visible)


def answer(*effects: TrueEffect) -> Answer:
    return Answer("tm5-900", 1, effects, (), FLOOR)


def finding(
    effect: str, *joints: str, p: float = 0.9, rivals: tuple[str, ...] = (), **parameters: tuple[float, float]
) -> dict[str, Any]:
    return {
        "effect": effect,
        "joints": list(joints),
        "probability": p,
        "class": [effect, *rivals],
        "rivals": dict.fromkeys(rivals, 2.0),
        "parameters": {
            name: {"value": sum(ends) / 2, "low": ends[0], "high": ends[1]} for name, ends in parameters.items()
        },
    }


def result(
    *findings: dict[str, Any], verdict: str = "named", worst: str = "joint_2", heldout: dict[str, Any] | None = None
) -> dict[str, Any]:
    gap = {name: {"rms_Nm": 0.4 if name == worst else 0.1, "noise_floor_Nm": 0.1} for name in JOINTS}
    record = {"verdict": verdict, "findings": list(findings), "gap": gap, "joints": list(JOINTS)}
    return {"diagnosis": record, "seconds": 5.0, "heldout": heldout, "rivals": {"lasso": [["payload", ""]]}}
