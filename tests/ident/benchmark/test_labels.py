"""Laws of what counts as right: a load at the flange is what the last link has more of, wherever it shows."""

import pytest

from ident.benchmark.corpus import Truth
from ident.benchmark.labels import Name, says
from ident.benchmark.real_rows import holds

LAST_LINK = Truth("link_inertial_error", True, ("joint_6",), ("joint_6",), also=("payload",))


@pytest.mark.parametrize(
    ("effect", "joint", "shown", "right"),
    [
        ("payload", "", ("joint_2", "joint_3"), True),  # the same torque, which the last joint hardly sees
        ("payload", "", ("joint_6",), True),
        ("link_inertial_error", "joint_6", ("joint_6",), True),
        ("link_inertial_error", "joint_5", ("joint_5",), False),
        ("torque_delay", "", ("joint_6",), False),
    ],
)
def test_a_load_is_the_last_links_wherever_it_shows(
    effect: str, joint: str, shown: tuple[str, ...], right: bool
) -> None:
    """Law: both ways to count agree: that of a diagnosis' candidates and that of findings and changes."""
    candidate = {"effect": effect, "joint": joint, "joints": list(shown)}
    assert says(Name.of_candidate(candidate), LAST_LINK) == right
    planted = {"effect": LAST_LINK.effect, "may_stand_at": ["joint_6"], "also": ["payload"]}
    assert holds({"effect": effect, "joints": list(shown)}, planted) == right
