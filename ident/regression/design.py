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
        """What is named, whatever the inner parameters.

        Effect's id, index of the joint (-1 for the whole arm), and that of the other joint (None
        without one).
        """
        joint = self.joint if self.effect.scope == "joint" else -1
        return (self.effect.id, joint, self.variant.other)

    @cached_property
    def signed(self) -> tuple[int, ...]:
        """Places, among its columns, of those whose coefficients can't be negative."""
        return optional.signed(self.effect, self.variant)

    def acts_on(self, n: int) -> list[int]:
        """Indices of those of an arm's n joints whose torque it changes."""
        return [self.joint] if self.effect.rows == "own" else list(range(n))


@dataclass(frozen=True, eq=False)
class NotTestable:
    """An effect that these recordings cannot show at a joint, and why."""

    effect: Effect
    joint: int
    reason: str

    def to_dict(self, joints: Sequence[str]) -> dict[str, Any]:
        """Its record for JSON.

        Args:
            joints: Names of the arm's joints.

        Returns:
            `effect` (id), `joints` (names; all of an effect of the whole arm) and `reason`.
        """
        one_joint = self.effect.scope == "joint"
        return {
            "effect": self.effect.id,
            "joints": [joints[self.joint]] if one_joint else list(joints),
            "reason": self.reason,
        }


@dataclass(frozen=True, eq=False)
class Layout:
    """Columns of the big regression.

    Attributes:
        rank: Number of base parameters.
        n: Number of joints.
        groups: All candidates.
        by_joint: For each joint, the columns of candidates that act on it alone.
        shared: The columns of candidates that act on several joints.
        silent: What can't be tested at all.
        further: Columns of effects, right after the loss parameters, that are part of the baseline.
        further_std: Standard deviation of the coefficient of each of them beforehand; () where a
            prior says it.
        flexible: For each joint the blocks of its discrepancy, which are no candidates; () where
            the layout has none.
    """

    rank: int
    n: int
    groups: tuple[Group, ...]
    by_joint: tuple[Int[Array, " k"], ...]
    shared: Int[Array, " k"]
    silent: tuple[NotTestable, ...]
    further: int = 0
    further_std: tuple[float, ...] = ()
    flexible: tuple[tuple[Group, ...], ...] = ()

    @property
    def tuned(self) -> int:
        """Number of columns of the baseline."""
        return self.rank + LOSS_PARAMETERS * self.n + self.further

    @property
    def size(self) -> int:
        """Number of columns; the torque itself is column `size`."""
        candidates = sum(len(columns) for columns in self.by_joint) + len(self.shared)
        return self.rank + LOSS_PARAMETERS * self.n + candidates

    @cached_property
    def local(self) -> tuple[Int[Array, " p"], ...]:
        """For each joint, the columns that its rows carry: base, own loss, own candidates, shared,
        torque.
        """
        base = np.arange(self.rank)
        columns = []
        for j, candidates in enumerate(self.by_joint):
            loss = self.rank + LOSS_PARAMETERS * j + np.arange(LOSS_PARAMETERS)
            of_joint = np.concatenate([base, loss, candidates, self.shared, [self.size]])
            columns.append(of_joint.astype(int))
        return tuple(columns)

    @cached_property
    def flexible_places(self) -> tuple[Int[Array, " m"], ...]:
        """For each joint, where the columns of its discrepancy stand in its rows."""
        columns: list[list[int]] = [_columns_of(blocks) for blocks in self.flexible]
        if not columns:
            columns = [[] for _ in range(self.n)]
        pairs = zip(self.local, columns, strict=True)
        return tuple(np.flatnonzero(np.isin(local, smooth)) for local, smooth in pairs)

    @cached_property
    def places(self) -> tuple[dict[int, int], ...]:
        """For each joint, by column of the layout, where the column stands in the joint's rows."""
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

    Returns:
        What can't be tested, with the reason; and (effect, joint, points) of all else. An effect
        without points at a joint is in neither.
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


class _LayoutBuilder:
    """Gives columns to effects, one after the other; asks a short stretch for how many they have.

    Args:
        session: The runs.
        rank: Number of base parameters.
    """

    def __init__(self, session: SessionContext, rank: int) -> None:
        self.session = session
        # What it computes goes with it.
        self.sample = replace(session, runs=(session.runs[0].copied(),))
        self.next_column = rank + LOSS_PARAMETERS * session.n
        self.of_joints: list[list[int]] = [[] for _ in range(session.n)]
        self.shared: list[int] = []

    def columns_for(self, effect: Effect, joint: int, variant: Variant) -> Int[Array, " k"]:
        """New columns for a point of an effect at a joint."""
        width = effect.columns(self.sample, joint, variant)[0].shape[-1]
        columns = np.arange(self.next_column, self.next_column + width)
        self.next_column += width
        acting = self.of_joints[joint] if effect.rows == "own" else self.shared
        acting.extend(columns)
        return columns

    def groups_of(self, grids: Sequence[Grid], searched: bool) -> list[Group]:
        """Groups of all points of some grids; with parts of them, if names are looked for."""
        groups: list[Group] = []
        for effect, joint, variants in grids:
            for variant in variants:
                columns = self.columns_for(effect, joint, variant)
                prior = optional.size_prior(effect, self.session, joint, variant)
                groups.append(Group(effect, joint, variant, columns, prior))
                parts = optional.parts(effect, variant) if searched else ()
                for point, places in parts:
                    of_point = columns[list(places)]
                    groups.append(Group(effect, joint, point, of_point, prior, borrows=True))
        return groups

    def discrepancy_of(self, joint: int, flexible: Sequence[Effect]) -> tuple[Group, ...]:
        """Groups of the blocks of a joint's discrepancy."""
        inputs = flexible[0].variants(self.session, joint)[0]
        blocks = []
        for effect in flexible:
            columns = self.columns_for(effect, joint, inputs)
            blocks.append(Group(effect, joint, inputs, columns))
        return tuple(blocks)


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
    nuisances: list[Grid] = []
    deviations: list[float] = []
    for effect in beside:
        for joint in range(session.n):
            if effect.untestable(session, joint) is None:
                nuisances.append((effect, joint, (Variant(),)))
                scale = effect.prior_scale(session, joint, Variant())
                deviations += [] if scale is None else map(float, scale)
    builder = _LayoutBuilder(session, rank)
    further = builder.groups_of(nuisances, searched=False)
    groups = builder.groups_of(grids, searched)
    joints = range(session.n if flexible else 0)
    blocks = tuple(builder.discrepancy_of(joint, flexible) for joint in joints)
    return Layout(
        rank=rank,
        n=session.n,
        groups=tuple(groups),
        by_joint=tuple(np.array(columns, dtype=int) for columns in builder.of_joints),
        shared=np.array(builder.shared, dtype=int),
        silent=tuple(silent),
        further=sum(len(group.columns) for group in further),
        further_std=tuple(deviations),
        flexible=blocks,
    )
