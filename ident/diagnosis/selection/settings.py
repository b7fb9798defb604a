"""The numbers by which effects are selected."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number


@dataclass(frozen=True)
class SelectionSettings(Settings, table="selection"):
    """Tests, sizes and evidence that a name needs; each field's metadata hold `unit`, `meaning` and `source`."""

    family_error: float = number()
    slow_error: float = number()
    foretold_fall: float = number()
    flips: int = number()
    voices: int = number()
    least_rms_fall: float = number()
    least_gap_fall: float = number()
    least_own_share: float = number()
    most_effects: int = number()
    most_uneven: float = number()
    uneven_chance: float = number()
    absorbed_below: float = number()
    absorbed_ratio: float = number()
    absorbed_nats: float = number()
    fixed_factor: float = number()
    event_nats: float = number()
    event_gap_fall: float = number()
    burst_nats: float = number()
    essential_nats: float = number()
    unlikely: float = number()
    unlikely_nats: float = number()
    least_hint_fall: float = number()
    shortlist: int = number()
    steady_points: int = number()
    polish_rounds: int = number()
    refine_rounds: int = number()
    most_settling: int = number()
    settled_share: float = number()
    interval_fall: float = number()
    class_odds: float = number()
    rival_nats: float = number()
    temper: float = number()
    most_sure: float = number()
    least_probability: float = number()
    most_doubted: int = number()
    least_informed: float = number()
    most_likely: float = number()
    far_deviations: float = number()
    urdf_scales: tuple[float, ...] = number()
    usual_urdf_factor: float = number()
    urdf_com_m: tuple[float, ...] = number()
    usual_urdf_com_m: float = number()
    inertial_odds: float = number()
    wrong_link_factor: float = number()
    wrong_link_nats: float = number()
    wrong_link_trust: float = number()


USUAL_SELECTION = SelectionSettings()
