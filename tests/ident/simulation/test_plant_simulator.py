"""Laws of the closed loop: rest to rest, within limits, repeatable."""

import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from ident.errors import InputError
from ident.model.bodies import is_consistent, pseudo_inertia
from ident.model.link_inertia import read_inertial
from ident.recordings.load import load_session
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.simulation import visible_rows
from ident.simulation.causes import CATALOGUE, OUTSIDE, Circumstances, find_cause
from ident.simulation.hardware import DECOYS, with_possible_bodies, without_geometry
from ident.simulation.request import (
    ENVELOPE_NAME,
    Answer,
    EffectRequest,
    TrueEffect,
    find_joint,
    open_envelope,
    parse_effect,
    parse_payload,
    seal,
)
from ident.simulation.simulate import SimulationOptions, simulate, simulate_to, write_simulation
from ident.simulation.simulator import Simulator, choose_step
from ident.simulation.visibility import VisibilityMeter
from ident.trajectories.kinds import plan_motions
from logs.make import sealed_key

SHORT = SimulationOptions(motions=("spline", "chirp"), runs=3, duration=2.5, rate=100.0, seed=5, temperature=True)


@pytest.fixture(scope="module")
def short():
    return simulate(SHORT)


def test_the_arm_follows_and_starts_and_ends_at_rest(hardware):
    motions = plan_motions(hardware.arm, ["spline", "fourier"], 3, 3.0, np.random.default_rng(0))
    traces = Simulator(hardware, np.random.default_rng(1)).run(motions, [0.0, 2.0, 2.0], lambda: None)
    for trace in traces:
        error = np.abs(trace.log.angle - trace.motion.q)
        assert error.max() < 0.02
        for edge in (slice(0, 100), slice(-100, None)):
            assert np.abs(trace.log.speed[edge]).max() < 5e-3
        # No start-up transient: the first torque is what holds the arm, up to friction.
        holding = hardware.arm.gravity(trace.log.angle[:1])[0]
        assert (np.abs(trace.log.torque[0] - holding) < 1.2 * hardware.friction.coulomb + 5.0).all()


def test_a_seed_repeats_bit_for_bit(short):
    again = simulate(SHORT)
    for one, other in zip(short.session.runs, again.session.runs, strict=True):
        for name, values in one.channels().items():
            assert values.tobytes() == getattr(other, name).tobytes(), name
        assert one.time.tobytes() == other.time.tobytes()
    assert again.answer == short.answer


def test_channels_are_optional():
    bare = SimulationOptions(
        motions=("spline",), runs=1, duration=2.0, rate=50.0, velocity=False, commands=False, temperature=False
    )
    assert set(simulate(bare).session.runs[0].channels()) == {"position", "effort"}


def test_friction_varies_by_a_per_cent_from_run_to_run(hardware):
    varied = hardware.replace(friction_spread=0.01)
    motion = plan_motions(hardware.arm, ["spline"], 1, 2.0, np.random.default_rng(0))[0]
    traces = Simulator(varied, np.random.default_rng(1)).run([motion] * 6, [1.0] * 6, lambda: None)
    moving = np.abs(motion.dq[:, 0]) > 0.2
    levels = [np.abs(trace.log.torque[moving, 0]).mean() for trace in traces]
    assert 0.001 < np.std(levels) / np.mean(levels) < 0.03


def test_a_path_of_friction_lies_beside_its_spread(hardware):
    """Law: a cause that acts from a run on takes nothing of what friction varies by from run to run."""
    varied = hardware.replace(friction_spread=0.01)
    rising = varied.replace(friction_path=np.array([np.full((2, hardware.n), factor) for factor in (1.0, 1.8)]))
    without, beside = (Simulator(h, np.random.default_rng(1)) for h in (varied, rising))
    for run, factor in enumerate((1.0, 1.8)):
        plain = without._laws(run).friction["coulomb"]
        assert np.ptp(plain / hardware.friction["coulomb"]) > 0.0
        np.testing.assert_allclose(beside._laws(run).friction["coulomb"], factor * plain)


def test_a_healthy_arm_is_rigid_body_plus_linear_friction(hardware, monkeypatch):
    """Once the bristles have slipped, nothing is left that the ordinary model can't explain: no delay, no bias."""
    monkeypatch.setattr(visible_rows, "STILL_RAD_S", 0.15)
    # It would carry reversals over to where all slides.
    monkeypatch.setattr(visible_rows, "_slow", lambda values: values)
    motions = plan_motions(hardware.arm, ["fourier", "chirp"], 2, 5.0, np.random.default_rng(0))
    silent = hardware.replace(sensing=hardware.sensing.silent())
    traces = Simulator(silent, np.random.default_rng(0)).run(motions, [1.0, 1.0], lambda: None)
    rows = visible_rows.gather(hardware, traces, "refit")
    rest = np.abs(visible_rows.remainder(rows)).max(axis=0)
    assert (rest < 0.05 * hardware.sensing.noise_floor).all()


def test_stiff_springs_get_small_steps(hardware):
    assert choose_step(hardware) == 5e-4
    soft = hardware.with_laws("drive", 1, elastic=True, stiffness=2e4)
    stiff = hardware.with_laws("drive", 5, elastic=True, stiffness=9e4)
    assert choose_step(stiff) < choose_step(soft) < 5e-4
    assert choose_step(stiff) < choose_step(stiff, coarse=True)


def test_a_diverging_plant_is_refused(hardware, tmp_path, monkeypatch, capfd):
    """In one message: nothing stands on standard error, and no file is left."""
    monkeypatch.chdir(tmp_path)
    broken = hardware.with_laws("drive", 1, hose_stiffness=1e9)
    motion = plan_motions(hardware.arm, ["spline"], 1, 2.0, np.random.default_rng(0))
    with pytest.raises(InputError, match="diverged"):
        Simulator(broken, np.random.default_rng(1)).run(motion, [0.0], lambda: None)
    assert not list(tmp_path.iterdir())
    assert not capfd.readouterr().err


def test_a_load_that_the_arm_drops_is_refused(hardware):
    """A joint whose motor is far too weak falls away from its motion: no controller would go on."""
    weak = hardware.with_laws("drive", 1, effort_limit=1.0)
    motion = plan_motions(hardware.arm, ["spline"], 1, 2.0, np.random.default_rng(0))
    with pytest.raises(InputError, match="can't follow"):
        Simulator(weak, np.random.default_rng(1)).run(motion, [0.0], lambda: None)


TINY = SimulationOptions(motions=("spline",), runs=2, duration=2.0, rate=50.0)
ANSWER = Answer(
    "tm5-900", 3, (TrueEffect("payload", True, (), 1.0, "mass_kg", {"mass_kg": 1.0}),), ("inertia",), {"joint_1": 0.4}
)


@pytest.fixture(scope="module")
def motions(arm):
    return plan_motions(arm, ["fourier"], 2, 3.0, np.random.default_rng(1))


@pytest.mark.parametrize("effect", [*CATALOGUE, *OUTSIDE])
def test_every_effect_runs_at_every_joint_and_changes_the_recording(hardware, motions, effect):
    """Typical sizes are physical, simulable and visible at one joint or another."""
    meter = VisibilityMeter(hardware, motions, [1.0, 1.0], 0)
    cause = find_cause(effect)
    for joint in (0, 2, 5) if not cause.whole_arm else (5,):
        scene = Circumstances(hardware, joint, motions, np.random.default_rng(2))
        size = cause.checked(scene, cause.typical(scene))
        changed, parameters = cause.apply(scene, size)
        assert changed is not hardware
        assert all(isinstance(value, str) or math.isfinite(value) for value in parameters.values())
    scene = Circumstances(hardware, 2, motions, np.random.default_rng(2))
    assert meter.measure(cause, scene, cause.typical(scene), 2).max() > 1e-3


def test_an_amplitude_beyond_physics_is_refused(hardware, motions):
    """Joint 1 is vertical: no encoder offset there shows in gravity, the torque does not depend on it."""
    meter = VisibilityMeter(hardware, motions, [1.0, 1.0], 0)
    cause = find_cause("encoder_offset")
    scene = Circumstances(hardware, 0, motions, np.random.default_rng(2))
    with pytest.raises(InputError, match="can't be reached"):
        meter.find_size(cause, scene, 50.0, seed=2)


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ("rust:joint_1:1", "stribeck_friction"),
        ("payload:-1", "between 0 and"),
        ("torque_delay:100", "between 0 and"),
        ("link_inertial_error:joint_2:-0.9", "between -0.6 and"),
        ("joint_elasticity:joint_2:-5", "between"),
        ("stribeck_friction:joint_9:1", "joint_1, joint_2"),
        ("stribeck_friction:7:1", "joint_1, joint_2"),
        ("stribeck_friction", "joint_1, joint_2"),
        ("stribeck_friction:joint_1:much", "is not a size"),
        ("stribeck_friction:joint_1:nan", "is not a size"),
        ("stribeck_friction:joint_1:0x", "more than 0x"),
        ("stribeck_friction:joint_1:1:2", "ID:JOINT:SIZE"),
    ],
)
def test_bad_effects_are_refused_with_what_is_valid(effect, expected):
    with pytest.raises(InputError) as caught:
        simulate(replace(TINY, effects=(effect,)))
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate", 0.0),
        ("rate", 1e5),
        ("decoys", ("swan",)),
        ("pause", (5.0, 1.0)),
        ("payload", Payload(-1.0)),
        ("inertia_error", 0.9),
        ("noise", -1.0),
        ("seed", -1),
        ("friction_factors", (1.0, 0.0)),
        ("robot", "r2d2"),
    ],
)
def test_bad_options_are_refused(name, value):
    with pytest.raises(InputError):
        simulate(replace(TINY, **{name: value}))


def test_effects_are_read_from_text(arm):
    assert parse_effect("payload:1.5") == EffectRequest("payload", "", 1.5)
    assert parse_effect("torque_delay::3x") == EffectRequest("torque_delay", "", None, 3.0)
    assert parse_effect("backlash:joint_2") == EffectRequest("backlash", "joint_2")
    assert find_joint(parse_effect("backlash:3:1e-3"), arm) == 2
    assert parse_payload("0.5@0,0.01,0.03") == Payload(0.5, (0.0, 0.01, 0.03))
    with pytest.raises(InputError):
        parse_payload("heavy")


@pytest.fixture(scope="module")
def plain():
    return simulate(TINY)


@pytest.mark.parametrize("decoy", DECOYS)
def test_decoys_change_the_arm_but_name_no_effect(plain, decoy):
    changed = simulate(replace(TINY, decoys=(decoy,)))
    assert changed.answer.effects == ()
    assert changed.answer.decoys == (decoy,)
    assert not np.array_equal(plain.session.runs[0].effort, changed.session.runs[0].effort)


def test_a_known_payload_is_told_and_carried():
    result = simulate(replace(TINY, payload=Payload(1.0, (0.0, 0.0, 0.04))))
    assert (result.session.payload, result.answer.effects) == (Payload(1.0, (0.0, 0.0, 0.04)), ())
    assert result.hardware.bodies.added[0].mass == 1.0


def test_the_folder_is_a_session_and_tells_nothing(tmp_path):
    options = replace(TINY, effects=("payload:1.2",))
    calls = []
    written = simulate_to(tmp_path / "s", options, progress=lambda: calls.append(1))
    assert len(calls) == written.runs == 2
    session = load_session(tmp_path / "s")
    assert session.robot == "tm5-900"
    assert session.samples == written.samples
    assert sorted(path.suffix for path in (tmp_path / "s").iterdir()) == [".json", ".parquet", ".parquet", ".toml"]
    assert "payload" not in (tmp_path / "s/session.toml").read_text()


def test_the_answer_is_written_on_request(tmp_path):
    options = replace(TINY, effects=("payload:1.2",))
    simulation = simulate(options)
    write_simulation(simulation, tmp_path / "s", answer=True)
    assert Answer.from_dict(json.loads((tmp_path / "s/answer.json").read_text())) == simulation.answer
    with pytest.raises(InputError, match="--sealed"):
        write_simulation(simulation, tmp_path / "s", answer=True, sealed=True)


def test_an_envelope_opens_with_its_key_only(tmp_path):
    """Nothing leaks by length either: one effect or none, the envelope is as long."""
    key, file = b"a secret of some length", tmp_path / ENVELOPE_NAME
    seal(Answer("tm5-900", 3, (), (), {}), tmp_path, b"key")
    length = file.stat().st_size
    assert len(seal(ANSWER, tmp_path, key)) == 64
    assert file.stat().st_size == length
    assert "payload" not in file.read_text()
    assert open_envelope(tmp_path, key) == ANSWER
    with pytest.raises(InputError, match="key"):
        open_envelope(tmp_path, b"another")
    envelope = json.loads(file.read_text())
    file.write_text(json.dumps({**envelope, "text": "00" + envelope["text"][2:]}))
    with pytest.raises(InputError, match="changed"):
        open_envelope(tmp_path, key)


def test_shipped_envelopes_open():
    """The answer of each shipped sealed session is one effect of the catalogue."""
    for name in ("sealed_1", "sealed_2", "sealed_3"):
        (effect,) = open_envelope(data_path(f"logs/tm5_900/{name}"), sealed_key(name)).effects
        assert effect.effect in CATALOGUE


@pytest.mark.parametrize("robot", ["pr2:r_wrist_roll_joint", "b1-z1"])
def test_links_that_no_body_could_be_do_not_stop_the_plant(robot: str) -> None:
    """Law: only such links change, each to a body of the same mass and centre; the arm moves."""
    options = SimulationOptions(robot=robot, motions=("spline",), runs=1, duration=1.0, rate=50.0)
    urdf = without_geometry(ArmModel.load(robot).urdf)
    links = zip(*(ET.fromstring(text).iter("link") for text in (urdf, with_possible_bodies(urdf))), strict=True)
    changed = 0
    for before, after in links:
        given, possible = read_inertial(before), read_inertial(after)
        np.testing.assert_allclose(possible[:4], given[:4], atol=1e-12)
        if not np.allclose(possible, given, rtol=1e-12, atol=0.0):
            changed += 1
            assert not is_consistent(given) or np.linalg.matrix_rank(pseudo_inertia(given), tol=1e-9) < 4
        assert given[0] <= 0.0 or is_consistent(possible)
    assert changed
    assert np.isfinite(simulate(options).session.runs[0].effort).all()
