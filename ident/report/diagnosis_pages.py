"""Which sections make a page of a diagnosis."""

from __future__ import annotations


def write_diagnosis_report() -> None:
    raise NotImplementedError
