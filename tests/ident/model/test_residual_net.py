"""Laws of the residual net, and of the nets of single joints that it is made of."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from ident.arrays import Array
from ident.errors import ModelError
from ident.model import residual_net
from ident.model.dense_training import DenseNet
from ident.model.joint_nets import JointNets, width_of
from ident.model.net_gate import describe_gate, shrink_net
from ident.model.random_features import solve_net
from ident.model.residual_net import (
    PRESETS,
    NetOptions,
    ResidualNet,
    Unexplained,
    fit_net_of_arm,
    fit_residual_net,
)
from ident.motion import stretches
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions, multisine, two_joint_arm

DEFAULT = PRESETS["default"]
# A paper net small enough for a test: the same kind, dropout included.
DENSE = replace(PRESETS["paper"], hidden=(16, 16), epochs=6)
State = tuple[Array, Array, Array, Array]


def _states(seed: int, samples: int = 1000, arm: ArmModel | None = None) -> State:
    arm = arm or two_joint_arm()
    time = np.arange(samples) / 50.0
    q, dq, ddq = multisine(np.random.default_rng(seed), time, arm.n)
    return q, dq, ddq, arm.inverse_dynamics(q, dq, ddq)


def _stribeck(state: State) -> Array:
    """A friction law that no loss figure can follow: a bump at low speed, growing with the load [N m]."""
    _, dq, _, rigid = state
    return (3.0 + 0.05 * np.abs(rigid)) * np.tanh(dq / 0.02) * np.exp(-((dq / 0.4) ** 2))


def _weights(net: ResidualNet) -> dict[str, Array]:
    return net.network.arrays()


def _same(a: ResidualNet, b: ResidualNet) -> bool:
    ours, theirs = _weights(a), _weights(b)
    return ours.keys() == theirs.keys() and all(np.array_equal(ours[name], theirs[name]) for name in ours)


def test_paper_preset_is_the_papers_net() -> None:
    """Layers 256-512-1024-512-256 tanh, dropout 0.5, Adam without decay, 100 epochs, 70/30; 1.32 M weights for three
    joints, and a linear output.
    """
    options = PRESETS["paper"]
    net = DenseNet(9, 3, options.hidden, options.dropout)
    linear = [module for module in net.stack if isinstance(module, torch.nn.Linear)]
    assert [layer.out_features for layer in linear] == [256, 512, 1024, 512, 256, 3]
    assert linear[0].in_features == 9
    assert [module.p for module in net.stack if isinstance(module, torch.nn.Dropout)] == [0.5] * 5
    assert sum(isinstance(module, torch.nn.Tanh) for module in net.stack) == 5
    assert isinstance(net.stack[-1], torch.nn.Linear)
    assert sum(weight.numel() for weight in net.parameters()) == pytest.approx(1.32e6, rel=0.005)
    assert (options.epochs, options.validation_share) == (100, 0.3)


@pytest.mark.parametrize("options", [DEFAULT, DENSE], ids=["default", "paper"])
def test_same_seed_same_weights(options: NetOptions) -> None:
    """Two trainings of one seed agree bit for bit, another seed does not, and the global generators are untouched."""
    state = _states(2)
    torch.manual_seed(123)
    before = torch.random.get_rng_state()
    first, second = (fit_residual_net([state], [_stribeck(state)], options=options) for _ in range(2))
    assert torch.equal(torch.random.get_rng_state(), before)
    assert _same(first, second)
    assert not _same(first, fit_residual_net([state], [_stribeck(state)], options=replace(options, seed=1)))


class _Interrupted(Exception):
    """Stands for Ctrl-C."""


def test_a_resumed_training_is_the_uninterrupted_one(tmp_path: Path) -> None:
    """Stopped after epoch 13 and started again, the training goes on from epoch 10's checkpoint to the same weights,
    bit for bit.
    """
    state, options = _states(3), replace(DENSE, epochs=15)
    whole = fit_residual_net([state], [_stribeck(state)], options=options)

    def stop(epoch: int, epochs: int, error: float) -> None:
        if epoch == 13:
            raise _Interrupted

    with pytest.raises(_Interrupted):
        fit_residual_net([state], [_stribeck(state)], options=options, progress=stop, checkpoint=tmp_path)
    seen: list[int] = []
    resumed = fit_residual_net(
        [state],
        [_stribeck(state)],
        options=options,
        progress=lambda epoch, *_: seen.append(epoch),
        checkpoint=tmp_path,
    )
    assert seen[0] == 11
    assert _same(resumed, whole)


def test_a_checkpoint_of_other_data_or_options_is_not_taken_up(tmp_path: Path) -> None:
    """The checkpoint belongs to one training; another one starts at the beginning, and so does a damaged file."""
    state, options = _states(4), replace(DENSE, epochs=10)
    fit_residual_net([state], [_stribeck(state)], options=options, checkpoint=tmp_path)
    for changed, target in ((replace(options, seed=5), _stribeck(state)), (options, _stribeck(state) + 1.0)):
        seen: list[int] = []
        fit_residual_net(
            [state],
            [target],
            options=changed,
            progress=lambda epoch, *_, seen=seen: seen.append(epoch),
            checkpoint=tmp_path,
        )
        assert seen[0] == 1
    (tmp_path / "checkpoint.safetensors").write_bytes(b"half a file")
    again = fit_residual_net([state], [_stribeck(state)], options=options, checkpoint=tmp_path)
    assert _same(again, fit_residual_net([state], [_stribeck(state)], options=options))


@pytest.mark.parametrize("options", [DEFAULT, DENSE], ids=["default", "paper"])
def test_a_saved_net_is_the_same_net_without_pickle(options: NetOptions, tmp_path: Path) -> None:
    """Loaded predictions equal to the last bit; the folder holds JSON and safetensors, no file a pickle or a zip."""
    state = _states(5)
    net = fit_residual_net([state], [_stribeck(state)], options=options, checkpoint=tmp_path)
    net.save(tmp_path)
    loaded = ResidualNet.load(tmp_path)
    assert np.array_equal(loaded.predict(*state), net.predict(*state))
    assert loaded.options == net.options
    assert loaded.parameters == net.parameters
    files = [path for path in tmp_path.iterdir() if path.is_file()]
    assert {path.name for path in files} >= {"residual.json", "residual.safetensors"}
    for path in files:
        assert path.suffix in (".json", ".safetensors")
        assert not path.read_bytes().startswith((b"\x80", b"PK"))
    assert json.loads((tmp_path / "residual.json").read_text())["options"]["preset"] == options.preset


def _spoilt(name: str, value: object) -> Callable[[Path], object]:
    """The net's record with another entry; a number is added to all of an entry's."""

    def change(folder: Path) -> None:
        record = json.loads((folder / "residual.json").read_text())
        number = isinstance(value, float)
        entry = (np.zeros_like(np.array(record[name])) + value).tolist() if number else value
        low = {**record["bounds"], "low": value}
        spoilt = {**record, **({"bounds": low} if name == "low" else {name: entry})}
        (folder / "residual.json").write_text(json.dumps(spoilt))

    return change


DAMAGES: list[tuple[Callable[[Path], object], str]] = [
    # Of another shape, or beyond what single precision holds: told when read, not when torque is asked for.
    *((_spoilt("input_std", [[]]), "scale"), (_spoilt("input_mean", [[0.0] * 6] * 9), "scale")),
    *((_spoilt("output_std", 1e308), "scale"), (_spoilt("input_mean", 1e308), "scale")),
    # Bounds of another shape, no numbers, or the lower above the upper.
    *((_spoilt("low", edge), "bound") for edge in ([[0.0] * 2] * 2, [[math.nan] * 2] * 3, [[9e9] * 2] * 3)),
    # A missing, cut or foreign file.
    (lambda folder: (folder / "residual.json").write_bytes(b"{"), ""),
    (lambda folder: (folder / "residual.json").write_bytes(b"[]"), ""),
    (lambda folder: (folder / "residual.json").write_bytes(b'{"options": {"preset": "default", "colour": 1}}'), ""),
    (lambda folder: (folder / "residual.safetensors").write_bytes(b"not weights"), ""),
    (lambda folder: save_file({"weights.0": np.zeros((2, 6, 3))}, folder / "residual.safetensors"), "its weights are"),
    (lambda folder: (folder / "residual.json").unlink(), ""),
    (lambda folder: (folder / "residual.safetensors").unlink(), ""),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "words"), DAMAGES)
def test_a_damaged_net_is_a_model_error(damage: Callable[[Path], object], words: str, tmp_path: Path) -> None:
    """The error says what is wrong and the remedy."""
    state = _states(6, 200)
    fit_residual_net([state], [_stribeck(state)], options=DEFAULT).save(tmp_path)
    damage(tmp_path)
    with pytest.raises(ModelError, match=f"{words}.*; fit the model again"):
        ResidualNet.load(tmp_path)


def test_a_friction_law_is_learnt() -> None:
    """On an unseen motion the default net takes away at least 90 % of the mean square of a Stribeck bump that grows
    with the load, measured with a tenth of its size in noise.
    """
    rng, train = np.random.default_rng(7), [_states(seed, 1500) for seed in (10, 11, 12)]
    noise = [0.1 * np.std(_stribeck(state)) * rng.standard_normal(state[0].shape) for state in train]
    targets = [_stribeck(state) + n for state, n in zip(train, noise, strict=True)]
    net = fit_residual_net(train, targets)
    test = _states(13)
    left = _stribeck(test) - net.predict(*test)
    assert np.all(np.mean(left**2, axis=0) < 0.1 * np.mean(_stribeck(test) ** 2, axis=0))


def test_beyond_its_training_the_net_says_what_it_says_at_the_edge(tmp_path: Path) -> None:
    """Speed, acceleration and load moved to the edge change nothing; the bounds are saved with the weights."""
    state = _states(40)
    net = fit_residual_net([state], [_stribeck(state)])
    assert net.bounds is not None
    far = tuple(3.0 * part for part in state)
    edge = (far[0], *net.bounds.clip(*far[1:]))
    assert np.array_equal(net.predict(*far), net.predict(*edge))
    assert not np.array_equal(far[1], edge[1])
    net.save(tmp_path)
    assert np.array_equal(ResidualNet.load(tmp_path).predict(*far), net.predict(*far))


def test_a_net_never_says_more_than_it_said_where_it_was_fitted(tmp_path: Path) -> None:
    """Where speed, acceleration and load go together, a corner of their box is unseen: the torque there is bounded."""
    rng = np.random.default_rng(3)
    time = np.linspace(0.0, 20.0, 3000)
    dq = np.stack([np.sin(time), np.cos(0.7 * time)], axis=1)
    together = (np.zeros_like(dq), dq, dq, dq)
    target = 2.0 * dq**3 + 0.05 * rng.standard_normal(dq.shape)
    net = fit_residual_net([together], [target])
    said = net.predict(*together)
    apart = (np.zeros_like(dq), 0.9 * dq, -0.9 * dq, 0.9 * dq[::-1])
    assert net.bounds is not None
    assert np.array_equal(net.bounds.clip(*apart[1:]), apart[1:])
    least, most = net.bounds.torques
    assert np.all(net.predict(*apart) >= said.min(axis=0))
    assert np.all(net.predict(*apart) <= said.max(axis=0))
    assert np.all((least < 0.0) & (most > 0.0))
    free = replace(net, bounds=replace(net.bounds, least=None, most=None))
    assert np.any(free.predict(*apart) > said.max(axis=0))
    assert np.mean((free.predict(*together) - said) ** 2) < 1e-4 * np.mean(said**2)
    net.save(tmp_path)
    assert np.array_equal(ResidualNet.load(tmp_path).predict(*apart), net.predict(*apart))


def test_noise_is_not_learnt() -> None:
    """On pure noise the default net stays nearly silent: under 3 % of the noise's mean square on an unseen motion."""
    rng, train = np.random.default_rng(8), [_states(seed) for seed in (20, 21)]
    net = fit_residual_net(train, [2.0 * rng.standard_normal(state[0].shape) for state in train])
    assert np.all(np.mean(net.predict(*_states(22)) ** 2, axis=0) < 0.03 * 4.0)


def test_samples_at_rest_do_not_count() -> None:
    """What is masked out may be anything: the weights are the same, bit for bit."""
    state = _states(9)
    mask = np.abs(state[1]) > 0.2
    clean, dirty = _stribeck(state), np.where(mask, _stribeck(state), 1e3)
    fits = [fit_residual_net([state], [target], [mask], DEFAULT) for target in (clean, dirty)]
    assert np.allclose(fits[0].output_std, fits[1].output_std)
    assert _same(*fits)


def _data(seed: int, samples: int = 1200) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((samples, 6))
    return x, np.tanh(2.0 * x[:, 2]) + 0.3 * x[:, 4], np.arange(samples) * 4 // samples


def test_rows_that_do_not_count_change_nothing() -> None:
    """Neither their torque nor their number; a joint with a handful of rows stays silent."""
    x, y, fold = _data(6)
    counts = x[:, 0] > -0.5
    clean, dirty = (solve_net(x, target, counts, fold, 0) for target in (y, np.where(counts, y, 1e6)))
    assert all(np.array_equal(a, b) for a, b in zip(clean.weights, dirty.weights, strict=True))
    empty = solve_net(x, y, np.arange(len(x)) < 5, fold, 0)
    assert not empty.unseen.any()
    assert not empty.weights[1].any()


RUN = np.repeat(np.arange(8), 100)


def _judged(predicted: Array, left: Array) -> list[bool]:
    travel = np.full(left.shape, 0.01)
    return [one.kept for one in shrink_net(predicted, left, np.ones(left.shape, dtype=bool), travel, RUN)]


WAVE = np.sin(np.arange(800) / 7.0)[:, None]
NOISE = np.random.default_rng(1).standard_normal((800, 1))
# What a net predicts, what it should have, and which joints keep it.
GATES = {
    "half of it, noise, none": (np.hstack([0.5 * WAVE + 0.05, NOISE, 0.0 * WAVE]), WAVE + np.full(3, 0.1), [1, 0, 0]),
    "more energy error": (0.5 * WAVE + np.array([0.0, 0.6]), WAVE + np.zeros(2), [1, 0]),
    "help on one run alone": (np.where(RUN == 0, 0.9, -0.05)[:, None] * WAVE, WAVE, [0]),
    # Two joints whose energy errors cancel: a net that takes away one of them alone is let go.
    "energy of all": (np.hstack([0.9 * WAVE + 0.9, 0.0 * WAVE]), WAVE + np.array([1.0, -1.0]), [0, 0]),
}


@pytest.mark.parametrize("case", GATES)
def test_a_joint_keeps_what_helps_on_every_run_in_torque_and_energy(case: str) -> None:
    predicted, left, kept = GATES[case]
    assert _judged(predicted, left) == [bool(one) for one in kept]


def _nets(joints: int) -> JointNets:
    rng, width = np.random.default_rng(1), width_of(6)
    weights, biases = ((6, width), (width, 1)), ((1, width), (1, 1))
    first, last, bias, offset = (rng.standard_normal((joints, *shape)) for shape in (*weights, *biases))
    return JointNets((first, last), (bias, offset))


def test_a_silent_joint_gives_nothing() -> None:
    """And one that keeps half gives half; the other's net is as it was, however many rows are asked for at once."""
    nets, x = _nets(3), np.random.default_rng(0).standard_normal((2100, 3, 6))
    before = nets(x)
    assert np.allclose(before[-5:], nets(x[-5:]), atol=1e-5)
    after = nets.scaled([1.0, 0.0, 0.5])(x)
    assert np.all(after[..., 1] == 0.0)
    assert np.array_equal(after[..., 0], before[..., 0])
    assert np.allclose(after[..., 2], 0.5 * before[..., 2], rtol=1e-6)


def test_trained_nets_are_judged_on_runs_that_they_never_saw() -> None:
    """What differs from run to run teaches nothing about the next one; a law of the state does."""
    rng, states, residuals = np.random.default_rng(2), [], []
    for run in range(8):
        q, dq, ddq = (rng.uniform(-1, 1, (120, 2)) for _ in range(3))
        states.append((q, dq, ddq, np.zeros((120, 2))))
        residuals.append(np.stack([np.tanh(3 * dq[:, 0]), (-1.0) ** run * np.ones(120)], axis=1))
    net = fit_residual_net(states, residuals)
    assert [one.kept for one in net.gate] == [True, False]
    assert np.all(net.predict(*states[0])[:, 1] == 0.0)
    shown = describe_gate(net.gate, ("a", "b"))
    assert shown.startswith("residual net, on runs held back: kept for a (")
    assert f"{net.gate[0].rmse_without:.3g} → {net.gate[0].rmse_with:.3g} N m" in shown
    assert "; left out for b (" in shown


def test_what_is_said_of_a_row_does_not_know_it() -> None:
    """Chance can't be foretold: on noise the unseen prediction is no better than none, the error says so."""
    x, _, fold = _data(4, 600)
    y = np.random.default_rng(5).standard_normal(600)
    solved = solve_net(x, y, np.ones(600, dtype=bool), fold, 0)
    assert np.mean((solved.unseen - y) ** 2) > 0.97 * np.mean(y**2)
    assert solved.error > 0.97


def test_a_long_session_is_learnt_from_stretches_all_over_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: whatever the session's length a net is trained on about so many samples, and on some of most runs."""
    arm, trained = two_joint_arm(), list[State]()
    motions = made_motions(arm, arm.inverse_dynamics, range(6), 8.0)
    length = len(motions[0].time)
    monkeypatch.setattr(residual_net, "fit_residual_net", lambda states, *_: trained.extend(states))
    monkeypatch.setattr(residual_net, "TRAINED_SAMPLES", 2 * length)
    monkeypatch.setattr(stretches, "STRETCH_SAMPLES", length // 4)
    fit_net_of_arm(Unexplained.by(motions, arm, lambda _, rigid: 0.0 * rigid), DEFAULT, None, None)
    every = motions[0].lowpass.factor
    assert sum(len(state[0]) for state in trained) == pytest.approx(2 * length / every, rel=0.1)
    starts = {tuple(state[0][0]) for state in trained}
    runs = [any(tuple(row) in starts for row in motion.q[motion.coarse]) for motion in motions]
    assert sum(runs) >= 4
