"""Laws that hold for every effect, and the open catalogue."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from ident.arrays import Array
from ident.effects.base import Effect, Interval, SessionContext, Variant, impossible
from ident.effects.catalogue import CATALOGUE, find_effect, load_catalogue
from ident.effects.check import check_effect
from ident.effects.contact import ExternalContact
from ident.effects.effect_info import TABLE
from ident.effects.intervals import SizePrior
from ident.effects.pushes import Push
from ident.effects.record import EffectRecord, read_row
from ident.effects.session_context import friction_level, rated_torque
from ident.errors import InputError
from tests.fuzz.samples import CATALOGUE as MAGNET

# Of every effect whose name is fixed, the fixed names of its parameters. An effect that is new needs
# no entry: its parameters are those of its row.
FIXED = {
    "stribeck_friction": "amplitude_Nm stribeck_velocity_rad_s exponent left_Nm at_speed_rad_s",
    "nonlinear_viscous_friction": "coefficient exponent knee_rad_s bend_Nm at_speed_rad_s",
    "load_dependent_friction": "mu at_load_Nm at_speed_rad_s",
    "thermal_friction": "viscous_change coulomb_change time_constant_s",
    "presliding_hysteresis": "amplitude_Nm displacement_rad reversal_Nm at_travel_rad",
    "position_dependent_friction": "amplitude_Nm order phase_rad swing_Nm at_low_rad at_high_rad",
    "asymmetric_friction": "coulomb_difference_Nm viscous_difference_Nms_rad difference_Nm at_speed_rad_s",
    "joint_coupling": "viscous_Nms_rad coulomb_Nm inertia_kgm2 other_joint drag_Nm at_speed_rad_s",
    "joint_elasticity": "stiffness_Nm_rad damping_Nms_rad",
    "backlash": "gap_rad",
    "torque_ripple": "amplitude_Nm order phase_rad at_load_Nm",
    "spring_torque": "stiffness_Nm_rad rest_rad low_Nm high_Nm at_low_rad at_high_rad",
    "payload": "mass_kg com_x_m com_y_m com_z_m moment_about_axis_kgm",
    "link_inertial_error": "mass_change_kg moment_change_x_kgm moment_change_y_kgm moment_change_z_kgm "
    "moment_about_axis_kgm",
    "gravity_misalignment": "tilt_x_rad tilt_y_rad",
    "torque_gain_error": "gain",
    "torque_offset": "offset_Nm drift_Nm_s",
    "torque_delay": "delay_s",
    "torque_saturation": "limit_Nm at_knee_Nm at_peak_Nm",
    "encoder_offset": "offset_rad",
    "external_contact": "start_s end_s force_N link",
}

each_effect = pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.id)


def asked(effect: Effect, session: SessionContext) -> list[int]:
    """One or two joints at which the effect can be tested."""
    joints = range(session.n if effect.scope == "joint" else 1)
    return [joint for joint in joints if effect.untestable(session, joint) is None][:2]


def test_a_joint_without_a_limit_is_rated_as_its_successors_at_least(session: SessionContext) -> None:
    """Law: a joint about an upright axis carries next to nothing; its motor is no smaller than those behind it."""
    unknown = replace(session, rated_torque=np.full(session.n, np.inf))
    rated = [rated_torque(unknown, joint) for joint in range(session.n)]
    assert rated == sorted(rated, reverse=True)
    assert rated[0] == pytest.approx(1.5 * max(np.abs(run.total).max() for run in session.runs))


def parameter_names(effect: Effect) -> set[str]:
    """What an effect reports: the fixed names, or those of its row."""
    if effect.id in FIXED:
        return set(FIXED[effect.id].split())
    return {*effect.figures, *effect.grid}


def test_the_catalogue_holds_the_fixed_ids_and_each_id_once() -> None:
    """Law: what has a name keeps it; others may be added."""
    ids = [effect.id for effect in CATALOGUE]
    assert set(FIXED) <= set(ids)
    assert len(ids) == len(set(ids))
    assert all(effect.summary for effect in CATALOGUE)


@each_effect
def test_columns_fit_their_runs_and_figures_their_columns(effect: Effect, session: SessionContext) -> None:
    """Shapes are (T, k) or (T, n, k); every column is finite and acts somewhere; figures bear the fixed names."""
    joints = asked(effect, session)
    assert joints
    for joint in joints:
        for variant in effect.variants(session, joint):
            columns = effect.columns(session, joint, variant)
            k = columns[0].shape[-1]
            for run, values in zip(session.runs, columns, strict=True):
                lead = (len(run.motion.time),) if effect.rows == "own" else (len(run.motion.time), session.n)
                assert values.shape == (*lead, k)
                assert np.all(np.isfinite(values))
            acts = np.sqrt(sum(np.sum(values**2, axis=tuple(range(values.ndim - 1))) for values in columns))
            assert np.all(acts > 0.0)
            assert all(index < k for index in effect.nonnegative)
            scale = effect.prior_scale(session, joint, variant)
            assert scale.shape == (k,)
            assert np.all(scale > 0.0)
            figures = effect.parameters(session, joint, variant, 0.5 * scale, np.diag(0.01 * scale**2))
            assert set(figures) == parameter_names(effect)
            assert all(figure.low <= figure.value <= figure.high for figure in figures.values())
            assert set(variant.inner) <= set(figures)


@each_effect
def test_columns_of_a_part_of_a_session_are_those_of_the_whole(effect: Effect, session: SessionContext) -> None:
    """A long session is gone through a few runs at a time: that may change nothing, nor may the measured torque."""
    louder = (replace(run.motion, tau=run.motion.tau + 100.0) for run in session.runs[2:])
    part = replace(session, runs=tuple(replace(run, motion=m) for run, m in zip(session.runs[2:], louder, strict=True)))
    for joint in asked(effect, session)[:1]:
        for variant in effect.variants(session, joint):
            whole = effect.columns(session, joint, variant)[2:]
            for a, b in zip(whole, effect.columns(part, joint, variant), strict=True):
                np.testing.assert_allclose(b, a, atol=1e-9 * np.abs(a).max(initial=1e-9))


@each_effect
def test_an_arm_that_hardly_moves_shows_little(effect: Effect, still: SessionContext) -> None:
    """At one pose only offsets and pushes can be determined; every other effect says why not."""
    joints = range(still.n if effect.scope == "joint" else 1)
    reasons = [effect.untestable(still, joint) for joint in joints]
    if effect.id in ("torque_offset", "external_contact"):
        assert reasons == [None] * len(reasons)
    else:
        assert all(reasons)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "no such file"),
        ("x = ", "doesn't run"),
        ("x = 1", "no complete effect"),
        (MAGNET.replace('id = "magnet"', "pass"), "no usable id"),
        (MAGNET.replace('"magnet"', '"backlash"'), "is taken"),
        (MAGNET.replace("summary", 'shown_by = "tides"\n    summary'), "'tides', which is no kind of motion"),
        (MAGNET.replace("def columns", "def __init__(self, size): ...\n\n    def columns"), "can't be made"),
    ],
)
def test_a_file_that_holds_no_effect_is_refused(tmp_path: Path, text: str | None, reason: str) -> None:
    """The error names the file and what is wrong with it."""
    path = tmp_path / "own.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=reason):
        load_catalogue(path)


def test_rows_of_the_table_are_effects_and_say_what_effects_have() -> None:
    """Law: every effect has a row and every row an effect; each key is an attribute of `Effect` and is taken over."""
    assert set(TABLE["effects"]) == {effect.id for effect in CATALOGUE}
    for name, row in TABLE["effects"].items():
        effect = find_effect(name)
        for key, value in read_row(name).items():
            assert key in EffectRecord.__annotations__, f"{name}: {key}"
            assert getattr(effect, key) == value
        assert set(row.get("formats", {})) <= {"urdf", "mjcf"}
        assert set(row.get("parted_by", {}).values()) <= set(TABLE["motions"])


def test_an_effect_of_ones_own_is_attributes_and_columns(session: SessionContext) -> None:
    """Law: the same defaults serve a class without a row: figures, their prior, bounds and sentence."""

    class Magnet(Effect):
        id = "magnet"
        figures = ("pull_Nm",)
        prior = ("0.1 rated",)
        bounds: ClassVar = {"pull_Nm": (0.0, "2 coulomb", "magnets are weak")}
        sentence = "take the magnet off {where}: it pulls with {pull_Nm:N m}, {pull_Nm:?up,down}"

        def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Array]:
            return [np.sin(3.0 * run.motion.q[:, [joint]]) for run in session.runs]

    effect, variant = Magnet(), Variant()
    found = effect.parameters(session, 1, variant, np.array([0.5]), np.array([[0.01]]))
    assert found["pull_Nm"].value == 0.5
    assert effect.prior_scale(session, 1, variant) == pytest.approx([0.1 * rated_torque(session, 1)])
    assert effect.physical(session, 1, found)["pull_Nm"].high == pytest.approx(2.0 * friction_level(session, 1)[0])
    assert effect.action("joint_2", found) == "take the magnet off joint_2: it pulls with 0.5 N m [0.304, 0.696], up"


def sharp(**values: float) -> dict[str, Interval]:
    """Figures that are known to a per cent."""
    return {name: Interval(v, v - 0.01 * abs(v) - 1e-9, v + 0.01 * abs(v) + 1e-9) for name, v in values.items()}


def at(effect: Effect, session: SessionContext) -> tuple[Effect, int]:
    """The effect, with a push where it needs one, and the first joint at which it can be tested."""
    if isinstance(effect, ExternalContact):
        effect = replace(effect, pushes=(Push(session.runs[0].motion.name, 0.5, 1.5),))
    joints = range(session.n if effect.scope == "joint" else 1)
    return effect, next(joint for joint in joints if effect.untestable(session, joint) is None)


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.id)
def test_typical_sizes_are_physical(effect: Effect, session: SessionContext) -> None:
    """Law: whatever is of typical size and well known may be named, at every point of the grid."""
    effect, joint = at(effect, session)
    for variant in effect.variants(session, joint):
        scale = effect.prior_scale(session, joint, variant)
        beta = 0.5 * effect.typical.share * scale
        if effect.id == "joint_elasticity":  # the grid goes on to gears that are too soft for this arm
            beta = np.array([1.0 / max(variant.shape["stiffness_Nm_rad"], 20.0 * session.rated_torque[joint])])
        figures = effect.parameters(session, joint, variant, beta, np.diag((1e-3 * beta) ** 2))
        action = effect.action("joint_2", figures)
        assert action[0].islower()
        assert not action.endswith(".")
        assert "[" in action
        assert impossible(effect, session, joint, figures) is None


@pytest.mark.parametrize(
    ("name", "figures", "words"),
    [
        ("payload", {"mass_kg": 0.05, "com_x_m": 12.0, "com_y_m": 0.0, "com_z_m": 0.1}, "com_x_m 12"),
        ("payload", {"mass_kg": 400.0, "com_x_m": 0.0, "com_y_m": 0.0, "com_z_m": 0.1}, "than it weighs"),
        ("spring_torque", {"stiffness_Nm_rad": 0.3, "rest_rad": 26.6}, "rest_rad 26.6"),
        ("spring_torque", {"stiffness_Nm_rad": -0.5, "rest_rad": 0.2}, "away from its rest"),
        ("torque_delay", {"delay_s": 0.3}, "delay_s 0.3"),
        ("torque_delay", {"delay_s": -0.004}, "delay_s -0.004"),
        ("load_dependent_friction", {"mu": 0.8}, "mu 0.8"),
        ("position_dependent_friction", {"amplitude_Nm": 50.0, "order": 1.0, "phase_rad": 0.0}, "would drive"),
        (
            "asymmetric_friction",
            {"coulomb_difference_Nm": 50.0, "viscous_difference_Nms_rad": 0.0},
            "one direction would drive",
        ),
        ("thermal_friction", {"viscous_change": -1.9, "coulomb_change": 0.1}, "viscous_change -1.9"),
        ("presliding_hysteresis", {"amplitude_Nm": 2.0, "displacement_rad": 0.9}, "slip after less"),
        ("joint_elasticity", {"stiffness_Nm_rad": 12.0, "damping_Nms_rad": 1.0}, "fold up"),
        ("joint_elasticity", {"stiffness_Nm_rad": 1e9, "damping_Nms_rad": 1.0}, "as good as rigid"),
        ("gravity_misalignment", {"tilt_x_rad": 1.6, "tilt_y_rad": 0.0}, "turn the arm"),
        ("encoder_offset", {"offset_rad": -1.6}, "another one"),
        ("nonlinear_viscous_friction", {"coefficient": 400.0, "exponent": 0.5}, "its bend takes more"),
        ("torque_gain_error", {"gain": -2.0}, "no torque"),
        (
            "link_inertial_error",
            {
                "mass_change_kg": -40.0,
                "moment_change_x_kgm": 0.0,
                "moment_change_y_kgm": 0.0,
                "moment_change_z_kgm": 0.0,
            },
            "negative",
        ),
    ],
)
def test_what_no_arm_has_is_no_finding(
    name: str, figures: dict[str, float], words: str, session: SessionContext
) -> None:
    """Law: parameters that real recordings once led to, and others like them, name the bound that they break."""
    reason = impossible(find_effect(name), session, 1, sharp(**figures))
    assert words in reason


def test_what_to_do_bears_the_figures() -> None:
    """Law: the sentence names the size with its interval in the units of the cell, whatever its sign."""
    payload = {"mass_kg": Interval(2.64, 2.31, 2.97)}
    assert "2.64 kg [2.31, 2.97]" in find_effect("payload").action("joint_6", payload)
    gain = {"gain": Interval(-0.11, -0.14, -0.08)}
    assert "reads 11 % [8, 14] less than the true torque" in find_effect("torque_gain_error").action("joint_5", gain)
    pushes = replace(find_effect("external_contact"), pushes=(Push("first", 0.5, 1.5), Push("third", 5.0, 6.0)))
    pushed = {"start_s": 5.0, "end_s": 6.0, "force_N": 10.0, "link": 2.0}
    told = pushes.action("joint_2", {name: Interval(one, one, one) for name, one in pushed.items()})
    assert "from 5.0 to 6.0 s on the clock of third" in told  # clocks may restart with each run
    warm = {"viscous_change": Interval(-0.4, -0.5, -0.3), "time_constant_s": Interval(360.0, 200.0, 500.0)}
    assert "12 minutes" in find_effect("thermal_friction").action("joint_2", warm)


def test_friction_may_vary_more_than_there_is_where_it_was_not_seen(session: SessionContext) -> None:
    """Law: a wave of which only a slope was seen may be larger than Coulomb friction; one that was seen whole not."""
    effect = find_effect("position_dependent_friction")
    most = {
        order: effect.physical(session, 0, sharp(amplitude_Nm=1.0, order=order, phase_rad=0.0))["amplitude_Nm"].high
        for order in (0.05, 12.0)
    }
    assert most[0.05] > 10.0 * most[12.0] > 0.0


DEVIATION = np.array([0.5, 2.0])


def normal(coefficients: Array) -> float:
    """Log density of two normal numbers of the deviations above."""
    return float(np.sum(-0.5 * (coefficients / DEVIATION) ** 2 - np.log(DEVIATION * np.sqrt(2 * np.pi))))


def test_a_normal_prior_is_likelier_than_itself_by_nothing() -> None:
    """Law: what a prior adds to a normal of its deviations is nothing if it is that normal, and grows in its tails."""
    rng = np.random.default_rng(3)
    usual = SizePrior(DEVIATION, normal)
    for coefficients in 3.0 * rng.standard_normal((5, 2)):
        assert usual.beyond_normal(coefficients) == pytest.approx(0.0, abs=1e-9)
    tailed = SizePrior.about_zero(DEVIATION)
    steps = [tailed.beyond_normal(far * DEVIATION) for far in (3.0, 5.0, 8.0)]
    assert 0.0 < steps[0] < steps[1] < steps[2]


@each_effect
def test_every_effect_of_the_catalogue_keeps_to_the_laws(effect: Effect, session: SessionContext) -> None:
    """Law: what is asked of a user's effect is asked of each that is built in."""
    if isinstance(effect, ExternalContact):
        effect = replace(effect, pushes=(Push(session.runs[0].motion.name, 0.5, 1.5),))
    check_effect(effect, session)


class Hum(Effect):
    """An effect that keeps to all laws: a wave over the joint's angle."""

    id = "hum"
    figures = ("pull_Nm",)
    prior = ("0.1 rated",)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Array]:
        return [np.sin(3.0 * run.motion.q[:, [joint]]) for run in session.runs]


class Listening(Hum):
    """It looks at the measured torque."""

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Array]:
        return [run.motion.tau[:, [joint]] for run in session.runs]


class Flat(Hum):
    """Its columns have no column."""

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Array]:
        return [run.motion.q[:, joint] for run in session.runs]


class Counting(Hum):
    """Its columns hang on how many runs there are."""

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Array]:
        return [len(session.runs) * run.motion.q[:, [joint]] for run in session.runs]


class Nameless(Hum):
    """Its record names a parameter that nobody reports."""

    defining = ("push_Nm",)


class Misspelt(Hum):
    """A field of its record holds what it can't."""

    scope = "link"  # type: ignore[assignment]


class Loud(Hum):
    """Its sentence is one with a full stop."""

    sentence = "take it off."


def test_a_users_effect_that_keeps_to_the_laws_passes(session: SessionContext) -> None:
    """Law: a class with a record and columns alone is an effect like any other."""
    check_effect(Hum(), session)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Listening, "hang on the measured torque"),
        (Flat, "have shape"),
        (Counting, "change with the runs beside it"),
        (Nameless, "push_Nm"),
        (Misspelt, "scope of Misspelt is 'link'"),
        (Loud, "take it off."),
    ],
)
def test_an_effect_that_breaks_a_law_is_told_which(kind: type[Hum], words: str, session: SessionContext) -> None:
    """Law: the error names the effect and what is wrong with it."""
    with pytest.raises(InputError) as raised:
        check_effect(kind(), session)
    assert words in str(raised.value)
