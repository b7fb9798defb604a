"""Figures that no arm has are no finding."""

from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.effects.base import Effect, Interval, SessionContext, impossible, undefined
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.effects.contact import ExternalContact, Push
from ident.effects.intervals import SizePrior


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
        assert undefined(effect, figures) is None
        action = effect.action("joint_2", figures)
        assert action[0].islower()
        assert not action.endswith(".")
        assert "[" in action
        assert impossible(effect, session, joint, figures) is None


@pytest.mark.parametrize("effect", [effect for effect in CATALOGUE if effect.defining], ids=lambda effect: effect.id)
def test_what_may_be_zero_is_no_finding(effect: Effect, session: SessionContext) -> None:
    """Law: coefficients of a tenth of their uncertainty define nothing."""
    effect, joint = at(effect, session)
    variant = effect.variants(session, joint)[0]
    scale = effect.prior_scale(session, joint, variant)
    beta = 1e-3 * scale
    figures = effect.parameters(session, joint, variant, beta, np.diag((10.0 * beta) ** 2))
    reason = undefined(effect, figures)
    assert "holds zero" in reason


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
    """Law: figures that real recordings once led to, and others like them, are reported with the bound they break."""
    reason = impossible(find_effect(name), session, 1, sharp(**figures))
    assert words in reason


def test_what_to_do_bears_the_figures() -> None:
    """Law: the sentence names the size with its interval in the units of the cell, whatever its sign."""
    payload = {"mass_kg": Interval(2.64, 2.31, 2.97)}
    assert "2.64 kg [2.31, 2.97]" in find_effect("payload").action("joint_6", payload)
    gain = {"gain": Interval(-0.11, -0.14, -0.08)}
    assert "reads 11 % [8, 14] too little" in find_effect("torque_gain_error").action("joint_5", gain)
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
    """Log density of two normal figures of the deviations above."""
    return float(np.sum(-0.5 * (coefficients / DEVIATION) ** 2 - np.log(DEVIATION * np.sqrt(2 * np.pi))))


def test_the_cost_is_the_exact_one_where_all_is_normal() -> None:
    """Law: ½ gain − cost is log N(y; 0, s² J² + J) − log N(y; 0, J) of the scores y = J ĉ (Gaussian evidence)."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((2, 2))
    information, estimate = root @ root.T + 0.2 * np.eye(2), np.array([0.7, -1.2])
    scores = information @ estimate
    spread = information + information @ np.diag(DEVIATION**2) @ information
    exact = 0.5 * scores @ np.linalg.solve(information, scores) - 0.5 * scores @ np.linalg.solve(spread, scores)
    exact -= 0.5 * (np.linalg.slogdet(spread)[1] - np.linalg.slogdet(information)[1])
    cost = SizePrior(DEVIATION, normal).cost(estimate, information)
    assert 0.5 * estimate @ information @ estimate - cost == pytest.approx(exact, abs=1e-9)
