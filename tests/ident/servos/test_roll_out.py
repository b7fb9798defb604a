"""Laws of a servo that rolls out: it goes where the plant of other code goes, from goals alone, and is written so."""

import json
from pathlib import Path

import numpy as np
import pytest

from ident.files import run_python
from ident.recordings.recording import Session
from ident.servos.in_mujoco import roll_out as roll_out_file
from ident.servos.roll_out import SHARED, Drive, ServoModel, fit_servo
from ident.servos.rolled_out import RolledOut, drives_of, roll_out_servos
from ident.servos.servo_files import as_bam, as_mjlab, as_mujoco, write_servos
from tests.ident.servos.servo_plant import GRAVITY, LEVER, MASS, Servo, one_link, record


@pytest.fixture(scope="module")
def drives() -> list[Drive]:
    """Three runs of a servo with a lever, with what the arm says of its load."""
    runs = tuple(record(Servo(), seed, seconds=8.0) for seed in range(3))
    return drives_of([Session("one_gain", runs)], one_link(), 0)


@pytest.fixture(scope="module")
def model(drives: list[Drive]) -> ServoModel:
    """Fitted to two of them by one search."""
    return fit_servo(drives[:2], [5.0], rounds=1)


def test_gravity_is_that_of_the_lever(drives: list[Drive]) -> None:
    """About +y a mass at the end of a lever takes −m g l cos q; it has m l² of inertia."""
    assert np.allclose(drives[0].cosine, -MASS * GRAVITY * LEVER, rtol=1e-3)
    assert np.allclose(drives[0].sine, 0.0, atol=1e-9)
    assert drives[0].inertia == pytest.approx(MASS * LEVER**2, rel=1e-3)


def test_a_load_that_falls_hardly_presses_the_gears() -> None:
    """Friction of more than a load's own torque holds it where the rotor is heavy; a light rotor lets it fall."""
    count = 100
    load = np.full(count, 0.5)
    free = np.zeros(count, dtype=bool)
    drive = Drive("free", 0, np.arange(count) / 50.0, np.zeros(count), np.zeros(count), free, 0.01, load, 0.0 * load)
    travels = []
    for rotor in (1e-3, 0.1):
        shared = {**SHARED, "inertia_kgm2": rotor, "load_friction": 1.2, "friction_Nm": 1e-3, "static_share": 0.0}
        travels.append(float(np.ptp(ServoModel(shared, (1.0,), 0.0).roll_out(drive))))
    assert travels[0] > 1.0
    assert travels[1] == 0.0


def test_a_run_held_back_is_rolled_out_from_its_goals(drives: list[Drive], model: ServoModel) -> None:
    """Half of the error of one who takes the goal for the position is gone; some hundredths of a radian stay."""
    follows = float(np.mean(np.abs(drives[2].goal - drives[2].position)))
    assert model.error([drives[2]]) < min(0.5 * follows, 0.03)


def test_a_roll_out_sees_goals_alone(drives: list[Drive], model: ServoModel) -> None:
    """Other measured positions behind the first one change nothing; a servo that is let go falls."""
    first = drives[0]
    hidden = np.concatenate([first.position[:1], np.full(len(first.position) - 1, 9.0)])
    blind = Drive("blind", 0, first.time, first.goal, hidden, first.driven, first.inertia, first.cosine, first.sine)
    assert np.array_equal(model.roll_out(blind), model.roll_out(first))
    free = np.zeros(len(first.time), dtype=bool)
    loose = Drive("loose", 0, first.time, first.goal, first.position, free, first.inertia, first.cosine, first.sine)
    assert np.abs(model.roll_out(loose) - model.roll_out(first)).max() > 0.3


def test_friction_holds_a_servo_within_its_reach() -> None:
    """A goal that the stiffness turns into less than the friction moves nothing; a larger one does."""
    shared = {**SHARED, "friction_Nm": 0.1, "load_friction": 0.0, "delay_s": 0.0, "dead_band_rad": 0.0}
    servo = ServoModel(shared, (2.0,), 0.0)
    time, zero = np.arange(100) / 50.0, np.zeros(100)
    on = np.ones(100, dtype=bool)
    for goal, moves in ((0.04, False), (0.4, True)):
        drive = Drive("step", 0, time, np.full(100, goal), zero, on, 1e-3, zero, zero)
        assert (np.abs(servo.roll_out(drive)).max() > 0.0) == moves


def test_the_files_hold_the_model(model: ServoModel, tmp_path: Path) -> None:
    """JSON, MuJoCo's position actuator with its limits, and BAM's numbers, which give back back-EMF and limit."""
    one = RolledOut("shoulder", model, 0.01, ("one_gain/run_2",), True)
    folder = write_servos(tmp_path / "servo", [one], ["one_gain"])
    record_ = json.loads((folder / "servo.json").read_text())
    assert record_["joints"]["shoulder"]["shared"] == model.shared
    bam = as_bam("shoulder", model)
    assert bam["kt"] ** 2 / bam["R"] == pytest.approx(model.shared["back_emf_Nms_rad"])
    assert bam["kt"] * bam["volts"] / bam["R"] == pytest.approx(model.shared["limit_Nm"])
    keywords = run_python(folder / "mjlab.py", "mjlab_servo")
    assert keywords.ACTUATORS["shoulder"]["stiffness"] == pytest.approx(model.stiffness[-1])
    assert keywords.lags("shoulder", 1e-3)["delay_max_lag"] == round(1e3 * model.shared["delay_s"])
    mujoco = pytest.importorskip("mujoco")
    text = (folder / "servo.xml").read_text()
    body = '<worldbody><body><joint name="shoulder" class="servo_shoulder"/><geom size="0.1"/></body></worldbody>'
    loaded = mujoco.MjModel.from_xml_string(text.replace("<mujoco>", f"<mujoco>{body}"))
    assert loaded.actuator_gainprm[0, 0] == pytest.approx(model.stiffness[-1], rel=1e-5)
    assert loaded.actuator_forcerange[0, 1] == pytest.approx(model.shared["limit_Nm"], rel=1e-5)
    assert loaded.actuator_delay[0] == pytest.approx(model.shared["delay_s"], rel=1e-5)
    assert loaded.dof_armature[0] == pytest.approx(model.shared["inertia_kgm2"], rel=1e-5)


def test_mujoco_goes_where_the_law_goes_that_its_file_can_hold(drives: list[Drive]) -> None:
    """Without dead band, load friction and larger friction at rest, delay and limit included, within a milliradian."""
    pytest.importorskip("mujoco")
    plain = {**SHARED, "load_friction": 0.0, "dead_band_rad": 0.0, "static_share": 0.0, "delay_s": 0.02}
    servo = ServoModel(plain, (5.0,), 0.01)
    positions = roll_out_file(as_mujoco({"shoulder": servo}), "shoulder", servo.offset, drives[0])
    wanted = servo.roll_out(drives[0])
    assert np.ptp(wanted) > 0.3
    assert np.mean(np.abs(positions - wanted)) < 1e-3


def test_names_of_joints_are_names_in_every_file(model: ServoModel) -> None:
    """What ends a comment, a string or an attribute in one of the files ends nothing there."""
    hostile = 'a--b"c\'<d>\n"""'
    for text in (as_mujoco({hostile: model}), as_mjlab({hostile: model})):
        assert hostile.splitlines()[0] not in text
    compile(as_mjlab({hostile: model}), "mjlab.py", "exec")
    mujoco = pytest.importorskip("mujoco")
    assert mujoco.MjModel.from_xml_string(as_mujoco({}).replace("<actuator>\n  </actuator>", "")).nu == 0


@pytest.mark.parametrize("seconds", [12.0])
def test_one_short_run_of_one_gain_gives_a_model(seconds: float) -> None:
    """Twelve seconds are cut: on the last third both roll-outs are nearer than the goal itself."""
    session = Session("short", (record(Servo(), 4, seconds=seconds),))
    (servo,) = roll_out_servos([session], one_link())
    told = servo.to_dict()["held_back"]
    assert told["mean_absolute_rad"] < told["goal_as_position_rad"]
    assert told["mujoco_rad"] is None or told["mujoco_rad"] < told["goal_as_position_rad"]
