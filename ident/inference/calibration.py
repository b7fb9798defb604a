"""From features to probabilities and widths, by a calibration that a command fitted to a stored
corpus.

    log odds = b + Σ_k w_k (x_k − c_k) / s_k
    half-width² = q² ((f s)² + (d_e |θ|)²),   q the 97.5 % point of Student's t

`calibration.toml` is written by `python -m ident.benchmark.calibrate`, which says how it holds on
arms and worlds that were left out whole. No number of it is set by hand.

Source: Platt 1999 and Niculescu-Mizil and Caruana 2005 (calibrated probabilities).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit, stdtrit

from ident.arrays import Array, Float
from ident.effects.intervals import NORMAL_95
from ident.safe_read import read_toml

FILE = Path(__file__).with_name("calibration.toml")
# Degrees of freedom of errors of estimates over the corpus: a few are far off.
FREEDOM = 4.0
QUANTILE = float(stdtrit(FREEDOM, 0.975))
# Parameters of place have no size that a law could be off by a share of.
PLACES = ("order", "start_s", "end_s")
# What is off by a share of a wave's amplitude moves its phase by as many radians at the most.
PHASE = "phase_rad"

# Components of a vector, of which the whole has a size.
COMPONENT = re.compile(r"_[xyz](?=_)")
# Samples at which the temper is stated.
LOG_THOUSAND = float(np.log(1000.0))


def sizes_of(values: Mapping[str, float]) -> dict[str, float]:
    """Size that each parameter's error may be a share of.

    Args:
        values: Parameters by name; the components of one vector end alike but for their axis.

    Returns:
        By the same names: a scalar's absolute value, the length of the vector that a component
        belongs to, and for the phase 1 rad.
    """
    squares: dict[str, float] = {}
    for name, value in values.items():
        family = COMPONENT.sub("", name)
        squares[family] = squares.get(family, 0.0) + float(value) ** 2
    sizes = {name: float(np.sqrt(squares[COMPONENT.sub("", name)])) for name in values}
    return {name: 1.0 if name == PHASE else size for name, size in sizes.items()}


@dataclass(frozen=True)
class Term:
    """One feature's part in the log odds."""

    weight: float  # of the standardised feature [nats]
    centre: float  # its mean over the corpus
    scale: float  # its standard deviation over the corpus

    def nats(self, value: float) -> float:
        """What a feature's value adds to the log odds, against the mean value in the corpus [nats].

        0 where the value is not finite.
        """
        standard = (value - self.centre) / self.scale
        return self.weight * standard if np.isfinite(standard) else 0.0


@dataclass(frozen=True)
class Odds:
    """A fitted logistic regression."""

    intercept: float
    terms: Mapping[str, Term]

    def parts(self, features: Mapping[str, float]) -> dict[str, float]:
        """What each feature adds to the log odds, by its name [nats].

        Args:
            features: Values by name; those without a term are left out.

        Raises:
            KeyError: A feature that has a term is missing.
        """
        return {name: term.nats(features[name]) for name, term in self.terms.items()}

    def probability(self, features: Mapping[str, float]) -> float:
        """Probability, from 0 to 1, that the log odds of the intercept and all features make.

        Args:
            features: Values by name, as for `parts`.
        """
        return float(expit(self.intercept + sum(self.parts(features).values())))


@dataclass(frozen=True)
class Widths:
    """How wide 95 % intervals have to be."""

    factor: float  # on the standard deviation of what the recordings leave open
    share: float  # of a parameter's size that any arm's own law may be off by
    of_left: float = 0.0  # the same, of what a smooth function still finds beside the law

    def half_width(self, parameter: str, half: float, size: float, left: float = 0.0) -> float:
        """Half the width of an interval.

        Args:
            parameter: Its name.
            half: Half the width that the recordings alone leave open.
            size: What the law's share is of (`sizes_of`).
            left: Torque that a smooth function still finds beside the law, as a share of the law's.

        Returns:
            Half of the wider 95 % interval, in the parameter's unit.
        """
        share = 0.0 if parameter in PLACES else float(np.hypot(self.share, self.of_left * left))
        return float(QUANTILE * np.hypot(self.factor * half / NORMAL_95, share * abs(size)))


def left_of_kind(shape_left: float | Float[Array, " N"]) -> Float[Array, " N"]:
    """Root mean square torque that a smooth function still finds beside a law.

    Args:
        shape_left: The feature of that name, a logarithm of squares; minus infinity where nobody
            looked.

    Returns:
        Shares of the law's own torque; 0 where nobody looked.
    """
    return np.exp(0.5 * np.asarray(shape_left, dtype=float))


@dataclass(frozen=True)
class Temper:
    """Exponent of the evidence between rivals, as it grows with the number of samples."""

    of_thousand: float  # with a thousand samples
    growth: float  # power of the number of samples

    def at(self, log_rows: float) -> float:
        """The exponent with so many samples, by their logarithm: a short recording's evidence is
        less to be believed, nat for nat.

        Args:
            log_rows: Natural logarithm of the number of samples.
        """
        return float(self.of_thousand * (np.exp(log_rows) / 1000.0) ** self.growth)


@dataclass(frozen=True)
class NameCalibration:
    """The fitted numbers by which chosen effects are told."""

    names: Odds  # of a chosen effect, or one of its class, being the cause
    temper: float  # exponent of the evidence between rivals, of a thousand samples
    growth: float  # power of the number of samples by which it grows
    widths: Widths | None  # None for intervals as the recordings alone have them
    # Share of the probability that stays where a parameter is none that an arm has.
    unlike_any_arm: float

    def temper_of(self, features: Mapping[str, float]) -> float:
        """Exponent of the evidence between rivals where an effect has such features.

        Args:
            features: By name; only `log_rows` counts, the logarithm of the number of samples (1000
                samples where it is missing).
        """
        growing = Temper(self.temper, self.growth)
        return growing.at(features.get("log_rows", LOG_THOUSAND))


@dataclass(frozen=True)
class Calibration(NameCalibration):
    """All numbers that were fitted to the corpus."""

    gaps: Odds  # of a joint having a cause that none of the names is
    even_nats: float  # log evidence at which half of the corpus' chosen effects were right [nats]


@cache
def load_calibration(path: Path = FILE) -> Calibration:
    """The calibration that the package ships, or another.

    Raises:
        InputError: There is no such file, or it can't be read.
    """
    record = read_toml(path, "write it: python -m ident.benchmark.calibrate fit")
    return Calibration(
        names=read_odds(record),
        gaps=read_odds(record["gap"]),
        even_nats=float(record["even_nats"]),
        temper=float(record["temper"]),
        growth=float(record["temper_growth"]),
        widths=_widths(record["widths"]),
        unlike_any_arm=float(record["unlike_any_arm"]["share"]),
    )


@cache
def load_names(path: Path) -> NameCalibration:
    """The numbers that names alone are told by (no joint's gap), from a file of their own.

    They don't depend on the number of samples: the growth is 0. What a parameter that no arm has
    says is fitted to diagnoses alone: the bounds are the same.

    Raises:
        InputError: There is no such file, or it can't be read.
    """
    record = read_toml(path, "write it: python -m ident.benchmark.change_calibration fit")
    widths = _widths(record["widths"])
    unlike_any_arm = load_calibration().unlike_any_arm
    return NameCalibration(read_odds(record), float(record["temper"]), 0.0, widths, unlike_any_arm)


def _widths(record: Mapping[str, Any]) -> Widths:
    return Widths(
        float(record["factor"]), float(record["share"]), float(record.get("of_left", 0.0))
    )


def read_odds(record: Mapping[str, Any]) -> Odds:
    """The odds that a part of a calibration's file holds."""
    terms = {name: Term(**values) for name, values in record["feature"].items()}
    return Odds(float(record["intercept"]), terms)
