"""What learns from one joint's residual: trees on all inputs, neighbours of an angle.

Trees see what changes slowly over their inputs. What goes up and down a hundred times a turn (teeth, a motor's poles)
they do not: that repeats wherever the joint passes again, so that neighbours of an angle foretell it.

Lines over the torque and the direction of the last instants see play, too, and a late load; but on arms with fine
encoders also how bristles turn round, which is nothing to be told: they are not asked.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from ident.arrays import Array, Float
from ident.diagnosis.gap.settings import TreeSettings

Learner = Callable[[Float[Array, "t f"], Float[Array, " t"], Float[Array, "s f"]], Float[Array, " s"]]
"""Learns y from x and foretells it at other x."""


def trees(settings: TreeSettings) -> Learner:
    """Boosted trees."""
    # Slow to load, and where nothing stands out of the noise there is nothing to learn.
    from sklearn.ensemble import HistGradientBoostingRegressor
    from threadpoolctl import threadpool_limits

    def learn(x: Array, y: Array, other: Array) -> Array:
        grown = HistGradientBoostingRegressor(
            max_iter=settings.rounds,
            max_leaf_nodes=settings.leaves,
            learning_rate=settings.rate,
            min_samples_leaf=settings.leaf_samples,
            l2_regularization=settings.penalty,
            random_state=0,
        )
        # So few samples are no work for several threads: they would wait for each other, and for busy cores.
        with threadpool_limits(limits=1, user_api="openmp"):
            return np.asarray(grown.fit(x, y).predict(other))

    return learn


def neighbours(settings: TreeSettings) -> Learner:
    """Mean of the nearest samples, trusted as far as one half of the samples foretells the other."""

    def learn(x: Array, y: Array, other: Array) -> Array:
        half = np.arange(len(y)) * settings.folds // max(len(y), 1) % 2 == 0

        def nearest(one: Array, there: Array) -> Array:
            return np.asarray(y[one][KDTree(x[one]).query(there, settings.neighbours)[1]].mean(axis=1))

        foretold = np.concatenate([nearest(half, x[~half]), nearest(~half, x[half])])
        true = np.concatenate([y[~half], y[half]])
        trust = np.clip(foretold @ true / max(float(foretold @ foretold), 1e-300), 0.0, 1.0)
        return np.asarray(trust * nearest(np.ones(len(y), dtype=bool), other))

    return learn
