"""Laws of a share that falls with distance: as fast as rows left out say, and no reach beyond what they bear out."""

import numpy as np
import pytest

from ident.arrays import Array
from ident.model.nearness import (
    POSES,
    REACHES,
    LeftOut,
    Nearness,
    choose_share,
    fall,
    nearest_left_out,
    nearest_square,
    spread_poses,
)


def drawn_rows(seed: int) -> tuple[Array, Array, Array]:
    """What was said, what noise lies on what is left, and distances, of 2000 rows."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal(2000), 0.3 * rng.standard_normal(2000), rng.uniform(0.0, 3.0, 2000)


@pytest.mark.parametrize("reach", [0.25, 1.0])
def test_the_reach_that_rows_left_out_have_is_found(reach: float) -> None:
    """The benefit falls as it was made to fall, and starts from the share that it has at no distance."""
    said, noise, distance = drawn_rows(1)
    left = 0.8 * said * fall(distance**2, reach) + noise
    share, found = choose_share([LeftOut(said, distance**2)], left)
    assert 0.5 * reach <= found <= 2.0 * reach
    assert share == pytest.approx(0.8, abs=0.2)


def test_what_no_distance_tells_does_not_fall() -> None:
    """Rows that all lie where training was say nothing of elsewhere: the longest reach counts, the share is whole."""
    said, noise, _ = drawn_rows(2)
    share, reach = choose_share([LeftOut(said, np.zeros(2000))], said + noise)
    assert reach == max(REACHES)
    assert share == pytest.approx(1.0, abs=0.05)


def test_what_holds_at_every_distance_falls_little() -> None:
    """A benefit as large far off as near keeps most of its share at all distances that rows left out have."""
    said, noise, distance = drawn_rows(3)
    share, reach = choose_share([LeftOut(said, distance**2)], said + 0.1 * noise)
    assert share * fall(distance**2, reach).min() > 0.8


def test_what_foretells_the_contrary_has_no_share() -> None:
    said, noise, distance = drawn_rows(4)
    share, _ = choose_share([LeftOut(said, distance**2)], noise - said)
    assert share == 0.0


def test_nearest_poses_are_the_nearest_of_all() -> None:
    rng = np.random.default_rng(5)
    q, poses = rng.standard_normal((300, 6)), rng.standard_normal((40, 6))
    every = ((q[:, None] - poses) ** 2).sum(axis=2).min(axis=1)
    np.testing.assert_allclose(nearest_square(q, poses), every, atol=1e-12)
    assert len(spread_poses(100_000)) <= POSES
    assert len(spread_poses(100)) == 100


def test_a_row_left_out_is_as_far_as_what_was_not_left_out_with_it() -> None:
    """Its own fold's poses do not count; a single fold leaves none, which is endlessly far."""
    q = np.array([[0.0], [0.1], [2.0], [2.1]])
    folds = np.array([0, 0, 1, 1])
    np.testing.assert_allclose(nearest_left_out(q, folds), [4.0, 1.9**2, 1.9**2, 4.0], atol=1e-12)
    assert nearest_left_out(q, np.zeros(4, dtype=int)).min() > 1e9


def test_a_share_is_whole_where_training_was_and_half_at_the_reach() -> None:
    nearness = Nearness(np.zeros((1, 2)), np.array([0.5, np.inf]))
    at_pose, at_reach = nearness.fall(np.array([[0.0, 0.0], [0.3, 0.4]]))
    np.testing.assert_allclose(at_pose, 1.0)
    np.testing.assert_allclose(at_reach, [0.5, 1.0])


@pytest.mark.parametrize(
    ("poses", "reach"),
    [(np.zeros((0, 2)), [1.0, 1.0]), (np.full((1, 2), np.nan), [1.0, 1.0]), (np.zeros((1, 2)), [0.0, 1.0])],
)
def test_damaged_poses_are_refused(poses: Array, reach: list[float]) -> None:
    with pytest.raises(ValueError, match=r"poses|reach"):
        Nearness(poses, np.array(reach))
