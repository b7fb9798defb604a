"""A Panda from a ROS 2 bag: is the recording fit for use, what does a model explain, where is what is left?

python examples/panda_from_a_bag.py recording.db3 out
"""

import sys
from pathlib import Path

from ident import FitOptions, diagnose, fit_hybrid, inspect


def main(bag: Path, out: Path) -> None:
    print(inspect(bag, "panda").summary())
    fitted = fit_hybrid(bag, "panda", FitOptions(inertia="consistent", net="none", offset=True))
    fitted.model.save(out / "model")
    print(fitted.summary())
    found = diagnose(bag, "panda")
    found.save(out / "why.json")
    found.plot().savefig(out / "why.png")
    print(found.summary())


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
