"""A decision rule on the whole stored table: what would be named, and how right that is.

    python -m ident.benchmark.replay score TABLE [--findings | --calibration FILE | --held-out]
    [--json OUT]
    python -m ident.benchmark.replay compare BEFORE AFTER [the same options, for AFTER; BEFORE by
    its findings]

Names come from what was reported (`--findings`), from a calibration's probabilities, or from those
that each row got from a fit without its own arm or world (`--held-out`, the default). A rule takes
candidates in the order of their probability and skips one that a name before it says already; what
is at 0.5 or more is a name.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from ident.arrays import Array, Float
from ident.benchmark.calibrate import HELD_OUT_FILE
from ident.benchmark.calibration_file import read_calibration
from ident.benchmark.corpus_table import CANDIDATE, FINDING, Table, load_table
from ident.benchmark.outcomes import apply_rule
from ident.benchmark.paired import compare, comparison_lines
from ident.benchmark.score_table import lines_of, score
from ident.errors import InputError
from ident.files import write_record


def load_rule(
    folder: Path, findings: bool, calibration: Path | None
) -> tuple[Table, Float[Array, " N"]]:
    """A table, and the probabilities by which its rows are named.

    Raises:
        InputError: Held-out probabilities are wanted and there are none, or they are of another
        table.
    """
    if findings:
        table = load_table(folder, FINDING)
        return table, table.probability
    table = load_table(folder, CANDIDATE)
    if calibration is not None:
        model = read_calibration(calibration)
        return table, model.probability(table.matrix(model.names))
    path = folder / HELD_OUT_FILE
    if not path.is_file():
        raise InputError(
            path, "no such file", "fit a calibration to the table first, or give --calibration"
        )
    probability = pq.read_table(path).column("probability").to_numpy()
    if len(probability) != len(table.rows):
        what = f"has {len(probability)} rows, the table {len(table.rows)}"
        raise InputError(path, what, "fit a calibration to this table")
    return table, np.asarray(probability, dtype=float)


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("job", choices=("score", "compare"))
    parser.add_argument("tables", type=Path, nargs="+")
    parser.add_argument("--findings", action="store_true")
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--held-out", action="store_true", help="the default")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    table, probability = load_rule(given.tables[-1], given.findings, given.calibration)
    outcomes = apply_rule(table, probability)
    if given.job == "score":
        record = score(table, outcomes)
        lines = list(lines_of(record))
    else:
        table_before, probability_before = load_rule(given.tables[0], True, None)
        record = compare(apply_rule(table_before, probability_before), outcomes)
        lines = list(comparison_lines(record))
    if given.json:
        write_record(given.json, record)
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
