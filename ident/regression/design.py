"""Which column of the one big regression belongs to what.

All joints' torques are explained at once. The unknowns are, in this order: changes of the base
parameters (they act on all joints), three loss parameters a joint, then every candidate effect at
every point of its inner grid. A candidate whose torque acts on its own joint only is kept apart
from those that act on several, so that a joint's rows carry no column that is zero by construction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ident.arrays import Array, Int
from ident.effects import optional
from ident.effects.base import Effect, SessionContext, Variant
from ident.effects.intervals import SizePrior

LOSS_PARAMETERS = 3

Key = tuple[str, int, int | None]
"""Effect, joint (−1 for the whole arm) and other joint: what is named, whatever the inner
parameters.
"""
Grid = tuple[Effect, int, Sequence[Variant]]
"""An effect at a joint with its points."""


@dataclass(frozen=True, eq=False)
class Group:
    """One candidate: an effect at a joint at one point of its inner grid."""

    effect: Effect  # the effect
    joint: int  # its joint; 0 for an effect of the whole arm
    variant: Variant  # the point of the inner grid
    columns: Int[Array, " k"]  # its columns in the big regression
    prior: SizePrior | None = None  # what is known of its coefficients beforehand, if that decides
    borrows: bool = False  # whether its columns are some of another candidate's

    @cached_property
    def key(self) -> Key:
        """Effect, joint and other joint: what is named, whatever the inner parameters."""
        return (
            self.effect.id,
            self.joint if self.effect.scope == "joint" else -1,
            self.variant.other,
        )

    @cached_property
    def signed(self) -> tuple[int, ...]:
        """Those of its columns whose coefficients can't be negative."""
        return optional.signed(self.effect, self.variant)

    def acts_on(self, n: int) -> list[int]:
        """Those of an arm's n joints whose torque it changes."""
        return [self.joint] if self.effect.rows == "own" else list(range(n))


@dataclass(frozen=True, eq=False)
class NotTestable:
    """An effect that these recordings cannot show at a joint, and why."""

    effect: Effect
    joint: int
    reason: str

    def to_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        """Its record, by the names of the joints."""
        one_joint = self.effect.scope == "joint"
        return {
            "effect": self.effect.id,
            "joints": [joints[self.joint]] if one_joint else list(joints),
            "reason": self.reason,
        }


@dataclass(frozen=True, eq=False)
class Layout:
    """Columns of the big regression."""

    rank: int  # number of base parameters
    n: int  # number of joints
    groups: tuple[Group, ...]  # all candidates
    # for each joint, the columns of candidates that act on it alone
    own: tuple[Int[Array, " k"], ...]
    shared: Int[Array, " k"]  # the columns of candidates that act on several joints
    silent: tuple[NotTestable, ...]  # what can't be tested at all
    # columns of effects, right after the loss parameters, that are part of the baseline
    further: int = 0
    # Standard deviation of the coefficient of each of them beforehand; () where a prior says it.
    further_std: tuple[float, ...] = ()
    # For each joint the blocks of its discrepancy, which are no candidates; () where the layout has
    # none.
    flexible: tuple[tuple[Group, ...], ...] = ()

    @property
    def tuned(self) -> int:
        """Number of columns of the baseline."""
        return self.rank + LOSS_PARAMETERS * self.n + self.further

    @property
    def size(self) -> int:
        """Number of columns; the torque itself is column `size`."""
        candidates = sum(len(columns) for columns in self.own) + len(self.shared)
        return self.rank + LOSS_PARAMETERS * self.n + candidates

    @cached_property
    def local(self) -> tuple[Int[Array, " p"], ...]:
        """For each joint, the columns that its rows carry: base, own loss, own candidates, shared,
        torque.
        """
        return tuple(
            np.concatenate(
                [
                    np.arange(self.rank),
                    self.rank + LOSS_PARAMETERS * j + np.arange(LOSS_PARAMETERS),
                    self.own[j],
                    self.shared,
                    [self.size],
                ]
            ).astype(int)
            for j in range(self.n)
        )

    @cached_property
    def flexible_places(self) -> tuple[Int[Array, " m"], ...]:
        """For each joint, where the columns of its discrepancy stand in its rows."""
        columns = [_columns_of(blocks) for blocks in self.flexible]
        return tuple(
            np.flatnonzero(np.isin(local, smooth))
            for local, smooth in zip(self.local, columns or [[]] * self.n, strict=True)
        )

    @cached_property
    def places(self) -> tuple[dict[int, int], ...]:
        """For each joint, where each of its columns stands in its rows."""
        return tuple(_place_of_each(local) for local in self.local)


def _columns_of(groups: Sequence[Group]) -> list[int]:
    """Columns of some groups, one after the other."""
    return [column for group in groups for column in group.columns]


def _place_of_each(columns: Int[Array, " p"]) -> dict[int, int]:
    """Where each of some columns stands among them."""
    return {int(column): place for place, column in enumerate(columns)}


def build_layout(
    session: SessionContext,
    rank: int,
    catalogue: Sequence[Effect],
    beside: Sequence[Effect] = (),
    flexible: Sequence[Effect] = (),
) -> Layout:
    """Lays out every testable effect at every point of its grid.

    Args:
        session: The runs.
        rank: Number of base parameters.
        catalogue: The effects that are candidates.
        beside: Effects that are part of the baseline, as far as they can be seen.
        flexible: Blocks of each joint's discrepancy.
    """
    silent, grids = find_grids(
        catalogue, lambda _: session, lambda effect, *where: effect.variants(*where)
    )
    return layout_of(session, rank, grids, silent, searched=True, beside=beside, flexible=flexible)


def find_grids(
    effects: Sequence[Effect],
    session_of: Callable[[Effect], SessionContext],
    points: Callable[[Effect, SessionContext, int], Sequence[Variant]],
) -> tuple[list[NotTestable], list[Grid]]:
    """Every effect at every joint with its points, and what can't be seen.

    Args:
        effects: The effects.
        session_of: The runs that an effect is looked for in.
        points: An effect's points at a joint.
    """
    silent: list[NotTestable] = []
    grids: list[Grid] = []
    for effect in effects:
        session = session_of(effect)
        for joint in range(session.n if effect.scope == "joint" else 1):
            if reason := effect.untestable(session, joint):
                silent.append(NotTestable(effect, joint, reason))
            elif grid := points(effect, session, joint):
                grids.append((effect, joint, grid))
    return silent, grids


def layout_of(
    session: SessionContext,
    rank: int,
    grids: Sequence[Grid],
    silent: Sequence[NotTestable] = (),
    searched: bool = False,
    beside: Sequence[Effect] = (),
    flexible: Sequence[Effect] = (),
) -> Layout:
    """Lays out effects at joints, each with its grid; asks a short stretch of the session for the
    number of columns.

    Args:
        session: The runs.
        rank: Number of base parameters.
        grids: Effects at joints, each with its points.
        silent: What can't be tested.
        searched: Whether names are looked for, so that parts of points are candidates, too
            (`optional.parts`).
        beside: Effects of one joint that are part of the baseline wherever they can be seen, each
            with a prior scale.
        flexible: Blocks of each joint's discrepancy, in columns after all others.
    """
    own_joints = [
        (effect, j)
        for effect in beside
        for j in range(session.n)
        if effect.untestable(session, j) is None
    ]
    nuisances = [(effect, j, (Variant(),)) for effect, j in own_joints]
    std = [effect.prior_scale(session, j, Variant()) for effect, j in own_joints]
    sample = replace(session, runs=(session.runs[0].copied(),))  # what it computes goes with it
    start = rank + LOSS_PARAMETERS * session.n
    groups: list[Group] = []
    own_columns: list[list[int]] = [[] for _ in range(session.n)]
    shared: list[int] = []
    for effect, joint, variants in [*nuisances, *grids]:
        for variant in variants:
            width = effect.columns(sample, joint, variant)[0].shape[-1]
            columns = np.arange(start, start + width)
            start += width
            prior = optional.size_prior(effect, session, joint, variant)
            groups.append(Group(effect, joint, variant, columns, prior))
            for point, some in optional.parts(effect, variant) if searched else ():
                groups.append(Group(effect, joint, point, columns[list(some)], prior, borrows=True))
            (own_columns[joint] if effect.rows == "own" else shared).extend(columns)
    blocks: list[tuple[Group, ...]] = []
    for joint in range(session.n if flexible else 0):
        inputs = flexible[0].variants(session, joint)[0]
        of_joint = []
        for effect in flexible:
            width = effect.columns(sample, joint, inputs)[0].shape[-1]
            columns = np.arange(start, start + width)
            of_joint.append(Group(effect, joint, inputs, columns))
            own_columns[joint].extend(columns)
            start += width
        blocks.append(tuple(of_joint))
    return Layout(
        rank=rank,
        n=session.n,
        groups=tuple(groups[len(nuisances) :]),
        own=tuple(np.array(columns, dtype=int) for columns in own_columns),
        shared=np.array(shared, dtype=int),
        silent=tuple(silent),
        further=sum(len(group.columns) for group in groups[: len(nuisances)]),
        further_std=tuple(
            float(deviation) for each in std if each is not None for deviation in each
        ),
        flexible=tuple(blocks),
    )
