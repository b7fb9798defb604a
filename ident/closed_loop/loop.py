"""The loop: record, check the last model on what it never saw, diagnose all that was recorded, and
again.

The motions are those of `ident.trajectories`, chosen by what each effect says of the motion that
shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

from ident.arrays import Array, Float
from ident.checks.inspection import inspect_sessions
from ident.closed_loop.recorder import Recorder
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import family_for
from ident.effects.hysteresis_thermal import warm_up
from ident.errors import InputError
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.loaded import LawModel, SimulatorModel, log_error
from ident.motion.motion import Motion, prepare
from ident.recordings.recording import Session
from ident.records import JsonRecord, JsonTable, Record
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import KINDS, plan_motions
from ident.trajectories.reference import TICK_S, ReferenceMotion

# Which of the planned kinds stands for a family of motions (see `ident.effects.effect_info`).
KIND_OF = {
    "ladder": "ladder",
    "slow": "ladder",
    "reversals": "sweep",
    "chirp": "chirp",
    "holds": "hold",
    **dict.fromkeys(("poses", "vias", "random", "free"), "spline"),
    **dict.fromkeys(("wide", "more", "repeat", "loaded"), "fourier"),
    "jointwise": "jointwise",
}
# One path there and back at two speeds belongs to every round: a check that only sees what was
# chosen flatters.
ALWAYS = 4
# Rough duration of a run [s].
RUN_S = 8.0
MOST_ROUNDS = 8
# A gap that looks closed and is not sure to be is looked at in so many rounds before all of them
# teach again.
PATIENCE = 2
# The loop has stalled where so many models in turn came no nearer than this share of the best
# before them: what is left then is unexplained, and more motion of these kinds won't give it one.
STALLED_MODELS = 2
PROGRESS = 0.97
# A gap within so much of the noise counts as closed.
MARGIN = 1.10
# One-sided chance that a gap reported as closed is not.
DOUBT = 0.05
CONSTANT = "time_constant_s"
# A joint of which nobody knows how warm it is.
HALF_WARM = 0.5
# Heat of less than this is none [J].
LEAST_HEAT = 1e-12


def choose_motions(
    arm: ArmModel, rng: np.random.Generator, record: JsonTable | None
) -> tuple[ReferenceMotion, ...]:
    """Motions of a round: one run of each kind at first; then kinds that the last diagnosis leaves
    open, and a path.

    Args:
        arm: The arm.
        rng: For what is left to chance.
        record: The last diagnosis; None at first.
    """
    if record is None:
        return plan_motions(arm, (*tuple(KINDS)[1:], "spline"), len(KINDS) + 1, RUN_S, rng)
    kinds = open_kinds(record)
    return (
        *plan_motions(arm, kinds, len(kinds), RUN_S, rng),
        *plan_motions(arm, ("spline",), ALWAYS, RUN_S, rng),
    )


def open_kinds(record: JsonTable) -> tuple[str, ...]:
    """The three kinds of motion that answer what a diagnosis leaves open, the most pressing first.

    Tied classes come first, then the identified effects, whose parameters more of the same motion
    sharpens, then what could not be tested.
    """
    findings = record.get("findings", [])
    tied = [list(finding["class"]) for finding in findings if len(finding["class"]) > 1]
    named = [[finding["effect"]] for finding in findings]
    unseen = [[entry["effect"]] for entry in record.get("not_testable", [])]
    wanted = [KIND_OF[family_for(names, CATALOGUE)] for names in (*tied, *named, *unseen)]
    kinds = [kind for kind in dict.fromkeys(wanted) if kind != "spline"]
    usual = [kind for kind in ("fourier", "chirp", "ladder") if kind not in kinds]
    return tuple((kinds + usual)[:3])


# Every round's recordings first test the model of the round before, and only then teach the next
# one: the gap that ends the loop is always one on runs that the model never saw. Who moves the arm
# is given from outside.


Say = Callable[[str], None]


@dataclass(frozen=True)
class Round(Record):
    """One round."""

    minutes: float  # of motion, in this round
    # Gap of the model of the round before, on this round's recordings, by joint; None in the first.
    gap_floors: Mapping[str, float] | None
    gap_upper: float | None  # the upper end of its interval over all joints
    verdict: str = ""  # of the diagnosis of all recordings so far; empty where none was needed
    named: tuple[str, ...] = ()  # effects that it identified, each `effect joint`


@dataclass(eq=False)
class Taught:
    """A model, what it comes from, and the runs since, which it never saw."""

    record: JsonRecord  # the diagnosis
    # the arm as that has it: tuned links and losses, and all identified effects that have a law
    model: LawModel
    learned: tuple[Motion, ...]  # motions that it was made from
    unseen: list[Motion] = field(default_factory=list)  # motions since
    looks: int = 0  # how often it was checked

    @classmethod
    def by(cls, sessions: Sequence[Session], arm: ArmModel) -> Taught:
        """Diagnoses all recordings so far."""
        record, learned = _diagnose(sessions, arm)
        identified = Diagnosed.of_record(record, needed=False).candidates(arm)["after"]
        return cls(record, LawModel.of(identified, sessions[-1].payload), learned)

    @property
    def corner(self) -> float:
        """Corner of the diagnosis's common filter, and so of its noise [Hz]."""
        return self.learned[0].lowpass.cutoff

    @property
    def floors(self) -> Float[Array, " n"]:
        """Noise of each joint [N m]."""
        return np.array([gap["noise_floor_Nm"] for gap in self.record["gap"].values()])

    @property
    def named(self) -> tuple[str, ...]:
        """Effects that were identified, each `effect joint`."""
        return tuple(
            f"{finding['effect']} {', '.join(finding['joints'])}"
            for finding in self.record["findings"]
        )

    def check(self, session: Session) -> GapFloors:
        """The model's gap on all runs since it was made, a further session with them."""
        self.unseen.extend(prepare(session, self.corner))
        self.looks += 1
        return measure_floors(
            follow_warmth(self.model, self.learned, self.unseen), self.unseen, self.floors
        )


@dataclass(frozen=True, eq=False)
class Closed:
    """How the loop ended."""

    reason: str  # why it ended
    rounds: tuple[Round, ...]  # all rounds
    before: GapFloors  # gap of the URDF as it is, on the last round's recordings
    after: GapFloors  # gap of the last model that was checked there
    last: Taught  # that model, and what it comes from

    @property
    def closed(self) -> bool:
        """Whether it is sure that hardly more than noise is left."""
        return self.after.closed

    @property
    def minutes(self) -> float:
        """Minutes of motion in all rounds, the last one's check among them."""
        return sum(passed.minutes for passed in self.rounds)


def close_gap(
    arm: ArmModel,
    recorder: Recorder,
    seed: int,
    most: int = MOST_ROUNDS,
    say: Say = lambda line: None,
) -> Closed:
    """Runs the loop until the gap is closed, or the rounds are spent.

    Args:
        arm: The arm as its URDF describes it.
        recorder: Who records.
        seed: Of the motions.
        most: Most rounds, the first included; at least two, for the second checks the first.
        say: Called with a line for each round.

    Raises:
        InputError: Recordings that can't be used, or too few rounds.
    """
    if most < 2:
        raise InputError("--rounds", f"{most} round(s) can't be checked", "give 2 or more")
    known: list[Session] = []
    rounds: list[Round] = []
    state: Taught | None = None
    reached: list[float] = []
    while True:
        number = len(rounds) + 1
        rng = np.random.default_rng([seed, number])
        session = recorder.record(choose_motions(arm, rng, None if state is None else state.record))
        report = inspect_sessions([session], arm)[0]
        report.require_fit(learning=False)
        known.append(report.session)
        minutes = session.duration / 60.0
        gap = None
        if state is not None:
            gap = state.check(report.session)
            joints = " ".join(f"{value:.2f}" for value in gap.joints.values())
            left = f"{gap.together:.2f} × the noise ({joints}), at most {gap.upper:.2f}"
            say(f"round {number}: {minutes:.1f} min recorded; the last model leaves {left}")
            # More motion makes a small gap sure, or shows that it was chance.
            if gap.small and state.looks < PATIENCE and not gap.closed and number < most:
                rounds.append(Round(minutes, gap.joints, gap.upper))
                continue
            reached.append(gap.together)
            best = min(reached[:-STALLED_MODELS], default=np.inf)
            stalled = min(reached[-STALLED_MODELS:]) > PROGRESS * best
            if gap.closed or number >= most or stalled:
                rounds.append(Round(minutes, gap.joints, gap.upper))
                urdf = LawModel.of(IdentifiedArm.as_urdf(arm), session.payload)
                before = measure_floors([urdf] * len(state.unseen), state.unseen, state.floors)
                farthest = max(gap.joints, key=lambda name: gap.joints[name])
                why = "no nearer with more recordings" if stalled else "rounds spent"
                reason = "closed" if gap.closed else f"{why}; {farthest} is farthest from its noise"
                return Closed(reason, tuple(rounds), before, gap, state)
        state = Taught.by(known, arm)
        by_joint, upper = (None, None) if gap is None else (gap.joints, gap.upper)
        rounds.append(Round(minutes, by_joint, upper, state.record["verdict"], state.named))
        say(
            f"round {number}: {state.record['verdict']}"
            + "".join(f"; {name}" for name in state.named)
        )


def _diagnose(sessions: Sequence[Session], arm: ArmModel) -> tuple[JsonRecord, tuple[Motion, ...]]:
    reports = inspect_sessions(join_sessions(sessions), arm)
    diagnosis, analysis, motions = diagnose_reports(reports, arm, CATALOGUE)
    if analysis is None:
        fatal = next(issue for issue in diagnosis.telemetry if issue.severity == "fatal")
        where = str(sessions[-1].path or sessions[-1].name)
        raise InputError(
            where, f"the recordings are refused: {fatal.issue}, {fatal.evidence}", fatal.remedy
        )
    return diagnosis.to_dict(), tuple(motions)


def join_sessions(sessions: Sequence[Session]) -> tuple[Session, ...]:
    """One session of all runs where one clock goes on through them; the sessions as they are where
    it does not.
    """
    runs = [run for session in sessions for run in session.runs]
    if any(after.time[0] <= before.time[-1] for before, after in pairwise(runs)):
        return tuple(sessions)
    return (sessions[0].replace(runs=tuple(runs)),)


# How far a model is from recordings that it never saw, in each joint's noise; and whether that is
# sure. A model whose friction follows warmth must know more than the motion. A diagnosis reports
# how much friction changes between the coldest and the warmest moment of its recordings, and how
# fast a joint warms, not how warm it was when. That follows from the motion itself: θ' = P − θ / τ
# with P the power that friction turns into heat, over the clock of all runs, pauses included.
# Source: the law of `thermal_friction` of the catalogue (Wolf and Iskandar 2018; Simoni 2017).


@dataclass(frozen=True, eq=False)
class GapFloors:
    """A model's torque gap in noise floors."""

    # RMS of what is left at each joint over its noise floor, by its name
    joints: Mapping[str, float]
    together: float  # root mean square over the joints
    upper: float  # the same at the upper end of its one-sided interval, by how the runs differ

    @property
    def small(self) -> bool:
        """Whether hardly more than noise is left, as far as these runs say."""
        return self.together <= MARGIN

    @property
    def closed(self) -> bool:
        """Whether that is sure."""
        return self.upper <= MARGIN


def measure_floors(
    models: Sequence[SimulatorModel], motions: Sequence[Motion], floors: Float[Array, " n"]
) -> GapFloors:
    """Gap of models from the log in noise floors, where a joint slides.

    Args:
        models: One a run.
        motions: The runs; model and log go through the run's own filter.
        floors: Noise of each joint [N m].
    """
    errors = [log_error(model, run) / floors for model, run in zip(models, motions, strict=True)]
    squares = np.array([np.sum(error**2, axis=0) for error in errors])
    counts = np.array([run.settled.sum(axis=0) for run in motions], dtype=float)
    return pool_runs(squares, counts, motions[0].joints)


def pool_runs(
    squares: Float[Array, "R n"], counts: Float[Array, "R n"], joints: Sequence[str]
) -> GapFloors:
    """Mean squares of runs of unequal length, and the upper bound of their mean over the joints.

    Neighbouring samples are copies of each other, so that a run counts as one draw; the variance is
    that of a ratio of sums. Joints that never slide are left out.

    Source: Cochran, Sampling Techniques (1977), section 6.3.
    """
    total = np.maximum(counts.sum(axis=0), 1.0)
    mean = squares.sum(axis=0) / total
    slid = counts.sum(axis=0) > 0
    runs = len(squares)
    n = max(int(slid.sum()), 1)
    # What each run adds to the mean over the joints, about its expectation.
    off = (squares - mean * counts) / total
    apart = off[:, slid].sum(axis=1) / n
    together = float(mean[slid].sum() / n)
    by_joint = dict(zip(joints, map(float, np.sqrt(mean)), strict=True))
    if runs < 2:
        return GapFloors(by_joint, float(np.sqrt(together)), np.inf)
    error = np.sqrt(np.sum(apart**2) * runs / (runs - 1))
    upper = together + student.ppf(1.0 - DOUBT, runs - 1) * error
    return GapFloors(by_joint, float(np.sqrt(together)), float(np.sqrt(upper)))


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A planned motion on a clock."""

    time: Float[Array, " T"]
    dq: Float[Array, "T n"]
    interval: float = TICK_S


TimedRun = Motion | PlannedRun


def follow_warmth(
    model: SimulatorModel, learned: Sequence[TimedRun], runs: Sequence[TimedRun], cold: bool = False
) -> list[SimulatorModel]:
    """The model for each of further runs; one without a law that follows modelled warmth is the
    same for all.

    Args:
        model: The model.
        learned: Runs that its laws were learnt from: their least and largest heat are coldest and
            warmest.
        runs: All runs since, in order of time.
        cold: Whether the joints are cold before these; else they go on from where the learned ones
            left them.
    """
    effects = model.effects if isinstance(model, LawModel) else ()
    warming = [(j, values[CONSTANT]) for _, j, values in effects if CONSTANT in values]
    if not warming or not isinstance(model, LawModel):
        return [model] * len(runs)
    warmth = [np.full(run.dq.shape, HALF_WARM) for run in runs]
    for j, constant in warming:
        known = heat_along(model, j, constant, learned)
        coldest = min(warmth.min() for warmth in known)
        warmest = max(warmth.max() for warmth in known)
        followed = runs if cold else (*learned, *runs)
        courses = heat_along(model, j, constant, followed)[-len(runs) :]
        for values, heat in zip(warmth, courses, strict=True):
            values[:, j] = (heat - coldest) / max(warmest - coldest, LEAST_HEAT)
    return [replace(model, warmth=values) for values in warmth]


def heat_along(
    model: LawModel, joint: int, constant: float, runs: Sequence[TimedRun]
) -> list[Float[Array, " T"]]:
    """Heat of a joint over each run, cold before the first [J]; it keeps its heat for a time
    constant [s].

    Args:
        model: Its losses make the heat.
        joint: Number of the joint.
        constant: Time in which the heat falls to 1/e [s].
        runs: In the order of time; between them the joint cools.

    Returns:
        One array a run.
    """
    heats: list[Float[Array, " T"]] = []
    heat = 0.0
    clock = None
    coulomb = model.losses.coulomb[joint]
    viscous = model.losses.viscous[joint]
    for run in runs:
        rest = 0.0 if clock is None else max(float(run.time[0]) - clock, 0.0)
        speed = np.abs(run.dq[:, joint])
        power = speed * (coulomb + viscous * speed)
        cooled = heat * np.exp(-rest / constant)
        heats.append(warm_up(power, run.interval, constant, cooled))
        heat = float(heats[-1][-1])
        clock = float(run.time[-1])
    return heats
