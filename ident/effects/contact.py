"""A push from outside: a force at a link during a window of time.

A push is an event, not a law: runs without it say nothing of its force, and it can't be held out.
It is looked for where the tuned model leaves much more than usual, with the pattern of a link's
Jacobian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, Range, SessionContext, Variant
from ident.effects.intervals import amplitude_interval, exactly
from ident.effects.pushes import (
    Leftover,
    Push,
    find_span,
    force_columns,
    largest_force,
    locate,
    points_of_links,
    screen_windows,
)
from ident.effects.settings import CONTACT as LIMIT
from ident.units import FORCE


@dataclass(frozen=True)
class ExternalContact(Effect):
    """A force f along one direction of the base frame at a point of a link during a window: τ = −Jᵀ
    f.

    It sets in and fades at once, or swells until the middle of a longer window, as a hand's does.
    The plain effect has no windows; `screened` finds them where something is left to explain.
    """

    pushes: tuple[Push, ...] = ()  # windows to be asked for
    screens: int = 1  # number of windows and points that were looked at to find them

    id = "external_contact"

    def screened(
        self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
    ) -> ExternalContact:
        cells = (
            sum(float(run.motion.time[-1] - run.motion.time[0]) for run in session.runs)
            / LIMIT.shortest_window
        )
        left = Leftover(session, leftover)
        located = [locate(left, push) for push in screen_windows(left)]
        apart: list[Push] = []
        for candidate in sorted(located, key=lambda located_push: -located_push.fall):
            clear = candidate.share >= LIMIT.least_explained and not any(
                candidate.push.overlaps(other) for other in apart
            )
            apart += [candidate.push] if clear and len(apart) < LIMIT.most_pushes else []
        spans = [locate(left, find_span(left, push)) for push in apart]
        pushes = (
            *apart,
            *(
                located_span.push
                for located_span in spans
                if located_span.share >= LIMIT.least_explained
            ),
        )
        return replace(
            self, pushes=pushes, screens=max(1, round(2 * cells * len(points_of_links(session.n))))
        )

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        shapes: list[dict[str, float]] = []
        for push in self.pushes:
            reach = 0.5 * (push.end - push.start)
            middle = 0.5 * (push.start + push.end)
            where = {
                "link": float(push.link or session.n),
                "outward": push.outward,
                f"run {push.run}": 1.0,
            }
            for swells, wider in ((0.0, 1.0), (1.0, LIMIT.swelling)):
                ends = {"start_s": middle - wider * reach, "end_s": middle + wider * reach}
                shapes.append(ends | {"swells": swells} | where)
        return tuple(Variant(shape=shape) for shape in shapes)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        """−Jᵀ for the three directions of the base frame, inside the window."""
        start, end, outward = (variant.shape[name] for name in ("start_s", "end_s", "outward"))
        edge = (
            0.5 * (end - start) if variant.shape["swells"] else min(LIMIT.edge, (end - start) / 4)
        )
        by_run = []
        for run in session.runs:
            time = run.motion.time
            columns = np.zeros((len(time), run.n, 3))
            inside = np.flatnonzero((time > start) & (time < end))
            if f"run {run.motion.name}" in variant.shape and len(inside):
                since_start = time[inside] - start
                until_end = end - time[inside]
                nearest = np.minimum(since_start, until_end)
                ramp = np.clip(nearest / edge, 0.0, 1.0)
                envelope = 0.5 - 0.5 * np.cos(np.pi * ramp)
                force = force_columns(
                    run.arm,
                    run.motion.q[inside],
                    round(variant.shape["link"]),
                    outward,
                    session.tuned,
                )
                columns[inside] = envelope[:, None, None] * force
            by_run.append(columns)
        return by_run

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        start = variant.shape["start_s"]
        end = variant.shape["end_s"]
        doubt = LIMIT.edge + 0.1 * (end - start)
        # A force along which no joint turns is anything: no more than such an arm bears.
        most = largest_force(session) ** 2 * np.eye(len(coefficients))
        known = most @ np.linalg.inv(most + covariance)
        return {
            "start_s": Interval(start, start - doubt, start + doubt),
            "end_s": Interval(end, end - doubt, end + doubt),
            "force_N": amplitude_interval(known @ coefficients, known @ covariance),
            "link": exactly(variant.shape["link"]),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        return {"force_N": Range(0.0, largest_force(session), "the arm would have stopped")}

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        start = estimates["start_s"].value
        end = estimates["end_s"].value
        force = estimates["force_N"].words(FORCE)
        link = round(estimates["link"].value)
        what = (
            f"link {link} or one behind it (with {force} if at the centre of mass of link {link})"
        )
        nearest = min(
            self.pushes, key=lambda push: abs(push.start + push.end - start - end), default=None
        )
        # clocks may restart with each run
        clock = "" if nearest is None else f" on the clock of {nearest.run}"
        return (
            f"find what pushed {what}, from {start:.1f} to {end:.1f} s{clock}, and record in free "
            "space"
        )

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        return np.full(3, largest_force(session))
