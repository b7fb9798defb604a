"""Closes the gap of simulated arms with three random effects each, beside rivals made from the same recordings.

    python tests/bench/bench_close.py ARMS [--seed N] [--robot R] [--seconds S] [--json FILE]

Of each arm: minutes of motion until the gap was closed, the torque gap on motions that served nothing else in noise
floors, and the tracking error of one controller (computed torque of the model, the same soft feedback for all) on the
true arm. Rivals: the URDF as it is, links and losses tuned without any effect, the URDF with a residual net alone, and
the middle of wide randomisation. Fresh from the system's entropy unless a seed is given; no further arm is begun after
so many seconds of processor time.
"""

import argparse
import json
import secrets
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from ident.closed_loop.result import close_simulated
from ident.errors import InputError

MODELS = ("urdf", "randomised", "tuned", "net", "closed")
KEYS = {"urdf": "tracking_before_rad", "closed": "tracking_after_rad"}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("arms", type=int)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--robot", default="tm5-900")
    parser.add_argument("--seconds", type=float, default=np.inf)
    parser.add_argument("--json", type=Path, default=None)
    options = parser.parse_args()
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(options.arms):
            if time.process_time() > options.seconds:
                break
            started = time.process_time()
            try:
                found = close_simulated(options.robot, seed + k, Path(folder) / str(k))
            except InputError as error:
                print(f"{seed + k}: {error}", flush=True)
                continue
            rows.append({**found, "seconds": time.process_time() - started})
            print(tell(rows[-1]), flush=True)
            if options.json is not None:
                options.json.write_text(json.dumps(rows, indent=1))
    print("\n".join(table(rows)))


def tell(row: dict[str, Any]) -> str:
    """One arm in a line."""
    floors = ", ".join(f"{name} {row['heldout_floors'][name]:.2f}" for name in MODELS)
    missed = ", ".join(f"{name} {1e3 * tracking(row, name):.2f}" for name in MODELS)
    end = "closed" if row["closed"] else "NOT closed"
    return (
        f"{row['seed']}: {', '.join(row['effects'])} | named {'; '.join(row['named']) or 'nothing'} | {end}, "
        f"{row['rounds']} rounds, {row['minutes']:.1f} min | floors: {floors} | mrad: {missed} | {row['seconds']:.0f} s"
    )


def tracking(row: dict[str, Any], name: str) -> float:
    """Tracking error with a model [rad]."""
    return float(row[KEYS.get(name, f"{name}_after_rad")])


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Medians and worst."""
    if not rows:
        return ["no arm"]
    minutes = [row["minutes"] for row in rows]
    closed = sum(row["closed"] for row in rows)
    lines = [
        f"{closed} of {len(rows)} closed; minutes of motion: median {np.median(minutes):.1f}, most {max(minutes):.1f}",
        "| model | torque gap [noise floors], median (worst) | tracking error [mrad], median (worst) |",
        "|---|---|---|",
    ]
    for name in MODELS:
        floors = [row["heldout_floors"][name] for row in rows]
        missed = [1e3 * tracking(row, name) for row in rows]
        cells = (f"{np.median(values):.2f} ({max(values):.2f})" for values in (floors, missed))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    main()
