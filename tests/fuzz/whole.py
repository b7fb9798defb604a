"""Whether a result file is whole: what a reader of its kind, other than ours, makes of it."""

import json
import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import yaml

PNG_END = b"IEND\xaeB`\x82"
SMALLEST_RERUN = 64  # of a file of Rerun's: its head alone [bytes]


def what_is_broken(path: Path) -> str:
    """What shows that a file is not whole; "" where nothing does."""
    check = CHECKS.get(path.suffix)
    if check is None:
        return "" if path.stat().st_size else "it is empty"
    try:
        check(path)
    except Exception as error:
        return f"{type(error).__name__}: {error}"[:200]
    return ""


def _json_lines(path: Path) -> None:
    for line in path.read_text(encoding="utf-8").splitlines():
        json.loads(line)


def _page(path: Path) -> None:
    if not path.read_text(encoding="utf-8").rstrip().endswith("</html>"):
        raise ValueError("the page does not end")


def _picture(path: Path) -> None:
    if not path.read_bytes().endswith(PNG_END):
        raise ValueError("the picture does not end")


def _table(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    if not text.endswith("\n"):
        raise ValueError("the last row does not end")
    if len({line.count(",") for line in text.splitlines()}) != 1:
        raise ValueError("rows of several lengths")


def _recording(path: Path) -> None:
    if path.stat().st_size < SMALLEST_RERUN:
        raise ValueError("hardly more than a head")


CHECKS: dict[str, Callable[[Path], object]] = {
    ".json": lambda path: json.loads(path.read_text(encoding="utf-8")),
    ".jsonl": _json_lines,
    ".toml": lambda path: tomllib.loads(path.read_text(encoding="utf-8")),
    ".yaml": lambda path: yaml.safe_load(path.read_text(encoding="utf-8")),
    ".parquet": pq.read_table,
    ".html": _page,
    ".png": _picture,
    ".csv": _table,
    ".npz": lambda path: [np.load(path)[name] for name in np.load(path).files],
    ".npy": np.load,
    ".urdf": ElementTree.parse,
    ".xml": ElementTree.parse,
    ".svg": ElementTree.parse,
    ".rrd": _recording,
    ".py": lambda path: compile(path.read_text(encoding="utf-8"), str(path), "exec"),
}
