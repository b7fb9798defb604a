"""The numbers by which effects are selected."""

from __future__ import annotations

from dataclasses import dataclass

from ident.effects.effect_info import LAW_SHARE
from ident.settings import Settings, number


@dataclass(frozen=True)
class SelectionSettings(Settings):
    """Tests, sizes and evidence that a name needs; each field's metadata hold `unit`, `meaning` and `source`."""

    family_error: float = number(
        0.05, "1", "chance of a false alarm over all candidates, sign-flip test", "law: the usual 5 %"
    )
    slow_error: float = number(
        0.01,
        "1",
        "chance that friction which wanders passes for a law of warmth, over all joints",
        "chosen: of healthy arms none in a hundred",
    )
    foretold_fall: float = number(
        0.25,
        "1",
        "share of a joint's held-out error whose fall makes that test needless",
        "chosen: chance foretells no two fifths of a mean square on runs that were never seen",
    )
    flips: int = number(999, "1", "draws of signs: the least p-value is one over one more", "law: resolution of 0.001")
    voices: int = number(
        24,
        "1",
        "no block's score speaks louder than that of this rank",
        "calibrated: false alarms of effects that show in few stretches",
    )
    least_rms_fall: float = number(
        0.02, "1", "least share by which a joint's held-out error must fall", "chosen: less changes no simulation"
    )
    least_gap_fall: float = number(
        0.1, "1", "least share of the mean square above noise that must be closed", "chosen: less changes no simulation"
    )
    least_own_share: float = number(
        LAW_SHARE**2,
        "1",
        "least share of what could be closed at the effect's own joint at first",
        "law: mean square that a cause leaves whose law is off by 15 % of its torque (`LAW_SHARE`)",
    )
    most_effects: int = number(
        8, "1", "most names that a search gives", "chosen: work; real arms have five open at once"
    )
    most_uneven: float = number(
        0.5,
        "1",
        "share by which a constant's size may differ between runs",
        "law: of sizes that differ by more, one in forty would have the other sign",
    )
    uneven_chance: float = number(0.01, "1", "chance below which such a difference is none", "law: the usual 1 %")
    absorbed_below: float = number(
        0.25,
        "1",
        "an effect of which tuned inertias leave a smaller share is absorbed",
        "calibrated: payloads and gains of the development set",
    )
    absorbed_ratio: float = number(
        2.0,
        "1",
        "and of which the URDF held fast leaves this many times as much",
        "chosen: else tuning is not what hides it",
    )
    absorbed_nats: float = number(
        12.0, "nats", "least evidence of an absorbed effect", "calibrated: arms within the URDF's tolerance"
    )
    fixed_factor: float = number(
        20.0,
        "1",
        "how many times tighter than its tolerance the URDF is when it is held fast",
        "chosen: tight without being singular",
    )
    event_nats: float = number(20.0, "nats", "least evidence of what happens once", "calibrated: healthy sessions")
    event_gap_fall: float = number(
        0.5, "1", "share of its joint's gap that what happens once must be", "chosen: else it is beside the point"
    )
    burst_nats: float = number(
        20.0,
        "nats",
        "least evidence of what comes in bursts, in place of `least_rms_fall`",
        "calibrated: healthy sessions",
    )
    essential_nats: float = number(
        10.0, "nats", "what the columns that make an effect what it is must add", "calibrated: springs without slope"
    )
    unlikely: float = number(
        0.01, "1", "family-wise p-value from which on a candidate without a name is told", "law: the usual 1 %"
    )
    unlikely_nats: float = number(5.0, "nats", "and its least evidence", "law: odds of 150 to 1")
    least_told_fall: float = number(
        0.015,
        "1",
        "and the least fall of the error: hours of recording make anything significant",
        "chosen: less can't be seen",
    )
    shortlist: int = number(8, "1", "candidates that are tried on held-out runs at each step", "chosen: work")
    steady_points: int = number(
        12, "1", "points of a grid that are tried on held-out runs where the best one fails there", "chosen: work"
    )
    polish_rounds: int = number(3, "1", "rounds in which names may be swapped", "chosen: work; two are usually enough")
    refine_rounds: int = number(
        3, "1", "rounds over the finer grids of all names", "chosen: work; two are usually enough"
    )
    most_settling: int = number(
        3,
        "1",
        "searches at the most, each beside a new figure of how much friction varies from run to run",
        "chosen: work",
    )
    settled_share: float = number(
        0.8,
        "1",
        "fall of that figure, as what is left of it, that is worth another search",
        "chosen: less changes no name",
    )
    interval_fall: float = number(
        1.92, "nats", "fall of the log likelihood at the ends of a 95 % interval", "law: half of χ²₁ at 95 %"
    )
    class_odds: float = number(
        10.0,
        "1",
        "names against which the holder's odds are no more stand in its class",
        "chosen: nine in ten",
    )
    rival_nats: float = number(
        60.0,
        "nats",
        "names whose evidence is weaker by more are not asked for",
        "chosen: far beyond `class_odds`, tempered",
    )
    temper: float = number(
        0.2, "1", "exponent that turns evidence into probabilities", "calibrated: reliability on the development set"
    )
    most_sure: float = number(
        0.96, "1", "no name is surer", "calibrated: how often sure names were right on the development set"
    )
    least_probability: float = number(
        0.3,
        "1",
        "a name less probable is not told",
        "chosen: of three that can't be told apart each has a third; of more none is a name",
    )
    most_doubted: int = number(
        8, "1", "names that can't be believed for each of which the search begins again", "chosen: work"
    )
    least_told: float = number(
        0.02,
        "1",
        "directions of the inertias of which the recordings tell less say nothing",
        "chosen: a seventh of a standard deviation",
    )
    most_likely: float = number(
        1e-06,
        "1",
        "chance below which inertias were tuned beyond their tolerance",
        "chosen: arms vary more than any normal law",
    )
    far_deviations: float = number(
        4.0, "1", "standard deviations from which on a direction makes up what was tuned away", "law: a chance of 6e-5"
    )
    urdf_scales: tuple[float, ...] = number(
        (0.5, 0.7, 1.0, 1.5, 2.2, 3.3, 5.0, 8.0),
        "1",
        "errors of the URDF that are tried, in units of its belief",
        "chosen: beyond a fifth (five times 4 %) a URDF is of another arm",
    )
    usual_urdf_factor: float = number(
        2.0, "1", "factor by which one URDF in three is off by more, or less", "chosen: a guess"
    )
    urdf_com_m: tuple[float, ...] = number(
        (0.0, 0.005, 0.01, 0.02),
        "m",
        "errors of all centres of mass that are tried beside",
        "chosen: beyond two centimetres a URDF is of another arm",
    )
    usual_urdf_com_m: float = number(
        0.008, "m", "distance by which one URDF in three is off by more", "chosen: a guess"
    )
    inertial_odds: float = number(
        100.0,
        "1",
        "odds that a name of the inertias' kind needs, for each of their number, against a URDF as wrong as it likes",
        "chosen: one arm in five has such a fault, and nineteen in twenty names are to be right",
    )
    wrong_link_factor: float = number(
        20.0,
        "1",
        "how far off a link with another body on it is, in units of the belief",
        "chosen: by about its own size, so many times 4 %",
    )


USUAL_SELECTION = SelectionSettings()
