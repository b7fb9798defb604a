"""Laws of the self-test of one's own effect: what is planted large enough is found where it was planted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ident import Effect, InputError, plant
from ident.robot.names import data_path

E1 = data_path("logs/tm5_900/E1")


class Magnet(Effect):
    """tau = A sin 3q: what nothing of the catalogue is at this joint."""

    id = "magnet"
    figures = ("amplitude_Nm",)
    prior = ("2 coulomb",)

    def columns(self, session: Any, joint: int, variant: Any) -> list[Any]:
        return [np.sin(3 * run.motion.q[:, [joint]]) for run in session.runs]


def test_what_is_planted_is_found_at_its_joint_and_as_large() -> None:
    planted = plant(Magnet(), "joint_2", E1, coefficients=[6.0])
    assert planted.found, planted
    assert planted.joint == "joint_2"
    (finding,) = (one for one in planted.diagnosis.findings if one.effect == "magnet")
    assert finding.estimate.parameters["amplitude_Nm"].value == pytest.approx(6.0, rel=0.15)


def test_nothing_planted_is_not_found() -> None:
    assert not plant(Magnet(), "joint_2", E1, coefficients=[0.0]).found


def test_a_joint_that_is_not_there_is_one_line() -> None:
    with pytest.raises(InputError, match="joint_2"):
        plant(Magnet(), "elbow", E1)
