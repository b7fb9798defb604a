"""An identification in words: a line each for what a person should know of it."""

from __future__ import annotations

import numpy as np

from ident.fitting.identification import Identified
from ident.laws.carried import KINDS
from ident.model.loss import WORDS

# Numbers of a link in words.
LINK_WORDS = {
    "m": "mass",
    **{f"m{axis}": f"first moment {axis}" for axis in "xyz"},
    **{f"I{axes}": f"inertia {axes}" for axes in ("xx", "xy", "yy", "xz", "yz", "zz")},
}
# Pairs that are reported in words; all stand in the model.
MOST_TIED = 4


def describe(identified: Identified) -> list[str]:
    """What a person should know of an identification beside its parameters, a line each."""
    condition = identified.inertia.condition_number
    off = 100 * identified.urdf_share
    size = "less than 1 %" if off < 1.0 else f"about {off:.0f} %"
    joints = zip(identified.loss.joints, 100 * identified.estimate.spread, strict=True)
    spreads = ", ".join(f"{name} {spread:.2g} %" for name, spread in joints)
    changes = f"friction changes from one stretch to another by: {spreads}"
    if np.ptp(identified.estimate.spread) == 0.0:
        changes = "one run does not tell how much friction changes from run to run"
    lines = [
        f"condition number of the motions: {condition:.0f} (optimised motion: 10 to 60)",
        f"link inertias are {size} of each link's scale off the URDF's, by these recordings",
        changes,
    ]
    if identified.tied:
        tied = identified.tied[:MOST_TIED]
        pairs = [pair_in_words(first, second) for first, second, _ in tied]
        line = f"not told apart by these motions: {'; '.join(pairs)}"
        more = len(identified.tied) - MOST_TIED
        if more > 0:
            line += f"; and {more} more {'pair' if more == 1 else 'pairs'}"
        lines.append(line)
    lines += [law.describe(identified.loss.joints) for law in identified.named]
    if identified.through_reversals:
        names = ", ".join(identified.through_reversals)
        lines.append(f"too little clear of reversals, fitted through them: {names}")
    if identified.lossless:
        names = ", ".join(identified.lossless)
        lines.append(f"effort without friction or rotor, as of torque at the link: {names}")
    return lines


def in_words(figure: str) -> str:
    """A parameter's name as people say it: `rotor inertia of joint_1`, `mass of link_2`."""
    owner, _, name = figure.rpartition(".")
    if name in WORDS:
        return f"{WORDS[name]} of {owner}"
    if name in LINK_WORDS:
        return f"{LINK_WORDS[name]} of {owner}"
    law, label = _law_in_words(figure)
    return f"{law}, {label}" if label else law


def pair_in_words(first: str, second: str) -> str:
    """Two parameters that are not told apart; of one law it is named once."""
    law, label = _law_in_words(first)
    other_law, other_label = _law_in_words(second)
    if law == other_law and label and other_label:
        return f"{law}, {label} with {other_label}"
    return f"{in_words(first)} with {in_words(second)}"


def _law_in_words(figure: str) -> tuple[str, str]:
    """The law and joint that a coefficient is of, and what it is of it; as it stands if of none."""
    owner, _, name = figure.rpartition(".")
    joint, _, effect = owner.rpartition(".")
    if effect not in KINDS or not name.isdecimal():
        return figure, ""
    labels = KINDS[effect].labels
    number = int(name) - 1
    label = labels[number] if number < len(labels) else f"coefficient {name}"
    return f"{KINDS[effect].words} at {joint}", label
