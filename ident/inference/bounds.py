"""What candidates may add to a set of effects: at most at once, exactly once it counts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

from ident.arrays import Array, Bool, Float


@dataclass(frozen=True, eq=False)
class SumsAfter:
    """A candidate's sums after a set.

    Attributes:
        sums: Of its columns.
        target: Of these times the torque.
        deviation: Standard deviation of each coefficient beforehand.
        signed: Which of them can't be negative.
    """

    sums: Float[Array, "w w"]
    target: Float[Array, " w"]
    deviation: Float[Array, " w"]
    signed: Bool[Array, " w"]


@dataclass(frozen=True, eq=False)
class Bounds:
    """The most that candidates may add to a set, and what they add where that is less.

    Attributes:
        most: Of each [nats].
        bent: Numbers of those whose signed coefficients would be negative.
        exactly: What one of the bent candidates adds [nats], by its number.
    """

    most: Float[Array, " g"]
    bent: Collection[int]
    exactly: Callable[[int], float]

    def from_most(self) -> Iterator[int]:
        """Numbers of the candidates that add anything, that which adds most first.

        What a candidate adds exactly is worked out once no other may add more.
        """
        adding = [(k, most) for k, most in enumerate(self.most) if most > 0.0]
        waiting = [(-most, k, k in self.bent) for k, most in adding]
        heapify(waiting)
        while waiting:
            _, k, is_bound = heappop(waiting)
            if not is_bound:
                yield k
                continue
            gain = self.exactly(k)
            if gain > 0.0:
                heappush(waiting, (-gain, k, False))
