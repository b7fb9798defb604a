"""Ranges for domain randomisation of simulated arms whose friction changes from day to day.

    python tests/bench/bench_ranges.py ARMS [--days 6] [--spread 0.05] [--seed N] [--fitted]

Of each arm: the share of held-out days' torque inside the ranges and noise, and how many times narrower than ± 30 % of
every figure the ranges are there (noise aside). The reference is the URDF, whose links are off by 3 %, or with
`--fitted` a model fitted to the first day.
"""

from __future__ import annotations

import argparse

import numpy as np

from ident import fit_hybrid, ranges
from ident.model.hybrid import FitOptions
from ident.robot.arm import ArmModel
from ident.simulation.simulate import SimulationOptions, simulate


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("arms", type=int)
    parser.add_argument("--days", type=int, default=6)
    parser.add_argument("--spread", type=float, default=0.05)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fitted", action="store_true")
    options = parser.parse_args()
    arm = ArmModel.load("tm5-900")
    rows = []
    for k in range(options.arms):
        rng = np.random.default_rng([options.seed, k])
        days = []
        for day in range(options.days):
            factors = tuple(map(float, np.exp(options.spread * rng.standard_normal(arm.n))))
            settings = SimulationOptions(
                seed=int(rng.integers(2**31)),
                arm_seed=options.seed + k,
                runs=6,
                duration=6.0,
                motions=("fourier", "spline", "ladder"),
                friction_factors=factors,
            )
            days.append(simulate(settings, f"day_{day}").session)
        model = fit_hybrid(days[:1], arm, FitOptions(net="none")).model if options.fitted else None
        found = ranges(days, arm, model=model)
        share = np.array(list(found.inside.values()))
        rows.append((share.mean(), share.min(), found.narrower))
        print(f"arm {k}: inside {share.mean():.3f}, worst joint {share.min():.3f}, {found.narrower:.1f} x narrower")
    mean, worst, narrower = np.array(rows).T
    print(f"inside: median {np.median(mean):.3f}, worst arm {mean.min():.3f}, worst joint {worst.min():.3f}")
    print(f"narrower: median {np.median(narrower):.1f}, least {narrower.min():.1f}")


if __name__ == "__main__":
    main()
