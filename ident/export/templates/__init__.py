"""Texts of the files that are written for others, with marks such as @NAME@ where numbers go."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path


def fill(template: str, marks: Mapping[str, str]) -> str:
    """A template's text, its marks filled in one pass: what is filled in may hold anything."""
    text = Path(__file__).with_name(template).read_text(encoding="utf-8")
    return re.sub("@([A-Z_0-9]+)@", lambda mark: marks[mark[1]], text)
