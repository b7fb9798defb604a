"""Laws of runs foretold by one another: a fit among what joints feel is the fit among all inertial numbers."""

import numpy as np

from ident.arrays import Array, Float
from ident.checks.foretold import fit, fits_among
from ident.checks.parting import ComparedRuns
from ident.recordings.load import load_session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.robot.tolerance import PRIOR_SHARE, parameter_scale

LOSSES_AND_TORQUE = 5


def compared_runs() -> ComparedRuns:
    """The first four shipped runs."""
    session = load_session(data_path("logs/tm5_900/T1"))
    return ComparedRuns(session.replace(runs=session.runs[:4]), ArmModel.load("tm5-900"))


def mean_of_all_numbers(compared: ComparedRuns) -> Float[Array, "n c c"]:
    """Mean inner products of all scaled inertial numbers' columns, losses and torque."""
    arm = compared.arm
    scale = PRIOR_SHARE["consistent"] * parameter_scale(arm)
    sums = []
    for run in compared.runs:
        numbers = (arm.regressor(run.q, run.dq, run.ddq) * scale).transpose(1, 0, 2)
        others = compared.tables.table(run)[:, :, -LOSSES_AND_TORQUE:]
        table = np.concatenate([numbers, others], axis=-1) * run.moves.T[:, :, None]
        count = np.maximum(run.moves.sum(axis=0), 1)
        sums.append(table.transpose(0, 2, 1) @ table / count[:, None, None])
    return np.mean(sums, axis=0)


def test_felt_directions_say_all_that_the_inertial_numbers_say() -> None:
    compared = compared_runs()
    fitted = fit(compared.sums.mean(axis=0), len(compared.runs))
    whole = mean_of_all_numbers(compared)
    among_all = fit(whole, len(compared.runs))
    assert fitted.coefficients.shape[1] < among_all.coefficients.shape[1]
    losses = slice(-LOSSES_AND_TORQUE + 1, None)
    np.testing.assert_allclose(fitted.coefficients[:, losses], among_all.coefficients[:, losses], rtol=1e-6, atol=1e-9)
    mean = compared.sums.mean(axis=0)
    np.testing.assert_allclose(fitted.open_square(mean), among_all.open_square(whole), rtol=1e-6)


def test_fits_side_by_side_are_the_fits_one_by_one() -> None:
    sums = compared_runs().sums
    among = fits_among(sums)
    for number in range(len(sums)):
        others = np.delete(sums, number, axis=0)
        alone = fit(others.mean(axis=0), len(others))
        np.testing.assert_allclose(among.coefficients[number], alone.coefficients, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(among.open_square(sums)[number], alone.open_square(sums[number]), rtol=1e-6)
