"""The loop on one arm, simulated or real, and what `ident close` reports of each.

Beside the model that the loop ends on: the URDF as it is, links and losses tuned without an effect,
the URDF with a residual net, and the middle of wide randomisation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.checks.inspection import inspect_sessions
from ident.closed_loop.loop import (
    MOST_ROUNDS,
    Closed,
    PlannedRun,
    Say,
    Taught,
    close_gap,
    follow_warmth,
    measure_floors,
)
from ident.closed_loop.recorder import REST_S, SimulatedArm, draw_effects
from ident.errors import InputError
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.loaded import LawModel, SimulatorModel
from ident.export.write import write_patch
from ident.files import write_record
from ident.laws.motion import Losses
from ident.model.carried import describe_arm
from ident.model.residual_net import PRESETS, ResidualNet, Unexplained, fit_net_of_arm
from ident.motion.motion import Motion, prepare
from ident.records import JsonRecord
from ident.results import Result
from ident.robot.arm import ArmModel
from ident.simulation.hardware import Hardware
from ident.simulation.record import no_progress
from ident.simulation.simulate import SimulationOptions
from ident.simulation.simulator import Simulator
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import TICK_S, ReferenceMotion

# Motions that are kept for the end: everyday ones, of other seeds than all that was recorded [s].
HELD_OUT_S = 6.0
HELD_OUT_RUNS = 4
# Feedback of the controller that is tried [rad/s]: soft, as where people are near; a stiff loop
# would hide the model.
TRACKING_BANDWIDTH = 20.0
# Wide randomisation, as it is done without recordings: dry friction, and viscous friction at top
# speed, each from nothing to this share of rated torque; rotor inertia from nothing to twice what
# gears of that rating have; masses evenly about the URDF's. A trainer's guess, not a measurement.
FRICTION_SHARE = 0.1
# Rotor inertia of a gear of 157 N m [kg m²], and how it grows with the rating: of strain-wave
# gears' data sheets.
ROTOR_157 = 1.0
ROTOR_GROWTH = 1.55
# Over this speed the randomised friction turns round [rad/s].
TURNING_SPEED = 0.02
# Effects of a simulated arm.
EFFECTS = 3
# Tracking errors of the models, and their keys in the record.
TRACKED = {
    "tracking_before_rad": "urdf",
    "tracking_after_rad": "closed",
    "tuned_after_rad": "tuned",
    "net_after_rad": "net",
    "randomised_after_rad": "randomised",
}


def compare_models(
    arm: ArmModel, hidden: SimulatedArm, last: Taught, seed: int
) -> tuple[dict[str, float], dict[str, float]]:
    """Gap [noise floors] and tracking error [rad] of each model on the same motions of the same
    arm.

    Args:
        arm: The URDF's arm.
        hidden: The simulated one that is recorded anew.
        last: The last diagnosis.
        seed: Of the motions.

    Returns:
        The gaps, then the tracking errors, each by the model's name.
    """
    motions = plan_motions(
        arm, ("spline",), HELD_OUT_RUNS, HELD_OUT_S, np.random.default_rng([seed, 0, 1])
    )
    fresh = prepare(inspect_sessions([hidden.record(motions)], arm)[0].session, last.corner)
    models: dict[str, SimulatorModel] = {
        "urdf": LawModel.of(IdentifiedArm.as_urdf(arm)),
        "tuned": LawModel.of(
            Diagnosed.of_record(last.record, needed=False).candidates(arm)["tuned"]
        ),
        "net": train_net(arm, last.learned, seed),
        "randomised": randomised_middle(arm),
        "closed": last.model,
    }
    heldout = {}
    for name, model in models.items():
        unseen = (*last.unseen, *fresh)
        followed = follow_warmth(model, last.learned, unseen)[-len(fresh) :]
        heldout[name] = measure_floors(followed, fresh, last.floors).together
    assert hidden.hardware is not None
    return heldout, track(hidden.hardware, models, motions, seed, last.learned)


def randomised_middle(arm: ArmModel) -> LawModel:
    """The middle of wide ranges: of all feed-forwards the one with the least mean square error over
    them.
    """
    rated = arm.rated_torque
    limit = arm.known_limits.speed
    speed = np.where(limit < 50.0, limit, 3.0)
    middle = 0.5 * FRICTION_SHARE * rated
    losses = Losses(
        motor_inertia=ROTOR_157 * (rated / 157.0) ** ROTOR_GROWTH,
        viscous=middle / speed,
        coulomb=middle,
        transition=np.full(arm.n, TURNING_SPEED),
        range=np.zeros(arm.n),
    )
    return LawModel(describe_arm(arm), losses)


@dataclass(frozen=True, eq=False)
class NetModel:
    """A residual net alone: the URDF's rigid arm, with what it is known to carry, and a net for all
    the rest.
    """

    arm: ArmModel
    net: ResidualNet

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Torque that the motors deliver along a run [N m], the net's part included.

        Args:
            q: Joint positions (T, n) [rad].
            dq: Speeds (T, n) [rad/s].
            ddq: Accelerations (T, n) [rad/s²].
            interval: Not used: the net has no memory.
        """
        rigid = self.arm.inverse_dynamics(q, dq, ddq)
        return np.asarray(rigid + self.net.predict(q, dq, ddq, rigid))

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        """The torque as it is: the log is taken for it, and the interval not used."""
        return torque


def train_net(arm: ArmModel, motions: Sequence[Motion], seed: int) -> NetModel:
    """Trains the net on runs of one set-up."""
    options = replace(PRESETS["default"], seed=seed)
    unexplained = Unexplained.by(motions, arm, lambda _, rigid: 0.0 * rigid)
    net = fit_net_of_arm(unexplained, options, None, None)
    return NetModel(arm.with_payload(motions[0].payload), net)


def put_on_a_clock(motions: Sequence[ReferenceMotion], pause: float) -> tuple[PlannedRun, ...]:
    """Planned motions one after the other, each after the same pause [s]."""
    planned = []
    clock = 0.0
    for motion in motions:
        clock += pause
        times = clock + TICK_S * np.arange(len(motion.dq))
        planned.append(PlannedRun(times, motion.dq))
        clock += motion.duration
    return tuple(planned)


Models = Mapping[str, SimulatorModel]


def track(
    hardware: Hardware,
    models: Models,
    motions: Sequence[ReferenceMotion],
    seed: int,
    learned: Sequence[Motion],
) -> dict[str, float]:
    """Runs one controller on the true arm, cold at first, its feed-forward designed with each model
    in turn.

    Computed torque of the reference, and the same soft feedback for all: proportional and
    derivative, for a bandwidth of 20 rad/s at the arm's inertia. Noise and friction's changes are
    the same for all; warmth that a model follows is that of the runs that it was learnt from.

    Returns:
        Root mean square over joints and motions of what the encoders miss the reference by [rad].
    """
    soft = hardware.replace(bandwidth=TRACKING_BANDWIDTH)
    offset = np.array(hardware.sensing.encoder_offset)
    errors = {}
    clocked = put_on_a_clock(motions, REST_S)
    for name, model in models.items():
        each = zip(follow_warmth(model, learned, clocked, cold=True), motions, strict=True)
        feeds = [model.joint_torque(run.q, run.dq, run.ddq, TICK_S) for model, run in each]
        simulator = Simulator(soft, np.random.default_rng([seed, 11]))
        traces = simulator.run(motions, [REST_S] * len(motions), no_progress, feeds)
        missed = np.concatenate([trace.log.angle + offset - trace.motion.q for trace in traces])
        errors[name] = float(np.sqrt(np.mean(missed**2)))
    return errors


@dataclass(frozen=True, eq=False)
class Closing(Result):
    """All arms."""

    SCHEMA = "ident.close/1"

    arms: tuple[JsonRecord, ...]  # the record of each (`ident.close/1`)

    def summary(self) -> str:
        """One line an arm; the medians where there are several, and those of the rivals."""
        lines = []
        for arm in self.arms:
            end = "closed" if arm["closed"] else f"not closed ({arm['reason']})"
            who = "arm" if arm["seed"] is None else f"arm {arm['seed']}"
            line = (
                f"{who}: {end} after {arm['minutes']:.1f} min of motion in {arm['rounds']} "
                "rounds; torque gap "
            )
            line += f"{arm['gap_floors_before']:.1f} -> {arm['gap_floors_after']:.2f} x the noise"
            if "tracking_before_rad" in arm:
                before, last = (1e3 * arm[f"tracking_{when}_rad"] for when in ("before", "after"))
                line += f"; the same controller misses by {before:.1f} -> {last:.2f} mrad"
            lines.append(line)
        if len(self.arms) > 1:
            minutes = [arm["minutes"] for arm in self.arms]
            after = [arm["gap_floors_after"] for arm in self.arms]
            closed = sum(arm["closed"] for arm in self.arms)
            line = (
                f"{closed} of {len(lines)} closed; median {np.median(minutes):.1f} min (most "
                f"{max(minutes):.1f}), "
            )
            lines.append(f"{line}gap {np.median(after):.2f} x the noise (largest {max(after):.2f})")
        if len(compared := [arm for arm in self.arms if arm["heldout_floors"]]) > 1:
            lines.append("on motions that served nothing else, median (largest):")
            for key, name in TRACKED.items():
                gap = [arm["heldout_floors"][name] for arm in compared]
                missed = [1e3 * arm[key] for arm in compared]
                line = (
                    f"  {name}: gap {np.median(gap):.2f} ({max(gap):.2f}) x the noise, the "
                    "controller misses by "
                )
                lines.append(f"{line}{np.median(missed):.2f} ({max(missed):.2f}) mrad")
        return "\n".join(lines)


def close_simulated(
    robot: str,
    seed: int,
    folder: Path,
    most: int = MOST_ROUNDS,
    effects: Sequence[str] | None = None,
    compared: bool = True,
    say: Say = lambda line: None,
) -> JsonRecord:
    """One simulated arm: the loop, then the rivals on motions that served nothing else.

    Returns:
        Its record, without what is only known of simulated arms where nothing was compared.
    """
    arm = ArmModel.load(robot)
    if effects is None:
        rng = np.random.default_rng([seed, 3])
        options = SimulationOptions(
            robot=robot, seed=seed, effects=draw_effects(arm.joint_names, EFFECTS, rng)
        )
    else:
        options = SimulationOptions(robot=robot, seed=seed, effects=tuple(effects))
    hidden = SimulatedArm(options)
    loop = close_gap(arm, hidden, seed, most, say)
    heldout, tracking = compare_models(arm, hidden, loop.last, seed) if compared else ({}, {})
    tracked = {key: tracking[name] for key, name in TRACKED.items() if name in tracking}
    truth = {"seed": seed, "effects": list(hidden.effects), "heldout_floors": heldout}
    return {**keep(loop, arm, folder), **truth, **tracked}


def keep(loop: Closed, arm: ArmModel, folder: Path) -> JsonRecord:
    """Writes the last diagnosis and, where an effect is identified, its patch; the arm's record
    (`ident.close/1`).
    """
    diagnosis = loop.last.record
    patch = ""
    folder.mkdir(parents=True, exist_ok=True)
    write_record(folder / "diagnosis.json", diagnosis)
    if diagnosis["findings"]:
        with suppress(InputError):  # identified, but nothing that a file could hold
            write_patch(
                Diagnosed.of_record(diagnosis, path=folder / "diagnosis.json"),
                arm,
                folder / "patch",
            )
            patch = "patch"
    return {
        "seed": None,
        "robot": diagnosis["robot"],
        "joints": list(diagnosis["joints"]),
        "effects": [],
        "closed": loop.closed,
        "reason": loop.reason,
        "minutes": loop.minutes,
        "rounds": len(loop.rounds),
        "by_round": [passed.to_dict() for passed in loop.rounds],
        "named": list(loop.last.named),
        "gap_floors_before": loop.before.together,
        "gap_floors_after": loop.after.together,
        "gap_floors_by_joint": loop.after.joints,
        "heldout_floors": {},
        "patch": patch,
    }
