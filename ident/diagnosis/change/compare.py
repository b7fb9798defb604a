"""What changed between two sets of recordings of one arm: from motions to changes with evidence.

Both sets share one baseline: the arm's inertias, tuned and hardly held by the URDF, its losses, and every law that is
asked for, in all runs alike. What is wrong with the model before is wrong with it after and cancels. What changed are
the same laws in the later set alone, selected as a diagnosis selects effects; and each must stand out
against what the runs of one set differ by among themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.diagnosis.change.between_run_variance import Standing, measure_standing, measure_usual_variance
from ident.diagnosis.change.candidates import OF_FRICTION
from ident.diagnosis.change.confounded_links import open_places, place_bodies
from ident.diagnosis.change.friction_drift import GAIN, day_to_day, may_be_gain
from ident.diagnosis.change.gain_uncertainty import BODIES, STATED, GainUncertainty, solve_body
from ident.diagnosis.change.laws import UNLISTED
from ident.diagnosis.change.paired_design import LOOSE_SHARE, PairedDesign, build_design
from ident.diagnosis.change.refine import Refinement, refine_bodies
from ident.diagnosis.change.result import ArmChange, ArmComparison, Side
from ident.diagnosis.change.search import IN_ITS_PLACE, LEAST_ODDS, ChangeSearch, count_changes, log_odds, stand_ins
from ident.diagnosis.change.static_joints import SamplesUsed, count_samples, find_static_joints
from ident.diagnosis.heldout_gain import measure_shrink, slides
from ident.diagnosis.regression.cross_validation import HeldOut, HeldOutScore
from ident.diagnosis.regression.design import Group, NotTestable
from ident.diagnosis.regression.least_squares import project
from ident.diagnosis.reservations import Reservation, find_implausible, joints_of
from ident.diagnosis.selection.gates import Named, SearchResults
from ident.diagnosis.selection.intervals import Estimate, estimate_effects, solve_effects
from ident.diagnosis.selection.refine import Refined
from ident.diagnosis.selection.settings import SelectionSettings
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.effects.base import Interval
from ident.motion.motion import Motion
from ident.progress import stage
from ident.robot.arm import ArmModel

# The URDF's error where it is right within its tolerance: what is seen with such a one alone is told so.
RIGHT_SHARE = 0.04
# A change of which the baseline leaves a smaller share can't be told from what both sets have in common.
LEAST_SEEN = 0.02
ANOTHER_RUN = "runs of one set differ by as much among themselves"
TOO_UNSURE = "these runs are too few, or move too alike, to tell its size from zero"
ANOTHER_DAY = "friction differs by as much from day to day; sessions of several days on both sides would tell"
TOO_FEW = "both sets together have fewer samples in the encoders' band than the model has figures"
# Changes that are tried in a row without one that stands.
MOST_FAILED = 8


@dataclass(frozen=True, eq=False)
class _LaterOnly(HeldOut):
    """Held-out scores whose sizes are those of the later set."""

    later: Bool[Array, " F"] | None = None

    def score(self, groups: Sequence[Group] = ()) -> HeldOutScore:
        whole = super().score(groups)
        if self.later is None:
            return whole
        kept = self.later[:, None]
        return replace(whole, squares=whole.squares * kept, weights=whole.weights * kept)


@dataclass(frozen=True, eq=False)
class _Changes:
    """Changes that stand, with all that goes with them."""

    found: SearchResults
    estimates: tuple[Estimate, ...]
    standings: tuple[Standing, ...]
    doubted: tuple[Reservation, ...]
    places: tuple[tuple[Group, ...], ...] = ()  # of each, where it may sit as well
    unlawful: bool = False  # something stood out whose figures no arm has

    @property
    def left(self) -> HeldOutScore:
        """What all changes together leave."""
        return self.found.ladder[-1]


def compare(
    before: Sequence[Motion],
    after: Sequence[Motion],
    arm: ArmModel,
    sides: tuple[Side, Side],
    seed: int = 0,
    settings: DiagnosisSettings = USUAL,
    doubt: GainUncertainty = STATED,
) -> ArmComparison:
    """Compares two sets of runs.

    Args:
        before, after: Motions of both sets, of the same joints and filtered alike.
        arm: The user's arm, without payload.
        sides: What the sets are, for the record.
        seed: Of the sign flips.
        settings: The numbers by which it decides.
        doubt: How well the gains are known by which torques are read: a body is no better known.
    """
    stage("torques of every law", 0.1, 0.5)
    still, used = find_static_joints(before, after), count_samples([*before, *after])
    one_clock = len(sides[1].sessions) <= 1
    first = replace(build_design(before, after, arm, still=still, one_clock=one_clock), doubt=doubt)
    if first.sums.evidence.samples.sum() <= first.sums.evidence.layout.tuned:
        few = [NotTestable(group.effect, group.joint, TOO_FEW) for group in first.sums.evidence.layout.groups]
        hidden = {one.effect.id + str(one.joint): one for one in (*first.silent, *few)}
        silent = tuple(hidden.values())
        return ArmComparison(
            arm.name, arm.joint_names, "not_testable", sides, not_testable=silent, still=still, used=used
        )
    selection = settings.selection
    sessions = (max(1, len(sides[0].sessions)), max(1, len(sides[1].sessions)))
    stage("searching what changed", 0.5, 0.8)
    told = _tell(first, seed, selection, sessions)
    if any(one.group.effect.id in BODIES for one in told.estimates):
        first = _with_places(first, told, before, after, arm)
        told = _tell(first, seed, selection, sessions)
    stage("where a body is", 0.8, 1.0)
    second = refine_bodies(first, told.estimates, before, after, arm)
    if second is not None:
        told = _refined(second, told, selection, sessions)
    return replace(_result(told, first, arm, sides, _hidden(first, used)), used=used)


def _with_places(
    design: PairedDesign, told: _Changes, before: Sequence[Motion], after: Sequence[Motion], arm: ArmModel
) -> PairedDesign:
    """The same design with every body about the place where it would be."""
    others = [one.group for one in told.estimates if one.group.effect.id not in BODIES]
    asked = place_bodies(_search(design, 0, USUAL.selection), others, design.session, design.asked)
    return replace(
        build_design(before, after, arm, known=design.known, asked=asked, still=design.still), doubt=design.doubt
    )


def _search(design: PairedDesign, seed: int, settings: SelectionSettings) -> ChangeSearch:
    """The search over a design; one run a side shows no law of friction."""
    evidence = design.sums.evidence
    alone = design.sides.counts == (1, 1)
    barred = {group.key for group in evidence.layout.groups if alone and group.effect.id in OF_FRICTION}
    held_out = _LaterOnly(evidence, design.prior, design.sides.later_folds)
    return ChangeSearch(evidence, design.prior, held_out, seed, frozenset(barred), settings=settings)


def _tell(design: PairedDesign, seed: int, settings: SelectionSettings, sessions: tuple[int, int]) -> _Changes:
    """Names one change after the other, the likeliest first, each only if it stands beside those before it.

    What does not stand is set aside before the next is tried: beside it, few runs would leave nothing certain.
    """
    joints = design.baseline.nominal.joint_names
    search = _search(design, seed, settings)
    doubted: tuple[Reservation, ...] = ()
    differing: list[Group] = []
    unlawful = False
    kept: tuple[Named, ...] = ()
    stands = _Standing(search, SearchResults((), (search.held_out.score(),), None), (), (), Refined(search, ()))
    failed = 0
    while failed < MOST_FAILED:
        one_more = replace(search, settings=replace(settings, most_effects=len(kept) + 1))
        found = one_more.run(kept)
        if not found.named:
            stands = replace(stands, found=replace(found, ladder=stands.found.ladder))
            break
        fine = Refined(search, tuple(item.group for item in found.named))
        standings = _standings(design, fine, [np.zeros(len(group.columns)) for group in fine.groups], sessions)
        raw = estimate_effects(search, fine, design.session, found.named)
        read = [_as_read(one, fine, design, np.zeros(len(one.coefficients))) for one in raw]
        estimates = [_widened(*three) for three in zip(read, raw, standings, strict=True)]
        refused = find_implausible(dict(enumerate(zip(found.named, estimates, strict=True))), design.session)
        sure = [log_odds(search, *pair) for pair in zip(fine.groups, standings, strict=True)]
        for k, standing in enumerate(standings):
            if sure[k] <= 0.0:
                of_the_runs = ANOTHER_RUN if standing.of_the_runs else TOO_UNSURE
                refused[k] = ANOTHER_DAY if standing.of_the_day else of_the_runs
        if len(found.named) > len(kept):
            # What was set aside before a name explained more than it does; what came after it did not.
            last = len(found.named) - 1
            refused = {k: why for k, why in (stand_ins(search, found, differing) | refused).items() if k == last}
        if not refused:
            stands = _Standing(search, found, tuple(estimates), tuple(standings), fine)
            if len(found.named) <= len(kept):
                break
            kept, failed = found.named, 0
            continue
        for k in refused:
            if sure[k] <= 0.0:
                if standings[k].of_the_runs and found.named[k].group.effect.id != UNLISTED:
                    differing.append(found.named[k].group)
            elif refused[k] != IN_ITS_PLACE and estimates[k].undefined is None:
                unlawful = True
        doubted += tuple(Reservation.of(found.named[k], estimates[k], joints, why) for k, why in refused.items())
        search = replace(search, barred=search.barred | {fine.groups[k].key for k in refused})
        kept = tuple(item for k, item in enumerate(found.named) if k not in refused)
        failed += 1
    return replace(_with_rivals(stands, design), doubted=doubted, unlawful=unlawful)


@dataclass(frozen=True, eq=False)
class _Standing:
    """Changes all of which stand, and the search that gave them."""

    search: ChangeSearch
    found: SearchResults
    estimates: tuple[Estimate, ...]
    standings: tuple[Standing, ...]
    fine: Refined


def _with_rivals(those: _Standing, design: PairedDesign) -> _Changes:
    """Changes that stand, each with how likely it is, and with what else it may be and where."""
    search, named = those.search, [item.group for item in those.found.named]
    places = tuple(open_places(search, named, slot) for slot in range(len(named)))
    told = []
    for slot, one in enumerate(_with_gain(those.estimates, those.fine, design) if named else ()):
        spare = log_odds(search, those.fine.groups[slot], those.standings[slot])
        chance = 1.0 / (1.0 + np.exp(-spare) / LEAST_ODDS)
        rivals = dict.fromkeys((*one.rivals, *(group.effect.id for group in places[slot])))
        told.append(replace(one, probability=one.probability * float(chance), rivals=tuple(rivals)))
    return _Changes(those.found, tuple(told), those.standings, (), places)


def _refined(second: Refinement, told: _Changes, settings: SelectionSettings, sessions: tuple[int, int]) -> _Changes:
    """The same changes with the parameters of a refined design, which sees what the first left of them."""
    design = second.design
    search = _search(design, 0, settings)
    fine = Refined(search, second.groups)
    solved, _ = solve_effects(fine, [False] * len(fine.groups))
    standings = _standings(design, fine, second.added, sessions)
    estimates = []
    for old, group, added, (beta, cells), standing in zip(
        told.estimates, second.groups, second.added, solved, standings, strict=True
    ):
        asked = group.effect.asked(design.session)
        figures = dict(group.effect.parameters(asked, group.joint, group.variant, beta + added, cells))
        raw = replace(old, group=group, told=group, parameters=old.parameters | figures, coefficients=beta)
        estimates.append(_widened(_as_read(raw, fine, design, added), raw, standing))
    score = search.held_out.score(second.groups)
    ladder = (*told.found.ladder[:-1], score)
    return replace(told, found=replace(told.found, ladder=ladder), estimates=tuple(estimates))


def _standings(
    design: PairedDesign, fine: Refined, added: Sequence[Float[Array, " k"]], sessions: tuple[int, int]
) -> list[Standing]:
    """How each named change, with what of it is carried already, stands against the runs."""
    evidence, search = design.sums.evidence, fine.search
    model = project(evidence.gram(), evidence, search.prior, fine.groups)
    solved, _ = solve_effects(fine, [False] * len(fine.groups))
    asked = count_changes(search)
    found = []
    for group, more, (beta, cells) in zip(fine.groups, added, solved, strict=True):
        scale = evidence.scale[group.columns]
        scaled, covariance = (beta + more) * scale, cells * np.outer(scale, scale)
        day = day_to_day(group, design.session, beta + more, evidence.spread[design.judged], sessions)
        sides = design.sums, design.sides
        acts = [j for j in group.acts_on(evidence.layout.n) if j in design.judged]
        usual = measure_usual_variance(*sides, model, acts)
        found.append(measure_standing(*sides, model, group, scaled, covariance, asked, usual, day))
    return found


def _with_gain(estimates: Sequence[Estimate], fine: Refined, design: PairedDesign) -> list[Estimate]:
    """The estimates; where another gain does what a change of friction does, it is told as its rival."""
    solved, _ = solve_effects(fine, [False] * len(fine.groups))
    found = []
    for one, (beta, cells) in zip(estimates, solved, strict=True):
        open_between = GAIN not in one.rivals and may_be_gain(one.told, design.session, beta, cells)
        found.append(replace(one, rivals=(*one.rivals, GAIN)) if open_between else one)
    return found


def _as_read(estimate: Estimate, fine: Refined, design: PairedDesign, added: Float[Array, " k"]) -> Estimate:
    """A body's figures where every joint's gain may be off by some per cent; other estimates as they are."""
    group = estimate.told
    if group.effect.id not in BODIES:
        return estimate
    evidence = fine.search.evidence
    model = project(evidence.gram(), evidence, fine.search.prior, fine.groups)
    scale = evidence.scale[group.columns]
    whole = (estimate.coefficients + added) * scale
    scaled, covariance = solve_body(evidence, model, group, whole, design.doubt)
    beta, cells = scaled / scale, covariance / np.outer(scale, scale)
    asked = group.effect.asked(design.session)
    figures = group.effect.parameters(asked, group.joint, group.variant, beta, cells)
    return replace(estimate, parameters=dict(figures), coefficients=beta)


def _widened(estimate: Estimate, raw: Estimate, standing: Standing) -> Estimate:
    """An estimate whose intervals count what runs differ by.

    Args:
        estimate: As told: with what gains are off by.
        raw: The same with the noise alone, which is what runs add to.
        standing: By how much.
    """
    wide = {}
    for name, one in estimate.parameters.items():
        noise, more = raw.parameters[name], np.sqrt(standing.widening**2 - 1.0)
        low = float(np.hypot(one.value - one.low, more * (noise.value - noise.low)))
        high = float(np.hypot(one.high - one.value, more * (noise.high - noise.value)))
        wide[name] = Interval(one.value, one.value - low, one.value + high)
    return replace(estimate, parameters=wide)


def _hidden(design: PairedDesign, used: Sequence[SamplesUsed]) -> list[NotTestable]:
    """Changes that these two sets can't show, and why."""
    evidence, found, gram = design.sums.evidence, list(design.silent), design.sums.evidence.gram()
    loose = project(gram, evidence, design.prior)
    right = project(gram, evidence, design.prior.tightened(LOOSE_SHARE / RIGHT_SHARE))
    first = {group.key: group for group in reversed(evidence.layout.groups)}
    for group in reversed(first.values()):
        seen = [float(one.visibility(group.columns).max()) for one in (loose, right)]
        if design.sides.counts == (1, 1) and group.effect.id in OF_FRICTION:
            reason = "one run a side: how much friction differs from run to run is not known"
        elif seen[0] >= LEAST_SEEN:
            continue
        elif seen[1] >= 2.0 * LEAST_SEEN:
            reason = "the two sets move too differently for a URDF that may be wrong; one that is right would tell"
        elif group.effect.rows == "own" and used[group.joint].in_motion < 0.5:
            share = 100.0 * used[group.joint].in_motion
            reason = f"in {share:.0f} % of its samples the joint moves far from stops and turns; the rest can't show it"
        else:
            reason = "the two sets have too little motion in common to show it"
        found.append(NotTestable(group.effect, group.joint, reason))
    return found


def _result(
    told: _Changes, design: PairedDesign, arm: ArmModel, sides: tuple[Side, Side], hidden: Sequence[NotTestable]
) -> ArmComparison:
    joints, floor = arm.joint_names, design.sums.evidence.floor
    found = []
    each = zip(told.found.named, told.estimates, told.standings, told.places, strict=True)
    for item, estimate, standing, places in each:
        acts = item.shown
        old, new = item.before.rms[acts], item.after.rms[acts]
        names = [joints[j] for j in acts]
        found.append(
            ArmChange(
                estimate=estimate,
                joints=joints_of(item, joints),
                rms_before=dict(zip(names, map(float, old), strict=True)),
                rms_after=dict(zip(names, map(float, new), strict=True)),
                shrink=measure_shrink(old, new, floor[acts]),
                slides=slides(item.group, arm),
                p_value=max(standing.p_value, item.gates.p_value),
                log_score=item.gates.log_score,
                evidence=item.gates.evidence,
                run_spread=standing.spread,
                elsewhere=tuple(
                    (one.effect.id, joints[one.joint] if one.effect.scope == "joint" else "") for one in places
                ),
            )
        )
    found.sort(key=lambda change: -change.closed)
    judged = design.judged

    def by_joint(values: Float[Array, " n"]) -> dict[str, float]:
        return {joints[j]: float(values[j]) for j in judged}

    return ArmComparison(
        robot=arm.name,
        joints=joints,
        verdict=_verdict(found, told.unlawful, design.sides.too_short),
        sides=sides,
        changes=tuple(found),
        rms_before=by_joint(told.found.ladder[0].rms),
        rms_after=by_joint(told.left.rms),
        noise=by_joint(floor),
        run_spread=by_joint(design.sums.evidence.spread),
        not_testable=tuple(hidden),
        reservations=told.doubted,
        still=design.still,
    )


def _verdict(found: Sequence[ArmChange], unlawful: bool, too_short: bool) -> str:
    if any(change.effect != UNLISTED for change in found):
        return "changed"
    return "changed_unexplained" if found or unlawful else "not_testable" if too_short else "no_change"
