"""How a session's time is cut: blocks for tests, folds for held-out scores, stretches of one level
of friction.

Where many runs share a block, encoder noise is drawn once more for some of them only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int
from ident.effects.base import SessionContext
from ident.motion.motion import Motion
from ident.motion.stretches import CHOICE_SEED
from ident.recordings.blocks import block_length
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings


@dataclass(frozen=True, eq=False)
class Partition:
    """How time is cut: blocks for tests, folds for held-out scores.

    Where many runs share a block, encoder noise is drawn once more for some of them (`draws`): how
    many times the squares of a run's noise count, 0 where none is drawn; once for every run if
    None.
    """

    # for each run, first sample (decimated) of each of its blocks
    starts: tuple[Int[Array, " k"], ...]
    first_block: Int[Array, " R"]
    folds: Int[Array, " B"]
    # stretch of some seconds, over which friction keeps its level, that a block lies in
    stretches: Int[Array, " B"]
    draws: Float[Array, " R"] | None = None

    @classmethod
    def cut(
        cls,
        lengths: Int[Array, " R"],
        seconds: Float[Array, " R"],
        block_s: Float[Array, " R"] | float,
        deal: Callable[[Int[Array, " B"]], Int[Array, " B"]],
        settings: RegressionSettings,
    ) -> Partition:
        """Cuts each run into blocks, and into stretches over which friction keeps its level.

        Friction drifts within a long run as it does from run to run: each stretch of it has a level
        of its own.

        Args:
            lengths: Filtered samples of each run.
            seconds: Duration of each run [s].
            block_s: Duration of a block, or of each run's own [s].
            deal: Gives each block its fold, by the number of its run.
            settings: How long a stretch is.
        """
        blocks = np.maximum(1, np.round(seconds / block_s)).astype(int)
        stretches = np.maximum(1, np.round(seconds / settings.stretch_s)).astype(int)
        starts = []
        for length, count in zip(lengths, blocks, strict=True):
            edges = np.linspace(0, length, count, endpoint=False)
            starts.append(edges.astype(int))
        run = np.repeat(np.arange(len(blocks)), blocks)
        first_block = np.cumsum(blocks) - blocks
        first_stretch = np.cumsum(stretches) - stretches
        within = np.arange(len(run)) - first_block[run]
        stretch = first_stretch[run] + within * stretches[run] // blocks[run]
        return cls(tuple(starts), first_block, deal(run), stretch)

    @property
    def run_of_block(self) -> Int[Array, " B"]:
        """Run of each block, where runs share none."""
        return np.repeat(np.arange(len(self.starts)), [len(starts) for starts in self.starts])

    def blocks_of(self, run: int, count: int) -> Int[Array, " t"]:
        """Index of the block of each of a run's filtered samples.

        Args:
            run: Index of the run.
            count: Number of its filtered samples.
        """
        begun = np.searchsorted(self.starts[run], np.arange(count), side="right")
        return self.first_block[run] + begun - 1


def build_partition(
    session: SessionContext, settings: RegressionSettings = USUAL_REGRESSION
) -> Partition:
    """Cuts runs into blocks of equal length; whole recorded runs make a fold, parts of a run where
    runs are few.

    Very many runs share blocks, neighbours with neighbours, so that the sums stay few. Where a
    joint moves in one run more than in all others together, runs are as good as few: without that
    run the joint's model is a guess.
    """
    return partition_motions([run.motion for run in session.runs], settings)


def partition_motions(
    motions: Sequence[Motion], settings: RegressionSettings = USUAL_REGRESSION
) -> Partition:
    """Cuts motions, as `build_partition` cuts the runs of a session.

    Args:
        motions: All runs, in their order.
        settings: Lengths and numbers of blocks and folds.
    """
    lengths = np.array([motion.filtered_length for motion in motions])
    steps = np.array([motion.interval * motion.lowpass.factor for motion in motions])
    continues = np.array([motion.continues for motion in motions])
    travels = [motion.interval * np.abs(motion.dq).sum(axis=0) for motion in motions]
    travel = np.array(travels)
    recorded = np.cumsum(~continues) - 1
    few = _few(travel, recorded, settings.fewest_runs)
    folds = settings.folds
    if len(lengths) > settings.most_lone_runs:
        block, run_of_block = _share_blocks(recorded, settings)
        rng = np.random.default_rng(CHOICE_SEED)
        return Partition(
            starts=(np.zeros(1, dtype=int),) * len(lengths),
            first_block=block,
            folds=_deal_folds(run_of_block, folds, few),
            stretches=np.arange(len(run_of_block)),
            draws=choose_draws(block, lengths, settings.block_draws, rng),
        )
    seconds = lengths * steps
    total = float(seconds.sum())
    target = block_length(total, settings.shortest_block_s, settings.most_blocks)

    def deal(run_of_block: Int[Array, " B"]) -> Int[Array, " B"]:
        """Fold of each block, by the run that it lies in."""
        return _deal_folds(recorded[run_of_block], folds, few)

    return Partition.cut(lengths, seconds, target, deal, settings)


def choose_draws(
    block: Int[Array, " R"], lengths: Int[Array, " R"], most: int, rng: np.random.Generator
) -> Float[Array, " R"]:
    """Of which runs of each block encoder noise is drawn once more, and how often its squares
    count.

    Any run of a block is as likely chosen as any other, until the chosen ones have enough samples;
    they stand for all samples of their block.

    Args:
        block: Block of each run.
        lengths: Samples of each run.
        most: Samples of a block from which on no further run is chosen.
        rng: Of the choice.

    Returns:
        Weight of each run's draw, 0 where none is needed.
    """
    weights = np.zeros(len(block))
    for number in np.unique(block):
        members = np.flatnonzero(block == number)
        shuffled = rng.permutation(members)
        before = np.cumsum(lengths[shuffled]) - lengths[shuffled]
        chosen = shuffled[before < most]
        weights[chosen] = lengths[members].sum() / lengths[chosen].sum()
    return weights


def _few(travel: Float[Array, "R n"], recorded: Int[Array, " R"], fewest: int) -> bool:
    """Whether runs are too few to be left out whole, for some joint.

    Args:
        travel: How far each joint goes in each run, or piece of one [rad or m].
        recorded: Number of the recorded run that each run is, or is a piece of.
        fewest: Runs that are enough where all show every joint.
    """
    of_run = np.zeros((int(recorded[-1]) + 1, travel.shape[1]))
    np.add.at(of_run, recorded, travel)
    alone = of_run.max(axis=0) > of_run.sum(axis=0) - of_run.max(axis=0)
    return bool(len(of_run) < fewest or alone.any())


def _share_blocks(
    recorded: Int[Array, " R"], settings: RegressionSettings
) -> tuple[Int[Array, " R"], Int[Array, " B"]]:
    """One block for several runs; no block holds pieces of two recorded runs unless it holds whole
    ones.

    Args:
        recorded: Number of the recorded run that each run is, or is a piece of.
        settings: How many blocks, and how many runs have their own.

    Returns:
        Block of each run; the recorded run of each block, blocks of several recorded runs counted
        as one.
    """
    pieces = np.bincount(recorded)
    most = settings.most_blocks
    if len(pieces) > settings.most_lone_runs:
        return recorded * most // len(pieces), np.arange(most)
    counts = np.maximum(1, np.round(pieces * most / len(recorded)).astype(int))
    within = np.arange(len(recorded)) - (np.cumsum(pieces) - pieces)[recorded]
    first = (np.cumsum(counts) - counts)[recorded]
    block = first + within * counts[recorded] // pieces[recorded]
    return block, np.repeat(np.arange(len(pieces)), counts)


def _deal_folds(run_of_block: Int[Array, " B"], folds: int, few: bool) -> Int[Array, " B"]:
    """Fold of each block: that of its recorded run, or, where runs are few, each in turn."""
    runs = int(run_of_block[-1]) + 1
    total = len(run_of_block)
    if few:
        # Few runs rarely show every joint alike: each fold has pieces from everywhere, or it would
        # be judged by a model that never saw such motion.
        return np.arange(total) % min(folds, total)
    # Runs in order, dealt out so that folds are of about equal length and neighbours in kind are
    # apart.
    return np.asarray(run_of_block % min(folds, runs))
