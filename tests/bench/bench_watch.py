"""How often `ident watch` raises a false alarm in an arm-year, and how soon it tells a change.

    python tests/bench/bench_watch.py [--arms 20] [--years 5] [--seed N]

Arms of six joints and 34 figures (gains at four joints), one session a week. Each figure has a mean, a day-to-day
spread and errors of its own; what is drawn are figures, not recordings. Days are normal, of Student's t with 5 or 3
degrees of freedom, lognormal, or depend on the day before (correlation 0.3), which the law does not cover. Changes come
in one figure of an arm after 12 to 40 sessions: steps of 2, 3 or 5 spreads, and drifts of 0.2 spreads a week.
"""

import argparse
import secrets
from collections.abc import Callable

import numpy as np

from ident.arrays import Array
from ident.monitor.alarms import Alarm, Point, find_changes
from ident.monitor.estimates import UNITS

WEEKS = 52
NAMES = [f"week_{i:02}" for i in range(WEEKS)]
KEYS = [(f"joint_{j}", figure) for j in range(1, 7) for figure in UNITS if figure != "gain" or j in (2, 3, 4, 5)]
Days = Callable[[np.random.Generator, int], Array]


def correlated(rng: np.random.Generator, count: int, share: float = 0.3) -> Array:
    days = rng.standard_normal(count)
    for i in range(1, count):
        days[i] = share * days[i - 1] + np.sqrt(1.0 - share**2) * days[i]
    return days


DAYS: dict[str, Days] = {
    "normal": lambda rng, count: rng.standard_normal(count),
    "t, 5 degrees of freedom": lambda rng, count: rng.standard_t(5, count) / np.sqrt(5 / 3),
    "t, 3 degrees of freedom": lambda rng, count: rng.standard_t(3, count) / np.sqrt(3),
    "lognormal": lambda rng, count: (np.exp(0.5 * rng.standard_normal(count)) - 1.13) / 0.6,
    "correlated 0.3 (not covered)": correlated,
}
CHANGES: dict[str, Callable[[Array], Array]] = {
    "step of 2 spreads": lambda weeks: 2.0 * (weeks >= 0),
    "step of 3 spreads": lambda weeks: 3.0 * (weeks >= 0),
    "step of 5 spreads": lambda weeks: 5.0 * (weeks >= 0),
    "drift of 0.2 spreads a week": lambda weeks: 0.2 * np.maximum(weeks, 0),
}


def draw_arm(
    rng: np.random.Generator, days: Days, changed: tuple[str, str] | None = None, course: Array | None = None
) -> dict[tuple[str, str], list[Point]]:
    """A year of an arm's figures."""
    found = {}
    for key in KEYS:
        mean, spread = rng.uniform(0.5, 30.0), 10.0 ** rng.uniform(-2, -1)
        error = rng.uniform(0.2, 0.7)
        values = days(rng, WEEKS) + error * rng.standard_normal(WEEKS)
        if key == changed and course is not None:
            values = values + course * np.sqrt(1.0 + error**2)
        std = mean * spread * error * rng.uniform(0.8, 1.25, WEEKS)
        numbers = mean * (1.0 + spread * values)
        found[key] = [
            Point(float(x), float(x - 2 * s), float(x + 2 * s), float(s), name, name)
            for name, x, s in zip(NAMES, numbers, std, strict=True)
        ]
    return found


def false_alarms(rng: np.random.Generator, days: Days, years: int) -> tuple[int, int]:
    """Alarms, and arms with any, in so many arm-years without a change."""
    found = [len(find_changes("arm", draw_arm(rng, days), NAMES)[0]) for _ in range(years)]
    return sum(found), sum(count > 0 for count in found)


def delays(rng: np.random.Generator, course: Callable[[Array], Array], arms: int) -> tuple[list[int], int, int]:
    """Weeks until the changed figure is named; changes missed to the year's end; other figures named."""
    weeks, missed, wrong = [], 0, 0
    for _ in range(arms):
        start, key = int(rng.integers(12, 41)), KEYS[rng.integers(len(KEYS))]
        shape = course(np.arange(WEEKS) - start)
        alarms = find_changes("arm", draw_arm(rng, DAYS["normal"], key, shape), NAMES)[0]
        right = [alarm for alarm in alarms if _place(alarm) >= start and (alarm.joint, alarm.figure) == key]
        wrong += len(alarms) - len(right)
        missed += not right
        weeks += [_place(right[0]) - start + 1] if right else []
    return weeks, missed, wrong


def _place(alarm: Alarm) -> int:
    return NAMES.index(alarm.session)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=20)
    parser.add_argument("--years", type=int, default=5)
    parser.add_argument("--seed", type=int, default=None)
    given = parser.parse_args()
    seed = secrets.randbits(48) if given.seed is None else given.seed
    rng = np.random.default_rng(seed)
    print(f"seed {seed}; {len(KEYS)} figures an arm, {WEEKS} sessions a year, level 5 % in an arm's life")
    for name, days in DAYS.items():
        years = given.arms * given.years
        alarms, arms = false_alarms(rng, days, years)
        print(f"{name:30} {alarms} false alarms in {years} arm-years ({alarms / years:.3f} a year), {arms} arms")
    for name, course in CHANGES.items():
        weeks, missed, wrong = delays(rng, course, given.arms)
        seen = f"median {np.median(weeks):.0f} weeks, 90 % within {np.quantile(weeks, 0.9):.0f}" if weeks else "never"
        print(f"{name:30} {seen}; {missed} of {given.arms} not within the year; {wrong} other figures named")


if __name__ == "__main__":
    main()
