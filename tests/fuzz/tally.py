"""What all runs of the fuzzer have counted so far: a file of lines of JSON, of which the last of each run counts."""

import json
from pathlib import Path

Table = dict[str, dict[str, int]]


class Tally:
    """The counts of one run, in a file that others add to as well.

    Args:
        path: The file.
        part: What is counted: `files`, `commands` or `kills`.
        seed: Of the run.
    """

    def __init__(self, path: Path, part: str, seed: int) -> None:
        self.path, self.part, self.seed = path, part, seed

    def write(self, table: Table) -> None:
        """Adds the counts up to now, by kind and outcome: a run that is ended outright has told them."""
        line = json.dumps({"part": self.part, "seed": self.seed, "table": table})
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(f"{line}\n")


def add_up(path: Path) -> dict[str, Table]:
    """The counts of all runs in a file, by part, kind and outcome."""
    latest = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        record = json.loads(line)
        latest[record["part"], record["seed"]] = record["table"]
    sums: dict[str, Table] = {}
    for (part, _), table in latest.items():
        counts = sums.setdefault(part, {})
        for kind, outcomes in table.items():
            row = counts.setdefault(kind, {})
            for outcome, count in outcomes.items():
                row[outcome] = row.get(outcome, 0) + count
    return sums


def total(table: Table) -> dict[str, int]:
    """Counts by outcome over all kinds; those that never came are left out."""
    sums: dict[str, int] = {}
    for outcomes in table.values():
        for outcome, count in outcomes.items():
            sums[outcome] = sums.get(outcome, 0) + count
    return {outcome: count for outcome, count in sums.items() if count}
