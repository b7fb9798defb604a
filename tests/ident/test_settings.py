"""Numbers that decide say what they are, and can't be misspelt."""

from dataclasses import FrozenInstanceError, fields

import pytest

from ident.checks import settings as checks
from ident.checks.conventions import settings as conventions
from ident.diagnosis import settings as diagnosis
from ident.diagnosis.change import settings as change
from ident.diagnosis.gap import settings as gap
from ident.effects import settings as effects
from ident.infer import settings as infer
from ident.inference import settings as inference
from ident.monitor import settings as monitor
from ident.motion import settings as motion
from ident.records import Numbers
from ident.regression import settings as regression
from ident.servos import settings as servos
from ident.simulation.causes import settings as causes

MODULES = (
    *(causes, change, checks, conventions, diagnosis, effects, gap),
    *(infer, inference, monitor, motion, regression, servos),
)


def is_group(value: object) -> bool:
    """Whether a value of a module is numbers, and not several groups of them."""
    if not isinstance(value, Numbers):
        return False
    return not any(isinstance(getattr(value, field.name), Numbers) for field in fields(value))


GROUPS = [group for module in MODULES for group in vars(module).values() if is_group(group)]
each_group = pytest.mark.parametrize("group", GROUPS, ids=lambda group: type(group).__name__)


@each_group
def test_every_number_has_a_unit_a_meaning_and_a_source(group: Numbers) -> None:
    rows = group.describe()
    assert [row["name"] for row in rows] == [field.name for field in fields(group)]
    for row in rows:
        assert row["unit"]
        assert row["meaning"]
        assert row["source"]


@each_group
def test_a_number_is_of_the_kind_that_its_field_says(group: Numbers) -> None:
    """Law: a number is a number, a list a tuple; nothing that could be changed by chance."""
    for field in fields(group):
        kind = str(field.type).partition("[")[0]
        assert type(getattr(group, field.name)).__name__ == kind, field.name


def test_a_name_misspelt_is_an_error() -> None:
    """Law: neither reading nor replacing a number that there is not goes by in silence."""
    with pytest.raises(AttributeError):
        _ = motion.USUAL_MOTION.cutof_hz  # type: ignore[attr-defined]
    with pytest.raises(TypeError):
        motion.USUAL_MOTION.but(cutof_hz=1.0)


def test_numbers_stay_as_they_are() -> None:
    with pytest.raises(FrozenInstanceError):
        motion.USUAL_MOTION.cutoff_hz = 1.0  # type: ignore[misc]


def test_a_diagnosis_differs_from_a_fit_in_what_it_states() -> None:
    told = {row["name"]: row["meaning"] for row in motion.FOR_DIAGNOSIS.describe()}
    assert told["cutoff_hz"] == "corner of the common filter of a diagnosis"
    assert motion.FOR_DIAGNOSIS.guard == motion.USUAL_MOTION.guard
