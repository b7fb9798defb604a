"""A named law is drawn over the data that it explains."""

from __future__ import annotations

from ident.show.report.laws import draw_laws
from tests.ident.diagnosis.planted import analyse, load_arm, stribeck_on_1


def test_friction_is_drawn_over_speed_and_every_finding_has_a_picture() -> None:
    analysis = analyse(load_arm(), stribeck_on_1)
    pictures = draw_laws(analysis)
    assert len(pictures) == len(analysis.diagnosis.findings) > 0
    first = pictures[0]
    assert first is not None
    assert "over its speed" in first.caption
    assert "speed of joint_1 [rad/s]" in first.svg
    assert "friction [N m]" in first.svg
