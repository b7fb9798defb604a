"""Call traces of whole commands: files entered and file-to-file arrows; see trace_command.py."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

Figures = dict[str, float]
TRACER = Path(__file__).parents[1] / "trace_command.py"
# Commands that are traced, in the order in which one needs another.
TRACED = ("fit", "diagnose", "compare", "solve")


def trace(folder: Path, *arguments: object) -> dict[str, int]:
    """Files entered and file-to-file arrows of one whole command, in a process of its own."""
    given = list(map(str, arguments))
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "trace.json"
        done = subprocess.run(
            [sys.executable, str(TRACER), str(folder), str(out), *given],
            capture_output=True,
            text=True,
            check=False,
            env=environment,
        )
        if not out.is_file():
            raise RuntimeError(f"{' '.join(given)} ended early: {done.stderr[-2000:]}")
        counts: dict[str, int] = json.loads(out.read_text(encoding="utf-8"))
    status = counts.pop("status")
    if status:
        raise RuntimeError(f"{' '.join(given)}: status {status}")
    return counts


def measure_traces(folder: Path, names: Sequence[str] = TRACED) -> Figures:
    """Traces of a fit without a net, a diagnosis, a comparison and a plan, on shipped recordings.

    Args:
        folder: A working tree.
        names: Those of `TRACED` that are wanted; a plan needs the fit's model.
    """
    logs = folder / "logs" / "tm5_900"
    scene = folder / "tests" / "plan" / "data" / "obstacle.toml"
    robot = ("--robot", "tm5-900")
    with tempfile.TemporaryDirectory() as scratch:
        model = Path(scratch) / "model"
        fit = ("ident", "fit", logs / "T1", logs / "T2", *robot, "--net", "none", "--out", model)
        commands = {
            "fit": fit,
            "diagnose": ("ident", "diagnose", logs / "sealed_1", *robot),
            "compare": ("ident", "compare", logs / "E1", logs / "E2", *robot),
            "solve": ("plan", "solve", scene, "--model", model, "--seconds", 60),
        }
        traces = {name: trace(folder, *commands[name]) for name in names}
    figures = {}
    for name, counts in traces.items():
        for unit, number in counts.items():
            figures[f"{unit}_of_{name}"] = number
    return figures
