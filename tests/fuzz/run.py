"""`make fuzz`: spoilt files into every reader and command, kills amid every write, hostile options.

    python -m tests.fuzz.run [--seconds 60] [--seed N] [--keep out/fuzz] [--only KIND,KIND]
                             [--tally FILE] [--corpus DIR]

What was counted is added to the file of --tally, which many runs may share; all of it is printed last.

Each input follows from (seed, number); what ends badly is kept with its evidence, and the same seed gives it again.
"""

import argparse
import json
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import torch

from tests.fuzz.commands import command_table
from tests.fuzz.corpus import in_a_child, write_files
from tests.fuzz.kills import kill_table
from tests.fuzz.kinds import kinds
from tests.fuzz.options import option_table
from tests.fuzz.readers import GOOD, OUTCOMES, Readers
from tests.fuzz.tally import Tally, add_up, total

# Of the time: the rest goes to kills, options and whole commands.
READING = 0.8
Table = tuple[tuple[str, ...], dict[str, list[int]], tuple[str, ...]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=secrets.randbits(32))
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--only", default="", help="kinds of files, with commas; no kills and options then")
    parser.add_argument("--corpus", type=Path, help="folder of good files, written before; written anew if not given")
    parser.add_argument("--tally", type=Path, help="file that counts are added to")
    options = parser.parse_args()
    tally = Tally(options.tally, "files", options.seed) if options.tally else None
    only = {name for name in options.only.split(",") if name}
    # Children are forked: threads of libraries would not be there in them.
    torch.set_num_threads(1)
    pa.set_cpu_count(1)
    with tempfile.TemporaryDirectory() as place:
        os.environ["HOME"] = place
        if options.corpus is None:
            in_a_child(write_files, Path(place))
        else:
            shutil.copytree(options.corpus, place, dirs_exist_ok=True)
        made = [kind for kind in kinds(Path(place)) if not only or kind.name in only]
        readers = Readers(made, Path(place), options.seed, options.keep.absolute())
        readers.run(options.seconds * (1.0 if only else READING), tally)
    print(f"seed {options.seed}: {readers.inputs} inputs")
    bad = _print(OUTCOMES, readers.table(), GOOD)
    if not only:
        rest = options.seconds * (1.0 - READING) / 3
        with tempfile.TemporaryDirectory() as place:
            in_a_child(write_files, Path(place), False)
            parts: dict[str, Callable[[], Table]] = {
                "kills": lambda: kill_table(rest, options.seed),
                "hostile options": lambda: option_table(rest, options.seed, Path(place)),
                "whole commands": lambda: command_table(rest, options.seed, kinds(Path(place)), Path(place)),
            }
            for title, part in parts.items():
                outcomes, table, good = part()
                print(f"{title}: {sum(map(sum, table.values()))}")
                bad = _print(outcomes, table, good) or bad
    for part, counts in (add_up(options.tally) if options.tally else {}).items():
        print(f"{part} of all runs: {json.dumps(total(counts))}")
    sys.exit(1 if bad else 0)


def _print(outcomes: tuple[str, ...], table: dict[str, list[int]], good: tuple[str, ...]) -> bool:
    """Prints a table; whether there is anything but good outcomes in it."""
    print(f"{'':<28}" + "".join(f"{outcome:>11}" for outcome in outcomes))
    for name, counts in table.items():
        print(f"{name:<28}" + "".join(f"{count:>11}" for count in counts))
    sums = [sum(column) for column in zip(*table.values(), strict=True)]
    print(f"{'all':<28}" + "".join(f"{count:>11}" for count in sums), flush=True)
    return any(count for outcome, count in zip(outcomes, sums, strict=True) if outcome not in good)


if __name__ == "__main__":
    main()
