"""Are effects named from the told limit on? A healthy session of the simulated arm tells the limits; sessions of the
same arm with one effect at multiples of its limit are diagnosed.

    python tests/bench/bench_limits.py --seed 31 --multiples 0.25,0.5,1

About ten seconds of processor time a session.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.sessions import Given, inspect_sources
from ident.simulation.causes import CATALOGUE as CAUSES
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import SimulationOptions, simulate

RUNS, DURATION_S = 7, 5.0


def look(options: SimulationOptions) -> dict[str, Any]:
    """The diagnosis of a simulated session."""
    arm, reports = inspect_sources(Given([simulate(options).session], options.robot)).whole
    return diagnose_reports(reports, arm, CATALOGUE)[0].to_dict()


def try_effect(
    limit: dict[str, Any], healthy: SimulationOptions, number: int, multiples: Sequence[float]
) -> list[tuple[float, bool]]:
    """Whether one effect was named at multiples of its limit."""
    joint = limit["joints"][0] if len(limit["joints"]) == 1 else ""
    found = []
    for k, multiple in enumerate(multiples):
        size = limit["limit"] * multiple if limit["named"] == "above" else limit["limit"] / multiple
        request = EffectRequest(limit["effect"], joint, size=size)
        options = replace(healthy, seed=healthy.seed + 1000 * number + k, effects=(request,))
        try:
            record = look(options)
        except InputError as error:
            print(f"{limit['effect']} {joint}: {error}")
            continue
        named = [(one["effect"], one["joints"]) for one in record["findings"]]
        right = any(effect == limit["effect"] and (not joint or joint in joints) for effect, joints in named)
        print(f"{limit['effect']} {joint} {limit['figure']} {size:.3g}, {multiple:g} x: {right}, {named}", flush=True)
        found.append((multiple, right))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--multiples", default="0.25,0.5,1")
    asked = parser.parse_args()
    multiples = [float(one) for one in asked.multiples.split(",")]
    healthy = SimulationOptions(seed=asked.seed, arm_seed=asked.seed, runs=RUNS, duration=DURATION_S)
    seen = [one for one in look(healthy)["detectable"] if one["limit"] is not None and not one["hidden"]]
    results: list[tuple[float, bool]] = []
    for number, (name, cause) in enumerate(CAUSES.items(), start=1):
        own = [one for one in seen if one["effect"] == name and one["figure"] == cause.parameter]
        if own:
            results += try_effect(own[(number + asked.seed) % len(own)], healthy, number, multiples)
    for multiple in multiples:
        right = [hit for at, hit in results if at == multiple]
        print(f"{multiple:g} x the limit: {sum(right)} of {len(right)} named")


if __name__ == "__main__":
    main()
