"""The verdict: does the model follow the arm, how far did each rung bring it, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.errors import plural
from ident.model.evaluation import SessionScore
from ident.show.palette import RUNG_MEANINGS, rung_colours, rung_name
from ident.show.report.numbers import fixed, glue, pair, percent, places_for, table_places
from ident.show.report.page import Section
from ident.show.report.source import ReportInput, pool_name

# Share of the URDF's torque error that may be left for "follows", and for "follows in part".
FOLLOWS, IN_PART = 0.25, 0.7
# A rung that leaves more than this share of both errors isn't worth a word in the lead.
UNTOLD = 0.9
# From here on a joint is told to be worse: less is within the scatter of the runs.
WORSE = 1.02
SUBJECTS = {
    "inertia": "fitting the inertias",
    "loss": "friction",
    "named": "named laws",
    "net": "the net",
}


@dataclass(frozen=True, eq=False)
class VerdictSection(Section):
    """One sentence, the ladder at a glance, and the facts that a reader must know."""

    source: ReportInput
    anchor: ClassVar[str] = "verdict"
    title: ClassVar[str] = "Verdict"
    template: ClassVar[str] = "verdict.html"

    def context(self) -> dict[str, Any]:
        score = self.source.evaluation.pooled
        facts = [
            *self._largest_rest(score),
            *worse_joints(score),
            *self._payloads(),
            *self._judged(score),
            *self._telemetry(),
        ]
        return {
            "headline": glue(headline(score)),
            "lead": glue(describe_steps(score)),
            "seen": self.source.seen_runs(),
            "runs": sum(len(one.runs) for one in self.source.evaluation.sessions),
            "rows": glance_rows(score),
            "facts": [(kind, glue(text)) for kind, text in facts],
            "joints": joint_bars(score),
            "colours": rung_colours(score.rungs),
            "session": pool_name(score),
        }

    def _largest_rest(self, score: SessionScore) -> list[tuple[str, str]]:
        rest = score.rmse_mean[-1, :-1]
        if np.all(np.isnan(rest)):
            return []
        worst = int(np.nanargmax(rest))
        size = np.sqrt(
            np.mean(
                np.concatenate([trace.motion.tau_filtered[:, worst] for trace in self.source.evaluation.traces]) ** 2
            )
        )
        share = f", {percent(rest[worst] / size)} of its rms torque" if size > 0 else ""
        text = f"Largest torque error left: {score.joints[worst]}, {fixed(rest[worst], 2)} N m{share}."
        r2 = score.r2[-1]
        if np.any(np.isfinite(r2)):
            low = int(np.nanargmin(r2))
            text += f" Least explained: {score.joints[low]}, R² {fixed(r2[low], 3)}."
        return [("", text)]

    def _payloads(self) -> list[tuple[str, str]]:
        loaded = [one for one in self.source.evaluation.sessions if one.payload_kg > 0]
        if not loaded or len(loaded) == len(self.source.evaluation.sessions):
            return []
        errors = np.array([one.rmse_mean[:, -1] for one in loaded])
        ordered = bool(np.all(np.diff(errors, axis=1) < 0))
        heaviest = max(one.payload_kg for one in loaded)
        order = "every rung still helps" if ordered else "not every rung helps any more"
        text = (
            f"With up to {1000 * heaviest:.0f} g at the flange {order}; "
            f"torque error at most {fixed(errors[:, -1].max(), 2)} N m."
        )
        return [("good" if ordered else "warning", text)]

    def _judged(self, score: SessionScore) -> list[tuple[str, str]]:
        if self.source.seen_runs():
            return []
        known = bool(self.source.model.provenance.get("data"))
        unseen = "that the fit never saw" if known else "(which runs the model was fitted on is not recorded)"
        return [
            (
                "good" if known else "warning",
                f"Judged on {pool_name(score)}: {plural(len(score.runs), 'run')} {unseen}.",
            )
        ]

    def _telemetry(self) -> list[tuple[str, str]]:
        count = {level: sum(one.severity == level for one in self.source.issues) for level in ("fatal", "warning")}
        if count["fatal"]:
            return [("warning", f"Telemetry: {plural(count['fatal'], 'fatal issue')}. See the table below.")]
        if count["warning"]:
            return [("warning", f"Telemetry: {plural(count['warning'], 'warning')}. See the table below.")]
        return []


def headline(score: SessionScore) -> str:
    """Whether the last rung follows the arm, in one sentence with numbers."""
    first, last = score.rmse_mean[0, -1], score.rmse_mean[-1, -1]
    share = last / first if first > 0 else 1.0
    place = places_for([first, last])
    numbers = f"torque error {fixed(last, place)} N m; the URDF alone {fixed(first, place)} N m"
    if len(score.rungs) == 1:
        return f"Only the URDF was judged: torque error {fixed(first, place)} N m."
    below, with_last = np.sqrt(np.mean(score.energy_error[-2:].sum(axis=2) ** 2, axis=1))
    energy = ""
    if with_last > WORSE * below:
        off, before = (fixed(value, table_places([value])) for value in (with_last, below))
        last_rung = SUBJECTS.get(score.rungs[-1], score.rungs[-1])
        energy = f" Not in energy: with {last_rung} a run is off by {off} J, without by {before} J."
    words = "follows the arm" if share <= FOLLOWS else "follows the arm in part" if share <= IN_PART else ""
    return f"{f'The fitted model {words}' if words else 'The fit helps little'}: {numbers}.{energy}"


def describe_steps(score: SessionScore) -> str:
    """What each rung that matters does to the energy error of a run and to the torque error."""
    energy, torque = score.energy_mean[:, -1], score.rmse_mean[:, -1]
    told = [0]
    for k in range(1, len(score.rungs)):
        if torque[k] <= UNTOLD * torque[told[-1]] or abs(energy[k]) <= UNTOLD * abs(energy[told[-1]]):
            told.append(k)
    joule = [fixed(value, table_places([value])) for value in energy]
    start = joule[0]
    if len(told) == 1:
        return f"The energy error of a run is {start} J, and no rung changes that much."
    first = f"{SUBJECTS.get(score.rungs[told[1]], score.rungs[told[1]])} brings the energy error of a run from {start}"
    steps = [f"{first[0].upper()}{first[1:]} to {joule[told[1]]} J"]
    steps += [f"{SUBJECTS.get(score.rungs[k], score.rungs[k])} to {joule[k]} J" for k in told[2:]]
    return f"{', '.join(steps)}; torque error {' → '.join(fixed(torque[k], 2) for k in told)} N m."


def glance_rows(score: SessionScore) -> list[dict[str, Any]]:
    """The ladder's totals with bars: one row a rung."""
    energy, spread, torque = score.energy_mean[:, -1], score.energy_std[:, -1], score.rmse_mean[:, -1]
    several = len(score.runs) > 1
    colours = rung_colours(score.rungs)
    return [
        {
            "name": rung_name(rung),
            "meaning": RUNG_MEANINGS.get(rung, "named effects"),
            "colour": colours[rung],
            "energy": pair(energy[k], spread[k] if several else None, table_places([energy[k]])),
            "energy_bar": _share(abs(energy[k]), np.abs(energy)),
            "torque": fixed(torque[k], table_places([torque[k]])),
            "torque_bar": _share(torque[k], torque),
        }
        for k, rung in enumerate(score.rungs)
    ]


def worse_joints(score: SessionScore) -> list[tuple[str, str]]:
    """Joints on which the last rung makes the torque error larger than the rung before it."""
    if len(score.rungs) < 2:
        return []
    before, after = score.rmse_mean[-2, :-1], score.rmse_mean[-1, :-1]
    worse = [
        f"{joint} ({fixed(a)} → {fixed(b)} N m)"
        for joint, a, b in zip(score.joints, before, after, strict=True)
        if b > WORSE * a
    ]
    subject = SUBJECTS.get(score.rungs[-1], score.rungs[-1])
    return [("warning", f"Worse with {subject} than without: {', '.join(worse)}.")] if worse else []


def joint_bars(score: SessionScore) -> list[dict[str, Any]]:
    """Torque error of every joint and rung, bars on one scale."""
    rmse = score.rmse_mean[:, :-1]
    places = places_for(rmse.ravel())
    return [
        {
            "joint": joint,
            "bars": [
                {"rung": rung, "value": fixed(rmse[k, j], places), "bar": _share(rmse[k, j], rmse)}
                for k, rung in enumerate(score.rungs)
            ],
        }
        for j, joint in enumerate(score.joints)
    ]


def _share(value: float, of: Float[Array, "..."] | Sequence[float]) -> float:
    """Length of a bar in per cent of the longest."""
    top = float(np.nanmax(of)) if np.any(np.isfinite(of)) else 0.0
    return round(100.0 * float(value) / top, 1) if top > 0 and np.isfinite(value) else 0.0
