"""Whether two recordings are one: by the series that they hold, not by the bytes of their files.

A recording that is written again with fewer digits, shifted in time, thinned out, cut or with its
columns in another order has other bytes and the same moments. A motion that an arm makes again has
moments of its own: the noise of its torque is another.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from ident.arrays import Array, Float
from ident.records import JsonRecord, JsonTable

if TYPE_CHECKING:
    from scipy.spatial import KDTree

    from ident.recordings.recording import Recording

# A run is known by so many of its moments: one in so many seconds, within these bounds.
MOMENT_S = 2.0
FEWEST = 32
MOST = 128
# Two moments are one where no channel differs by more than this share of its spread.
NEAR = 3e-4
# Rounding of text tables with five decimals [rad, N m], in place of that share where a channel
# hardly moves.
ROUNDING = 1e-5
# A recording is another one again where at least one in so many of its moments a joint, and so
# many, lie in it. Of 3,418 pairs of runs of real arms, in which many made a motion again, no
# moment lay in both but for arms of one joint, there at most 0.19 of them. Of runs at half their
# rate with five decimals at least 0.28 lie in the first ones; of runs of one joint 0.13, so that
# some such copies of these are not known again (tests/bench/repeated_motions.py).
SHARE = 4
LEAST = 4
# What no position or torque is; NaN is not below it either.
BEYOND = 1e9
# Rows of a run in which its own moments are looked for.
MOST_SEARCHED = 20_000


@dataclass(frozen=True, eq=False)
class Series:
    """Some moments of a run, by which it is known again.

    Attributes:
        joints: The joints, in alphabetical order.
        moments: Positions [rad or m] and efforts [N m or N] of all joints, shape (M, 2 n).
        scale: What counts as a difference of one, of each of these columns, shape (2 n,).
    """

    joints: tuple[str, ...]
    moments: Float[Array, "M k"]
    scale: Float[Array, " k"]

    @classmethod
    def of(cls, run: Recording) -> Self | None:
        """The moments of a run at which its torque is least smooth; None where it has too few of
        its own.

        A moment that another stretch of the run repeats, at rest say, says nothing.
        """
        joints = tuple(sorted(run.joints))
        table = _table(run, joints)
        table = table[_sound(table)]
        if len(table) < FEWEST:
            return None
        low, high = np.quantile(table, (0.1, 0.9), axis=0)
        # Powers of two: of one arm's runs most have the same scale, and are looked for together.
        reach = np.maximum(high - low, ROUNDING / NEAR)
        scale = np.exp2(np.round(np.log2(reach)))
        scaled = table[:, len(joints) :] / scale[len(joints) :]
        bends = np.abs(np.diff(scaled, 2, axis=0)).sum(axis=1)
        rough = np.concatenate([[0.0], bends, [0.0]])
        # A run that is logged every minute has fewer rows than its duration would have stretches.
        count = int(np.clip(run.duration / MOMENT_S, FEWEST, min(MOST, len(table))))
        stretches = np.array_split(np.arange(len(table)), count)
        chosen = np.array([stretch[np.argmax(rough[stretch])] for stretch in stretches])
        ends = [(int(stretch[0]), int(stretch[-1])) for stretch in stretches]
        chosen = chosen[~_repeated(table / scale, chosen, ends)]
        return cls(joints, table[chosen], scale) if len(chosen) >= LEAST else None

    def found_in(self, run: SearchedRun) -> int:
        """How many of the moments a run holds; 0 where it has other joints."""
        if run.joints != self.joints:
            return 0
        distance, _ = run.tree(self.scale).query(
            self.moments / self.scale, p=np.inf, distance_upper_bound=NEAR
        )
        return int(np.isfinite(distance).sum())

    def is_in(self, run: SearchedRun) -> bool:
        """Whether a run holds so many of the moments that it is this one again, or a part of it."""
        share = len(self.moments) / (SHARE * len(self.joints))
        return self.found_in(run) >= max(LEAST, share)

    def to_dict(self) -> JsonRecord:
        """Its entry in a model's record.

        Returns:
            `joints` (the names), and `moments`: scale and moments as base64 of 32-bit numbers, for
            they are for no reader.
        """
        numbers = np.vstack([self.scale, self.moments]).astype("<f4")
        return {
            "joints": list(self.joints),
            "moments": base64.b64encode(numbers.tobytes()).decode("ascii"),
        }

    @classmethod
    def from_dict(cls, record: JsonTable) -> Self:
        """Reverse of `to_dict`.

        Raises:
            ValueError: It holds something else.
        """
        joints = tuple(str(name) for name in record["joints"])
        numbers = np.frombuffer(
            base64.b64decode(str(record["moments"]), validate=True), dtype="<f4"
        )
        table = numbers.reshape(-1, 2 * len(joints)).astype(float)
        if len(table) < 2 or not np.isfinite(table).all() or not (table[0] > 0.0).all():
            raise ValueError("moments of a run that are no moments")
        return cls(joints, table[1:], table[0])


class SearchedRun:
    """A run in which moments of others are looked for."""

    def __init__(self, run: Recording) -> None:
        self._run = run
        self.joints = tuple(sorted(run.joints))
        self._trees: dict[bytes, KDTree] = {}

    @cached_property
    def _rows(self) -> Float[Array, "T k"]:
        table = _table(self._run, self.joints)
        return np.asarray(table[_sound(table)])

    def tree(self, scale: Float[Array, " k"]) -> KDTree:
        """The run's moments divided by a scale, as a tree to be searched; kept for each scale."""
        from scipy.spatial import KDTree

        key = scale.tobytes()
        if key not in self._trees:
            self._trees[key] = KDTree(self._rows / scale, balanced_tree=False, compact_nodes=False)
        return self._trees[key]


def _table(run: Recording, joints: tuple[str, ...]) -> Float[Array, "T k"]:
    """Positions and efforts of some joints."""
    columns = [run.joints.index(name) for name in joints]
    return np.hstack([run.position[:, columns], run.effort[:, columns]])


def _sound(table: Float[Array, "T k"]) -> Array:
    """Which rows hold numbers of this world."""
    return np.asarray((np.abs(table) < BEYOND).all(axis=1))


def _repeated(table: Float[Array, "T k"], rows: Array, stretches: list[tuple[int, int]]) -> Array:
    """Whether each of some rows is met again outside of its own stretch; of a long run some rows
    are looked at.
    """
    from scipy.spatial import KDTree

    step = 1 + len(table) // MOST_SEARCHED
    tree = KDTree(table[::step], balanced_tree=False, compact_nodes=False)
    outside = []
    for near, (first, last) in zip(
        tree.query_ball_point(table[rows], NEAR, p=np.inf), stretches, strict=True
    ):
        outside.append(any(row * step < first or row * step > last for row in near))
    return np.array(outside)
