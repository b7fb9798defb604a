"""Prints the table of where the lumped model breaks. Run: pytest <this file> -s."""

from __future__ import annotations

from ident.robot.arm import ArmModel
from tests.ident.robot.lumping import lumping_table, print_table


def test_print_where_lumping_breaks() -> None:
    """TM5-900, set R, a grid of one degree over joints 2 and 3 within their limits."""
    rows = lumping_table(ArmModel.load("tm5-900"), step_deg=1.0)
    print("\n" + print_table(rows))
    assert all(row.gravity > 2.5 and row.m11_ratio > 7.8 for row in rows)
