"""Finds an effect that the URDF does not know, and writes it as files for simulators.

    python examples/find_and_patch_an_effect.py out

The arm is simulated here, with a spring at its third joint; take your own recordings in its place.
"""

import sys
from pathlib import Path

from ident import diagnose, patch, simulate


def main(out: Path, runs: int = 8) -> None:
    recorded = simulate("spring_torque:3:10x", seed=7, runs=runs, duration=6.0)
    found = diagnose(recorded, "tm5-900")
    print(found.summary())
    heard = simulate("spring_torque:3:10x", seed=7, runs=3, duration=6.0, motions=("fourier",))
    written = patch(found, "tm5-900", out / "patch", on=heard)
    print(written.summary())
    written.plot().savefig(out / "patch.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
