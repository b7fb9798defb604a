"""Pictures show names as they are written."""

from __future__ import annotations

from ident.show.report.figures import make_panel, to_svg


def test_a_joint_s_name_is_no_formula() -> None:
    """A name with the signs of a formula, which is none that can be set, stands in the picture as it is."""
    name = "a$x^{$b"
    figure, axes = make_panel(f"speed of {name} [rad/s]", name)
    axes.plot([0.0, 1.0], [0.0, 1.0], label=name)
    axes.set_title(name)
    axes.legend()
    assert to_svg(figure, name).count(name) >= 5
