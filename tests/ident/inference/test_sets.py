"""Sets of effects: their evidence, coefficients and covariances, and the search among them."""

from dataclasses import replace

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.effects.optional import Linearised, stands_for
from ident.inference.components import ModelSums
from ident.inference.evidence import LOG_TWO, mass_left, solve_set
from ident.inference.infer import Inferred
from ident.inference.search import SetSearch
from ident.regression.design import Group


def coarse_of(analysis: Analysis) -> Inferred:
    return analysis.conclusion.inference.best


def free_groups(search: SetSearch, count: int, seed: int = 0) -> list[Group]:
    """Some candidates of different names, of whose coefficients no sign and no more than a deviation is known."""
    rng = np.random.default_rng(seed)
    free = [group for group in search.names.groups if not group.signed and group.prior is None]
    chosen: dict[object, Group] = {}
    for k in rng.permutation(len(free)):
        chosen.setdefault(free[k].key, free[k])
    return list(chosen.values())[:count]


def any_groups(search: SetSearch, count: int, seed: int) -> list[Group]:
    """Some candidates of different names."""
    rng = np.random.default_rng(seed)
    chosen: dict[object, Group] = {}
    for k in rng.permutation(len(search.names.groups)):
        chosen.setdefault(search.names.groups[k].key, search.names.groups[k])
    return list(chosen.values())[:count]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_set_is_worth_what_the_whole_model_says(sprung: Analysis, count: int) -> None:
    """Law: on the sums after the baseline a set has the evidence that it adds on the sums of all columns."""
    reached = coarse_of(sprung)
    chosen = free_groups(reached.search, count)
    added = reached.model.log_evidence(chosen) - reached.model.log_evidence(())
    assert reached.search.nats(chosen) == pytest.approx(added, rel=1e-6, abs=1e-4)


def test_integrating_a_discrepancy_out_is_solving_with_its_columns(sprung: Analysis) -> None:
    """Law: the log evidence is that of a model that has the discrepancy's columns with their variances as priors."""
    reached = coarse_of(sprung)
    joint, chosen = 1, free_groups(reached.search, 2)
    layout = reached.model.sums.evidence.layout
    blocks = layout.flexible[joint]
    off = reached.model.with_discrepancy({j: np.zeros(len(blocks)) for j in range(layout.n)})
    variances = np.full(len(blocks), 1e-2)
    on = off.with_discrepancy({joint: variances})
    smooth = layout.local[joint][layout.flexible_places[joint]]
    own = np.full(len(smooth), variances[0])
    inside, small = off.information(chosen, off.prior())
    columns = np.concatenate([inside, smooth])
    whole = np.zeros((layout.size + 1, layout.size + 1))
    for local, sums in zip(layout.local, off.whole, strict=True):
        whole[np.ix_(local, local)] += sums
    large = whole[np.ix_(columns, columns)].copy()
    large[: len(inside), : len(inside)] = small
    large[len(inside) :, len(inside) :] += np.diag(1.0 / own)

    def nats_of(information: np.ndarray, at: np.ndarray) -> float:
        target = whole[at, -1]
        along = float(target @ np.linalg.solve(information, target))
        return 0.5 * (along - float(np.linalg.slogdet(information)[1]))

    expected = nats_of(large, columns) - nats_of(small, inside) - 0.5 * float(np.log(own).sum())
    gained = on.log_evidence(chosen) - off.log_evidence(chosen)
    assert gained == pytest.approx(expected, rel=1e-4, abs=1e-2)


def test_variances_can_be_changed_at_one_joint_or_all_at_once(sprung: Analysis) -> None:
    """Law: sums that were changed joint by joint are those that are made anew."""
    model = coarse_of(sprung).model
    layout = model.sums.evidence.layout
    variances = np.full(len(layout.flexible[0]), 3e-3)
    step = model
    for joint in range(layout.n):
        step = step.with_discrepancy({joint: variances})
    anew = ModelSums(model.sums, model.names, model.baseline, step.components)
    size = np.abs(anew.gram).max()
    assert np.abs(step.gram - anew.gram).max() < 1e-9 * size
    assert step.nats == pytest.approx(anew.nats)


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_a_set_does_not_matter(sprung: Analysis, seed: int) -> None:
    search = coarse_of(sprung).search
    chosen = any_groups(search, 5, seed)
    back = chosen[::-1]
    assert search.nats(back) == pytest.approx(search.nats(chosen), rel=1e-9, abs=1e-6)
    first, last = search.coefficients(chosen), search.coefficients(back)
    for group in chosen:
        size = np.abs(first[group]).max()
        assert last[group] == pytest.approx(first[group], rel=1e-6, abs=1e-6 * size)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_gains_are_what_candidates_add(sprung: Analysis, count: int) -> None:
    """Law: what all candidates add at once is what each adds when it is put in; what is in adds nothing."""
    search = coarse_of(sprung).search
    chosen = free_groups(search, count, seed=4)
    gains, before = search.gains(chosen), search.nats(chosen)
    keys = {group.key for group in chosen}
    for k, group in enumerate(search.names.groups):
        if group.key in keys:
            assert gains[k] == -np.inf
        elif k % 7 == 0 and not group.signed:
            added = search.nats([*chosen, group]) - before
            assert gains[k] == pytest.approx(added, rel=1e-5, abs=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_a_search_never_ends_below_its_start(sprung: Analysis, seed: int) -> None:
    """Law: adding, swapping and dropping never lower the evidence, wherever the search begins."""
    search = coarse_of(sprung).search
    start = any_groups(search, seed + 1, seed)
    slimmer = search.without_idle(start)
    ended = search.run(start)
    assert search.nats(slimmer) >= search.nats(start)
    assert search.nats(ended) >= search.nats(slimmer) - 1e-6


def test_no_single_step_betters_what_a_search_ends_with(sprung: Analysis) -> None:
    """Law: nothing that may be added gains, and nothing that is dropped leaves more."""
    search = coarse_of(sprung).search
    ended = search.run()
    addition = search.best(ended)
    assert addition is None or addition[0] <= 1e-6
    for group in ended:
        others = [other for other in ended if other is not group]
        assert search.nats(others) < search.nats(ended)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_search_ends_with_stands_for_its_own_points(sprung: Analysis, seed: int) -> None:
    """Law: a name whose coefficients have left its point of the grid gives way to one that stands."""
    search = coarse_of(sprung).search
    linearised = [group for group in search.names.groups if isinstance(group.effect, Linearised)]
    order = np.random.default_rng(seed).permutation(len(linearised))
    start = {linearised[k].key: linearised[k] for k in order}
    ended = search.run(list(start.values())[:3])
    for group, estimate in search.coefficients(ended).items():
        if not stands_for(group.effect, group.variant, estimate):
            others = [other for other in ended if other is not group]
            assert search.best(others, joint=group.joint) is None


def test_a_spring_without_a_rest_gives_its_place_to_an_offset(sprung: Analysis) -> None:
    """Law: beside a constant torque a spring has no rest that a joint could reach, and is not what is told."""
    search = coarse_of(sprung).search
    for joint in range(3):
        offset = next(group for group in search.names.groups if group.key == ("torque_offset", joint, None))
        spring = next(group for group in search.names.groups if group.key == ("spring_torque", joint, None))
        column = int(offset.columns[0]) - search.names.first
        rest = search.rest.copy()
        rest[-1, :-1] = rest[:-1, -1] = 60.0 * rest[:-1, column] / np.sqrt(rest[column, column])
        rest[-1, -1] = 1.2 * 60.0**2
        constant = replace(search, rest=rest)
        assert constant.nats([spring]) > 10.0
        assert not stands_for(spring.effect, spring.variant, constant.coefficients([spring])[spring])
        (instead,) = constant.standing_for([spring])
        assert instead is not None
        assert instead.effect.id != "spring_torque"
        assert constant.nats([instead]) > 10.0
        left = constant.with_standing([offset, spring])
        assert offset in left


def test_a_search_from_a_wrong_name_ends_where_one_from_nothing_does(sprung: Analysis) -> None:
    """Law: what does not stand goes from the start, what stands is found without it."""
    search = coarse_of(sprung).search
    wrong = next(group for group in search.names.groups if group.effect.id == "stribeck_friction" and group.joint == 0)
    ends = [{group.key for group in search.run(start)} for start in ([], [wrong])]
    assert ends[0] == ends[1]
    assert ("spring_torque", 2, None) in ends[0]


def test_covariances_are_those_of_the_whole_model(sprung: Analysis) -> None:
    """Law: an effect's covariance is its block of the inverse of the information on all coefficients."""
    reached = coarse_of(sprung)
    chosen = free_groups(reached.search, 4, seed=2)
    inside, information = reached.model.information(chosen, reached.model.prior())
    inverse = np.linalg.inv(information)
    scale = reached.model.sums.evidence.scale
    for group in chosen:
        at = np.flatnonzero(np.isin(inside, group.columns))
        own = scale[group.columns]
        expected = inverse[np.ix_(at, at)] / np.outer(own, own)
        found = reached.search.covariance(chosen, group)
        assert found == pytest.approx(expected, rel=1e-4, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(8))
def test_coefficients_of_known_sign_are_never_negative(sprung: Analysis, seed: int) -> None:
    search = coarse_of(sprung).search
    signed = [group for group in search.names.groups if group.signed]
    assert signed
    rng = np.random.default_rng(seed)
    chosen: dict[object, Group] = {}
    for k in rng.permutation(len(signed)):
        chosen.setdefault(signed[k].key, signed[k])
    few = list(chosen.values())[:4]
    for group, beta in search.coefficients(few).items():
        bound = [k for k in group.signed if k < len(beta)]
        assert np.all(beta[bound] >= 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_bound_that_does_not_bind_is_worth_log_two(seed: int) -> None:
    """Law: half a normal is twice as dense; estimates that are positive anyhow stay as they are."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((40, 3))
    sums = columns.T @ columns
    target = columns.T @ (columns @ [2.0, 3.0, -4.0])
    deviation = np.full(3, 5.0)
    free, at = solve_set(sums, target, deviation, np.zeros(3, dtype=bool))
    bound, there = solve_set(sums, target, deviation, np.array([True, True, False]))
    assert bound == pytest.approx(free + 2.0 * np.log(2.0))
    assert there == pytest.approx(at)
    held, gone = solve_set(sums, target, deviation, np.array([False, False, True]))
    assert held < free
    assert gone[2] == pytest.approx(0.0, abs=1e-9)
    fewer, rest = solve_set(sums[:2, :2], target[:2], deviation[:2], np.zeros(2, dtype=bool))
    assert gone[:2] == pytest.approx(rest)
    assert held <= fewer + np.log(2.0) + 1e-9


@pytest.mark.parametrize("gain", [0.5, 5.0, 500.0])
@pytest.mark.parametrize("mass", [-0.3, 0.1, 2.0])
def test_over_a_mass_that_is_hardly_known_is_integrated(mass: float, gain: float) -> None:
    """Law: the evidence of a body is the integral over all masses above zero and all moments, found mass zero or not.

    Against a sum over a fine grid of the mass's logarithm, the moment integrated out by hand.
    """
    rng = np.random.default_rng(7)
    root = rng.standard_normal((2, 2))
    sums = gain * root @ root.T
    deviation = np.array([2.0, 1.0])
    target = sums @ [mass, 0.2] + 0.3 * np.sqrt(np.diag(sums)) * rng.standard_normal(2)
    signed = np.array([True, False])

    def log_prior(masses: np.ndarray) -> np.ndarray:
        """Even in the logarithm from 0.01 to 5, with a deviation of a factor of two beyond."""
        off = np.log2(masses / np.clip(masses, 0.01, 5.0))
        area = np.log(500.0) + np.sqrt(2.0 * np.pi) * np.log(2.0)
        return np.asarray(-np.log(masses * area) - 0.5 * off**2)

    def log_normal(masses: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * (masses / 2.0) ** 2 - np.log(2.0 * np.sqrt(2.0 * np.pi)))

    nats, found = solve_set(sums, target, deviation, signed)
    left = mass_left(sums, target, deviation, signed, found, 0)
    mean = left.log_mean(lambda above: log_prior(found[0] + above) - log_normal(found[0] + above))
    logs = np.linspace(np.log(1e-6), np.log(60.0), 4000)
    masses = np.exp(logs)
    precision = sums[1, 1] + 1.0
    by_moment = 0.5 * (target[1] - sums[0, 1] * masses) ** 2 / precision - 0.5 * np.log(precision)
    terms = target[0] * masses - 0.5 * sums[0, 0] * masses**2 + by_moment + log_prior(masses) + logs
    exact = np.log(np.trapezoid(np.exp(terms - terms.max()), logs)) + terms.max()
    assert nats + mean - LOG_TWO == pytest.approx(exact, abs=0.02)


def test_a_candidate_below_its_bound_has_a_finite_gain(sprung: Analysis) -> None:
    """Law: whatever torque is left, and so whatever sign a body's mass would have, no gain is undefined."""
    search = coarse_of(sprung).search
    body = next(group for group in search.names.groups if group.prior is not None)
    mass = int(body.columns[0]) - search.names.first
    less = search.rest[:-1, mass] / np.sqrt(search.rest[mass, mass])
    for deviations in np.linspace(0.5, 8.0, 16):
        rest = search.rest.copy()
        rest[-1, :-1] = rest[:-1, -1] = -deviations * less
        gains = replace(search, rest=rest).gains(())
        assert not np.isnan(gains).any()


def test_beforehand_candidates_are_one_name_together(sprung: Analysis) -> None:
    """Law: the prior odds of all effects, joints and points add up to one at most, and each effect has as much."""
    names = coarse_of(sprung).model.names
    whole: dict[str, float] = {}
    for group in names.groups:
        share = float(np.exp(names.log_odds[group])) * group.effect.screens
        whole[group.effect.id] = whole.get(group.effect.id, 0.0) + share
    assert sum(whole.values()) == pytest.approx(1.0)
    assert max(whole.values()) == pytest.approx(min(whole.values()))
    assert all(np.all(names.deviation[group] >= 0.0) for group in names.groups)


def test_the_likeliest_of_what_was_reached_comes_first(sprung: Analysis) -> None:
    reached = sprung.conclusion.inference.reached
    evidence = [end.log_evidence for end in reached]
    assert evidence == sorted(evidence, reverse=True)
    for end in reached:
        again = end.model.log_evidence(()) + end.search.nats(end.chosen)
        assert end.log_evidence == pytest.approx(again)
