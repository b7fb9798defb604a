"""A small board without recordings, and what its maker keeps: enough for whatever reads one."""

from pathlib import Path
from typing import Any

import numpy as np

from ident.benchmark.board.files import write_columns
from ident.benchmark.board.published import published_effects
from ident.benchmark.board.sealing import salt_of, seal_of
from ident.files import write_record
from ident.outputs import sha256_of

JOINTS = ["shoulder", "elbow"]
ROWS = 20


def write_board(folder: Path) -> None:
    """Writes `board`, `kept` and `entry`: two sessions, of which the first comes with an unseen motion."""
    facts = {"tier": "drawn", "arm": "arm", "joints": JOINTS, "before": False}
    sessions = {"s001": facts | {"unseen": True}, "s002": facts | {"unseen": False}}
    torque = _write_unseen(folder)
    cause = {"effect": "payload", "in_catalogue": True, "may_stand_at": [], "parameters": {"mass_kg": 1.0}}
    answers: dict[str, dict[str, Any]] = {
        "s001": {"session": "s001", "kind": "single", "effects": [cause], "unseen_sha256": torque},
        "s002": {"session": "s002", "kind": "healthy", "effects": [], "unseen_sha256": ""},
    }
    salts = {name: salt_of(0, name) for name in sessions}
    sealed = {name: seal_of(salts[name], answer) for name, answer in answers.items()}
    board = {"schema": "ident.board/1", "sources": {}, "arms": ["arm"], "sessions": sessions}
    effects = {"schema": "ident.board_effects/1", "effects": published_effects()}
    kept = {"schema": "ident.board_kept/1", "seed": 0, "salts": salts, "answers": answers, "oracle": {}}
    write_record(folder / "board/board.json", board)
    write_record(folder / "board/effects.json", effects)
    write_record(folder / "board/truths.json", {"schema": "ident.board_truths/1", "sealed": sealed})
    write_record(folder / "kept/answers.json", kept)
    interval = {"value": 1.0, "low": 0.8, "high": 1.1}
    name = {"effect": "payload", "joint": "", "probability": 0.6, "parameters": {"mass_kg": interval}}
    said = {"schema": "ident.board_answer/1", "effects": [name], "none": 0.3, "other": 0.1}
    for session in sessions:
        write_record(folder / f"entry/{session}.json", said | {"session": session})


def _write_unseen(folder: Path) -> str:
    """An unseen motion, its torque and the entrant's; the hash of the torque's file."""
    time = np.arange(ROWS) / 100.0
    torque = {f"{joint}/effort": np.sin(time) for joint in JOINTS}
    position = {f"{joint}/position": np.cos(time) for joint in JOINTS}
    write_columns({"time": time, **position}, folder / "board/unseen/s001.parquet")
    write_columns({"time": time, **torque}, folder / "kept/unseen/s001.parquet")
    write_columns({"time": time, **torque}, folder / "entry/s001.parquet")
    return sha256_of(folder / "kept/unseen/s001.parquet")
