"""Laws of couplings that a fit looks for by itself: found where they are, at no arm without one."""

from collections.abc import Callable

import numpy as np
import pytest

from ident.arrays import Array
from ident.command_options import FitOptions
from ident.fitting.coupling import find_coupling
from ident.fitting.fit import fit_hybrid
from ident.robot.arm import ArmModel
from ident.show.results import describe_fit
from tests.ident.model.test_choice import loaded, made_runs, nothing

COULOMB, VISCOUS, INERTIA = 2.0, 0.5, 0.1
Further = Callable[[Array, Array, Array, Array], Array]


def coupled_by(mix: float) -> Further:
    """What a shaft does to both joints that turns by their sum, or by their difference."""

    def further(q: Array, dq: Array, ddq: Array, rigid: Array) -> Array:
        columns = []
        for own, other in ((0, 1), (1, 0)):
            turning = np.tanh((dq[:, own] + mix * dq[:, other]) / 0.02)
            columns.append(COULOMB * turning + VISCOUS * dq[:, other] + INERTIA * ddq[:, other])
        return np.column_stack(columns)

    return further


@pytest.mark.parametrize("mix", [1.0, -1.0])
def test_a_coupling_is_found_without_being_asked_for(two_joints: ArmModel, mix: float) -> None:
    """Both joints have it, with its sign and its friction."""
    found = find_coupling(made_runs(two_joints, coupled_by(mix)), two_joints)
    assert sorted(one.joint for one in found) == [0, 1]
    for effect in found:
        assert effect.effect == "joint_coupling"
        assert effect.parameters["mix"] == mix
        assert effect.parameters["coulomb_Nm"] == pytest.approx(COULOMB, abs=0.15)
        assert effect.parameters["viscous_Nms_rad"] == pytest.approx(VISCOUS, abs=0.1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("further", [nothing, loaded])
def test_an_arm_without_a_coupling_is_given_none(two_joints: ArmModel, further: Further, seed: int) -> None:
    """Neither plain losses nor friction that grows with load are taken for one."""
    assert find_coupling(made_runs(two_joints, further, seed=seed), two_joints) == ()


def test_one_line_tells_of_a_coupling_and_none_leaves_it_out(two_joints: ArmModel) -> None:
    """A fit that took one by itself says so; with `none` held-out torque is worse."""
    runs = made_runs(two_joints, coupled_by(1.0))
    taken = fit_hybrid(runs[:4], two_joints, FitOptions(net="none"))
    told = [line for line in describe_fit(taken) if "turn each other" in line]
    assert len(told) == 1
    assert "joint_1 and joint_2" in told[0]
    without = fit_hybrid(runs[:4], two_joints, FitOptions(net="none", coupling="none"))
    assert without.model.carried == ()
    errors = []
    for fitted in (taken, without):
        left = runs[4].filtered(fitted.model.torque(runs[4].q, runs[4].dq, runs[4].ddq) - runs[4].tau)
        errors.append(float(np.sqrt(np.mean(left[runs[4].moving] ** 2))))
    assert errors[0] < 0.5 * errors[1]
