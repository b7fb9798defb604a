"""Numbers that decide, each with its unit, its meaning and where it comes from: those of the
effects, by the file that asks for them.
"""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class TypicalSettings(Numbers):
    """What joints and arms usually have, where nothing else is known."""

    typical_coulomb_share: float = number(
        0.05,
        "rated torques",
        "Coulomb friction where the baseline has none yet",
        "chosen: as gears have",
    )
    typical_viscous_speed: float = number(
        2.0,
        "rad/s",
        "speed at which viscous friction adds as much again",
        "chosen: as gears have",
    )
    least_speed_ratio: float = number(
        3.0,
        "speeds of rest",
        "that a joint must reach to count as moving",
        "chosen: far beyond noise",
    )
    slide_per_turn: float = number(
        0.1,
        "m/rad",
        "what a joint that slides goes for a radian of one that turns, where travel and speed are "
        "asked for",
        "chosen: the radius of pulleys and pinions",
    )
    least_poses: float = number(
        0.1,
        "rad or m",
        "poses that lie nearer to each other are one",
        "chosen: gravity hardly changes",
    )
    sampled_states: int = number(
        200,
        "1",
        "samples of a session by which structure and typical sizes are judged",
        "chosen: a limit on work",
    )
    near: float = number(
        2.5,
        "1",
        "factor of where it was taken within which a secant is right",
        "chosen: inner grids are about as wide",
    )


@dataclass(frozen=True)
class AddedBodySettings(Numbers):
    """Bodies on links."""

    least_mass_share: float = number(
        0.0001,
        "1",
        "mass over the arm's below which a body is none",
        "chosen: its place can't be determined",
    )
    least_column: float = number(
        1e-06,
        "1",
        "a column whose torque is less than this share of its link's largest acts on nothing",
        "chosen: rounding",
    )
    structure_states: int = number(
        30,
        "1",
        "states by which what acts is judged",
        "chosen: more tell the same",
    )
    place_steps: int = number(
        4,
        "1",
        "steps of Gauss and Newton towards a body's place",
        "chosen: they have settled",
    )


@dataclass(frozen=True)
class ContactSettings(Numbers):
    """Pushes from outside."""

    shortest_window: float = number(
        0.5,
        "s",
        "shortest window of a push",
        "chosen: a hand pushes longer",
    )
    edge: float = number(
        0.1,
        "s",
        "time in which its force sets in and fades",
        "chosen: as fast as a hand",
    )
    swelling: float = number(
        2.5,
        "1",
        "how much longer a push that swells lasts than it is strong",
        "law: a squared sine is above three quarters of its height for a third of its time, above "
        "half for a half",
    )
    largest_force_share: float = number(
        3.5,
        "1",
        "largest force, over the one with which the strongest joint's rated torque pushes at the "
        "arm's reach",
        "chosen: near the base links bear more",
    )
    screen_ratio: float = number(
        4.0,
        "1",
        "mean square of a stretch over the usual one, over all joints, from which on it may be a "
        "push",
        "chosen: far beyond chance",
    )
    screen_one_ratio: float = number(
        7.0,
        "1",
        "the same at one joint",
        "chosen: far beyond chance",
    )
    most_pushes: int = number(
        3,
        "1",
        "pushes of a session that are asked for",
        "chosen: more are no event",
    )
    most_windows: int = number(
        40,
        "1",
        "windows that are looked at for them",
        "chosen: a limit on work",
    )
    usual_samples: int = number(
        200000,
        "1",
        "samples, evenly over the session, that tell what is usually left",
        "chosen: a limit on work",
    )
    least_explained: float = number(
        0.6,
        "1",
        "share of what changes in its window that a constant force at a link's point must "
        "explain, over all joints",
        "chosen: most of it",
    )
    most_cuts: int = number(
        200,
        "1",
        "places in a window and around it where its push may begin or end",
        "chosen: a limit on work; within 4 s each sample",
    )
    reach: float = number(
        1.5,
        "s",
        "time before and after a window in which its push may have begun or ended",
        "chosen: longer than a hand's",
    )
    around: float = number(
        0.5,
        "s",
        "what is left so long before and after a window is left during it, too",
        "chosen: friction that is another in this run",
    )


@dataclass(frozen=True)
class FrictionSettings(Numbers):
    """Friction of speed, load, place and direction."""

    largest_load_share: float = number(
        0.2,
        "1",
        "largest share of load-dependent friction in the load",
        "chosen: gears with less efficiency are rare",
    )
    least_load_range: float = number(
        0.004,
        "1",
        "share of the rated torque by which a load must vary, or it gives nothing but more "
        "Coulomb friction",
        "chosen: below friction's own size",
    )
    least_top_speed: float = number(
        0.05,
        "rad/s",
        "speeds below leave nothing of a curve over speed",
        "chosen: slower motion is presliding",
    )
    viscous_exponents: tuple[float, ...] = number(
        (0.3, 0.5, 0.7, 2.0),
        "1",
        "exponents of friction over speed",
        "chosen: greases and churning",
    )
    knees: tuple[tuple[float, ...], ...] = number(
        ((0.05, 0.2), (0.05, 0.5), (0.2, 0.2), (0.2, 0.5), (0.6, 0.2)),
        "rad/s, 1",
        "of laws that are straight up to a knee: its speed, and the exponent beyond it",
        "chosen: lubricants that thin",
    )
    fine_knee_factors: tuple[float, ...] = number(
        (0.4, 0.63, 1.0, 1.6, 2.5),
        "1",
        "knees of the finer grid, in a law's own",
        "chosen: ratios of about 1.6",
    )
    fine_knees: tuple[float, ...] = number(
        (0.02, 0.05, 0.1),
        "rad/s",
        "knees that are tried of a law without one",
        "chosen: below usual speeds",
    )
    fine_bent_steps: tuple[float, ...] = number(
        (-0.3, -0.15, -0.07, 0.0, 0.07, 0.15, 0.3),
        "1",
        "steps of the exponent with a knee, which makes up for it",
        "chosen: wider than without",
    )
    fine_exponent_steps: tuple[float, ...] = number(
        (-0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15),
        "1",
        "steps of the exponent without one",
        "chosen: half of the coarse grid's",
    )
    least_exponent: float = number(
        0.05,
        "1",
        "least exponent beyond a knee",
        "chosen: below it a law is Coulomb's",
    )


@dataclass(frozen=True)
class GearSettings(Numbers):
    """Gears that give way."""

    largest_twist: float = number(
        1.0,
        "rad",
        "deflection from which on the link's equation, linear in small ones, says nothing of any "
        "arm",
        "chosen: velocity torques or a negative inertia swing it up without bound",
    )
    fine_factors: tuple[float, ...] = number(
        (0.5, 0.6, 0.7, 0.84, 1.0, 1.2, 1.4, 1.7, 2.0),
        "1",
        "factors of the finer grids around the best stiffness or gap",
        "chosen: ratios of about 1.2",
    )
    resonances: tuple[float, ...] = number(
        (2.2, 4.5, 6.5, 9.0, 12.5, 18.0, 30.0),
        "Hz",
        "resonances of the link on its gear; above the last the deflection follows the load at "
        "once",
        "chosen: one point serves all beyond",
    )
    largest_wind_up: float = number(
        2.0,
        "rad",
        "wind-up at the rated torque of springs in series",
        "chosen: softer is no joint",
    )
    least_wind_up: float = number(
        0.0005,
        "rad",
        "and of what is as good as rigid",
        "makers: cycloidal gears wind up by 0.9 to 1 mrad at their rated torque (Nabtesco RV-20E: "
        "167 N m, 49 N m per minute of arc), strain wave gears by more; half of it",
    )
    damping_ratio: float = number(
        0.06,
        "1",
        "damping ratio of the search",
        "chosen: as gears have",
    )
    fine_damping_ratios: tuple[float, ...] = number(
        (0.025, 0.06, 0.14),
        "1",
        "and of the finer grid",
        "chosen: ratios of about 2.4",
    )
    damping_doubt: float = number(
        4.0,
        "1",
        "times by which a damping may be more or less and looks the same",
        "chosen: the grid's reach",
    )
    low_frequency: float = number(
        2.0,
        "Hz",
        "torque above this frequency shows elasticity",
        "chosen: arms move below",
    )
    least_high_share: float = number(
        0.002,
        "1",
        "share of the rated torque that must lie above it",
        "chosen: less is noise",
    )
    narrow_gaps: tuple[float, ...] = number(
        (0.0005, 0.002),
        "rad",
        "full widths of play that the link is through before the filter sees it: what is left is "
        "proportional to the width",
        "chosen: new gears",
    )
    wide_gaps: tuple[float, ...] = number(
        (
            0.0025,
            0.003137,
            0.003937,
            0.00494,
            0.006198,
            0.007778,
            0.00976,
            0.01225,
            0.01537,
            0.01928,
            0.0242,
            0.03037,
            0.0381,
            0.04782,
            0.06,
        ),
        "rad",
        "widths of play, of which those that look most like what is left go on to the search",
        "chosen: ratios of about 1.25, up to a loose coupling",
    )
    wide_kept: int = number(
        2,
        "1",
        "wide gaps that go on to the search, those most like what the tuned model leaves",
        "chosen: a limit on work",
    )
    contact_stiffness: float = number(
        150.0,
        "rated torques a radian",
        "stiffness of the gear in contact",
        "chosen: as in the law of written files",
    )
    contact_damping_ratio: float = number(
        0.3,
        "1",
        "its damping ratio",
        "chosen: tooth contact hardly rebounds",
    )
    fine_contact_ratios: tuple[float, ...] = number(
        (0.3, 0.6, 1.0),
        "1",
        "those of the finer grid",
        "chosen: up to no rebound",
    )
    wide_contact_ratio: float = number(
        1.0,
        "1",
        "that behind a wide gap",
        "chosen: no rebound",
    )
    least_load_share: float = number(
        0.002,
        "1",
        "load to either side of zero that counts, as a share of the rated torque",
        "chosen: less is noise",
    )
    fine_wide_factors: tuple[float, ...] = number(
        (0.82, 0.88, 0.92, 0.96, 1.0, 1.04, 1.08, 1.13, 1.2),
        "1",
        "factors of the finer grid around a wide gap",
        "chosen: each width looks different",
    )


@dataclass(frozen=True)
class MemorySettings(Numbers):
    """Friction with a memory."""

    time_constants: tuple[float, ...] = number(
        (30.0, 120.0, 480.0, 1800.0),
        "s",
        "time constants of warming up",
        "chosen: from a small gear to a large one",
    )
    fine_time_factors: tuple[float, ...] = number(
        (0.4, 0.5, 0.63, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5),
        "1",
        "factors of the finer grid",
        "chosen: ratios of about 1.25",
    )
    longest_time_constant: float = number(
        4.0,
        "sessions",
        "time constants beyond are straight lines, all the same",
        "chosen: four",
    )
    least_session: float = number(
        60.0,
        "s",
        "session that shows warming up without a sensor",
        "chosen: shorter ones hardly warm",
    )
    least_temperature_range: float = number(
        1.0,
        "K",
        "temperature that must be gone through",
        "chosen: a sensor's steps",
    )
    temperature_average: float = number(
        5.0,
        "s",
        "time over which steps and noise of a sensor are averaged",
        "chosen: they are slow and coarse",
    )
    displacements: tuple[float, ...] = number(
        (0.002, 0.006, 0.018, 0.05),
        "rad",
        "ranges of stops",
        "chosen: ratios of about three, from what contacts of all gears bend to elasticity",
    )
    stops_side_by_side: tuple[int, ...] = number(
        (1, 2, 3),
        "1",
        "stops of neighbouring ranges that a build-up is made of",
        "chosen: three bend it enough",
    )
    largest_noise_share: float = number(
        0.3,
        "1",
        "position noise that a stop bears, as a share of its range",
        "chosen: more turns it round",
    )


@dataclass(frozen=True)
class RigidBodySettings(Numbers):
    """Masses that are not where the URDF has them."""

    payload_reaches: tuple[float, ...] = number(
        (0.03, 0.12),
        "m",
        "distances of the load from the last joint's frame, along its axis, about which its "
        "inertia is linearised",
        "chosen: a gripper and a tool",
    )
    largest_payload_share: float = number(
        0.5,
        "1",
        "largest load over the arm's moving mass",
        "chosen: makers rate arms by a sixth to a half",
    )
    least_payload_share: float = number(
        0.003,
        "1",
        "least load over it",
        "chosen: lighter ones matter little",
    )
    largest_lever_share: float = number(
        0.27,
        "1",
        "distance of a load's centre from the flange over the arm's reach",
        "chosen: as makers rate arms",
    )
    largest_inertia_share: float = number(
        0.4,
        "1",
        "share of a link's mass that a URDF may be off",
        "chosen: as the catalogue draws it",
    )
    least_link_share: float = number(
        0.005,
        "1",
        "links lighter than this share of the arm's mass have no scale of their own",
        "chosen: a flange",
    )
    least_link_length: float = number(
        0.09,
        "1",
        "and those shorter than this share of its reach",
        "chosen: a flange",
    )
    widest: float = number(
        2.0,
        "1",
        "deviation of a link's change in units of that, where the recordings do not determine it",
        "chosen: most of the link itself",
    )


@dataclass(frozen=True)
class RippleSettings(Numbers):
    """Ripple of the teeth."""

    ripple_orders: tuple[float, ...] = number(
        (1.0, 2.0),
        "turns of the motor",
        "orders of the teeth",
        "law: a wave generator has two lobes",
    )
    fewest: float = number(
        8.0,
        "1",
        "fewest cycles a turn that are looked at",
        "chosen: below lie laws of position",
    )
    most: float = number(
        600.0,
        "1",
        "most cycles a turn",
        "chosen: above no encoder tells the phase",
    )
    octaves: int = number(
        8,
        "1",
        "octaves of speed into which samples are sorted: of each line those count that pass it "
        "slowly enough",
        "chosen: eight reach from rest to full speed",
    )
    least_travel: float = number(
        0.2,
        "rad",
        "travel that shows a line apart from its neighbours",
        "chosen: some lines",
    )
    padding: int = number(
        4,
        "1",
        "times the angle is continued by zeros",
        "law: no line between two points of the sum is missed",
    )
    around: int = number(
        50,
        "lines",
        "on either side of one that tell what is usual there",
        "chosen: many, and near",
    )
    chance: float = number(
        0.01,
        "1",
        "chance of a line among noise that stands out so far",
        "law: one in a hundred",
    )
    most_lines: int = number(
        2,
        "1",
        "lines of a joint",
        "chosen: a limit on work",
    )
    least_cycles: float = number(
        3.0,
        "1",
        "cycles of a line that show its phase",
        "chosen: three",
    )
    largest_phase_noise: float = number(
        0.7,
        "rad",
        "noise of the position, in the line's phase, beyond which it doesn't show",
        "chosen: a tenth of a turn",
    )


@dataclass(frozen=True)
class SensingSettings(Numbers):
    """Torque and position that are not what the log says."""

    largest_offset: float = number(
        0.3,
        "rated torques",
        "offset that a sensor may have",
        "chosen: beyond it is broken",
    )
    least_torque_variation: float = number(
        0.004,
        "rated torques",
        "modelled torque that varies by less is as good as an offset",
        "chosen: below friction's own size",
    )
    saturation_knees: tuple[float, ...] = number(
        (0.6, 0.7, 0.8, 0.9),
        "1",
        "knees, in the largest modelled torque",
        "chosen: even steps",
    )
    knee_share: float = number(
        0.05,
        "1",
        "share of the largest reading by which the limit may lie above it",
        "chosen: drives bend into their limit",
    )
    least_peak_share: float = number(
        0.1,
        "rated torques",
        "largest torque below which no limit shows",
        "chosen: no drive is limited there",
    )
    largest_encoder_offset: float = number(
        0.07,
        "rad",
        "what zeros are off by on arms that were calibrated once",
        "chosen: four degrees",
    )
    large_offset: float = number(
        0.25,
        "rad",
        "offset whose secant is tried beside the slope at zero",
        "chosen: there the slope lacks 3 % of gravity's torque",
    )
    fine_offsets: tuple[float, ...] = number(
        (-2.4, -2.0, -1.6, -1.2, -0.8, -0.4, -0.2, 0.0, 0.2, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4),
        "1",
        "shares of it on the finer grid",
        "chosen: up to 35 degrees",
    )
    least_encoder_share: float = number(
        0.0005,
        "rated torques",
        "torque that the largest offset must make at some joint",
        "chosen: less is noise",
    )
    delays: tuple[float, ...] = number(
        (0.002, 0.008, 0.02, 0.05),
        "s",
        "delays",
        "chosen: ratios of about three, from a sample to a bus",
    )
    typical_delay: float = number(
        0.01,
        "s",
        "delay by which is judged whether one is seen",
        "chosen: some samples",
    )
    least_delay_share: float = number(
        0.0005,
        "rated torques",
        "what it must change at some joint",
        "chosen: less is noise",
    )


@dataclass(frozen=True)
class TransmissionSettings(Numbers):
    """Pull of another joint, and springs."""

    largest_correlation: float = number(
        0.98,
        "1",
        "velocities of two joints that are this alike can't be distinguished",
        "chosen: a fiftieth is left",
    )
    coupling_width: float = number(
        0.01,
        "rad/s",
        "width of the sign of a sum of two joints' speeds in a patch",
        "chosen: as slow as noise",
    )
    farthest: int = number(
        6,
        "joints",
        "farther apart they share no gear, belt or cable",
        "chosen: those of one arm; of a long chain pairs would be most of all",
    )
    least_spring_range: float = number(
        0.2,
        "rad",
        "range over which a spring is told at least",
        "chosen: less is a step of play",
    )
    largest_spring_share: float = number(
        0.1,
        "rated torques a radian",
        "spring that a joint may have",
        "chosen: hoses and cables",
    )


TYPICAL = TypicalSettings()
ADDED_BODY = AddedBodySettings()
CONTACT = ContactSettings()
FRICTION = FrictionSettings()
GEAR = GearSettings()
MEMORY = MemorySettings()
RIGID_BODY = RigidBodySettings()
RIPPLE = RippleSettings()
SENSING = SensingSettings()
TRANSMISSION = TransmissionSettings()
