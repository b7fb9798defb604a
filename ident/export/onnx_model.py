"""A fitted model as an ONNX graph: rigid arm, losses, named laws, offsets, net and memory.

    torque [, next_state] = f(q, dq, ddq [, dt, state])

N rows are N arms, or N states of one; joints stand in the model's order, in SI units and doubles.
Where joints have a memory, a row's state is what they remember: zeros before a motion, then what
the last call gave. The laws' nodes are written by the laws themselves (`ident.laws`); Newton and
Euler's recursion runs in the joints' own frames, as in the C++ header.

Source: Featherstone 2008, section 5.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.export.formats import Run
from ident.export.identified import SHARPEST
from ident.export.onnx_graph import Graph, Tensor
from ident.laws.friction_laws import JointStates
from ident.model.boosted import Trees
from ident.model.carried import describe_arm
from ident.model.hybrid import HybridModel
from ident.model.joint_nets import DIRECTION_SCALES, LOAD_ROUNDING, JointNets
from ident.model.memory import RANGES, TIMES, TURNING
from ident.model.sampling import sampling_interval
from ident.own_settings import load_onnxruntime

FILE = "torque_model.onnx"
# What a joint's averages are of.
AVERAGED = len(("direction", "pace", "load", "angle"))
ABOUT = "torque [N m] of {robot} for q [rad], dq [rad/s] and ddq [rad/s2] of {joints}"
# Flat skew matrices of the unit vectors.
SKEW = np.array(
    [
        [0, 0, 0, 0, 0, -1, 0, 1, 0],
        [0, 0, 1, 0, 0, 0, -1, 0, 0],
        [0, -1, 0, 1, 0, 0, 0, 0, 0],
    ]
)


def require_expressible(model: HybridModel) -> None:
    """Passes if a graph can say all that a model holds.

    Raises:
        InputError: It has effects beside its laws, or the paper's net.
    """
    if model.carried:
        names = ", ".join(effect.effect for effect in model.carried)
        remedy = "fit without them (`ident fit` without --with), or export another --format"
        raise InputError("--format onnx", f"a graph has no place for {names}", remedy)
    if model.net is not None and not isinstance(model.net.network, JointNets):
        remedy = "fit with --net default, or export another --format"
        raise InputError("--format onnx", "the paper's net is not written as a graph", remedy)


def write_onnx(model: HybridModel) -> bytes:
    """The file.

    Args:
        model: The fitted model.

    Raises:
        InputError: It holds what no graph can say (`require_expressible`).
    """
    require_expressible(model)
    n = model.arm.n
    graph = Graph()
    q, dq, ddq = (graph.input(name, ("N", n)) for name in ("q", "dq", "ddq"))
    rigid = _rigid(graph, model, q, dq, ddq)
    width = np.maximum(model.loss.transition_speed, SHARPEST)
    slip = graph.tanh(dq / width)
    loss = model.loss
    total = rigid + loss.motor_inertia * ddq + loss.viscous * dq + loss.coulomb * slip + loss.offset
    total = total + _laws(graph, model, (q, dq, rigid, slip))
    remembers = _remembering(model)
    net = None if model.net is None else _net(graph, model, dq, ddq, rigid)
    if remembers:
        memory, state = _memory(graph, model, (q, dq, ddq, rigid))
        mask = np.isin(np.arange(n), remembers)
        beside = memory if net is None else memory + net * (1.0 - mask)
        total = total + beside
        graph.output("torque", total, ("N", n))
        graph.output("next_state", state, ("N", state_size(model)))
    else:
        total = total if net is None else total + net
        graph.output("torque", total, ("N", n))
    about = ABOUT.format(robot=model.arm.name, joints=", ".join(model.joint_names))
    return graph.finish("torque_model", about)


def state_size(model: HybridModel) -> int:
    """How many numbers a row's state has; zero where nothing is remembered."""
    remembered = 1 + len(RANGES) + AVERAGED * len(TIMES)
    return 1 + model.arm.n * remembered if _remembering(model) else 0


def _remembering(model: HybridModel) -> list[int]:
    if model.memory is None or model.net is None:
        return []
    return [int(joint) for joint in np.flatnonzero(model.memory.kept)]


def _cross(graph: Graph, a: Tensor, b: Tensor) -> Tensor:
    """Of rows of two (N, 3) tensors, or of (1, 3)."""
    left = a.columns(1, 2, 0) * b.columns(2, 0, 1)
    return left - a.columns(2, 0, 1) * b.columns(1, 2, 0)


def _turned(graph: Graph, turn: Tensor, vectors: Tensor, back: bool = False) -> Tensor:
    """Rows of vectors (N, 3) by rotations (N, 3, 3), or by their inverses."""
    matrices = graph.node("Transpose", turn, perm=[0, 2, 1]) if back else turn
    return graph.reshape(matrices @ graph.reshape(vectors, -1, 3, 1), -1, 3)


def _rotation(
    graph: Graph,
    fixed: Float[Array, "3 3"],
    axis: Float[Array, " 3"],
    angle: Tensor,
) -> Tensor:
    """A fixed rotation, then one by an angle a (N, 1): fixed (1 + sin a K + (1 - cos a) K²)."""
    skew = (axis @ SKEW).reshape(3, 3)
    still = (fixed @ (np.eye(3) + skew @ skew)).reshape(1, 9)
    by_sine = (fixed @ skew).reshape(1, 9)
    by_cosine = (-fixed @ skew @ skew).reshape(1, 9)
    flat = graph.sin(angle) * by_sine + graph.cos(angle) * by_cosine + still
    return graph.reshape(flat, -1, 3, 3)


def _rigid(graph: Graph, model: HybridModel, q: Tensor, dq: Tensor, ddq: Tensor) -> Tensor:
    """Torque of the rigid arm [N m]."""
    chain = describe_arm(model.arm)
    n = model.arm.n
    nothing = q.columns(0) * np.zeros((1, 3))
    omega = nothing
    alpha = nothing
    acceleration = nothing - chain.gravity.reshape(1, 3)
    turns = []
    levers = []
    forces = []
    moments = []
    for j in range(n):
        axis = chain.axes[j].reshape(1, 3)
        sliding = bool(chain.sliding[j])
        angle = q.columns(j) * (0.0 if sliding else 1.0)
        turn = _rotation(graph, chain.rotations[j], chain.axes[j], angle)
        lever = nothing + chain.offsets[j].reshape(1, 3)
        if sliding:
            lever = lever + _turned(graph, turn, q.columns(j) * axis)
        swing = _cross(graph, omega, _cross(graph, omega, lever))
        acceleration = acceleration + _cross(graph, alpha, lever) + swing
        omega, alpha, acceleration = (
            _turned(graph, turn, vectors, back=True) for vectors in (omega, alpha, acceleration)
        )
        speed = dq.columns(j) * axis
        if sliding:
            acceleration = acceleration + 2.0 * _cross(graph, omega, speed) + ddq.columns(j) * axis
        else:
            alpha = alpha + _cross(graph, omega, speed) + ddq.columns(j) * axis
            omega = omega + speed
        mass = chain.links[j][0]
        moment_of_mass = nothing + chain.links[j][1:4].reshape(1, 3)
        whole = chain.links[j][4:][[0, 1, 3, 1, 2, 4, 3, 4, 5]]
        inertia = whole.reshape(3, 3)
        force = mass * acceleration + _cross(graph, alpha, moment_of_mass)
        force = force + _cross(graph, omega, _cross(graph, omega, moment_of_mass))
        moment = alpha @ inertia + _cross(graph, omega, omega @ inertia)
        moment = moment + _cross(graph, moment_of_mass, acceleration)
        turns.append(turn)
        levers.append(lever)
        forces.append(force)
        moments.append(moment)
    return _down_the_chain(graph, model, turns, levers, forces, moments)


def _down_the_chain(
    graph: Graph,
    model: HybridModel,
    turns: Sequence[Tensor],
    levers: Sequence[Tensor],
    forces: Sequence[Tensor],
    moments: Sequence[Tensor],
) -> Tensor:
    """What each joint has to bear of the forces and moments on the links that it moves [N m]."""
    chain = describe_arm(model.arm)
    columns: list[Tensor] = []
    force = moment = forces[0] * 0.0
    for j in reversed(range(model.arm.n)):
        force = force + forces[j]
        moment = moment + moments[j]
        borne = force if chain.sliding[j] else moment
        columns.append(borne @ chain.axes[j].reshape(3, 1))
        force = _turned(graph, turns[j], force)
        moment = _turned(graph, turns[j], moment) + _cross(graph, levers[j], force)
    return graph.concat(columns[::-1])


def _laws(graph: Graph, model: HybridModel, states: Sequence[Tensor]) -> Tensor | float:
    """Torque of the named laws, by positions, speeds, loads and directions of sliding [N m]."""
    q, dq, load, slip = states
    if not model.named:
        return 0.0
    columns: list[Tensor] = []
    for j in range(model.arm.n):
        torque = q.columns(j) * 0.0
        for law in model.named:
            if law.joint != j:
                continue
            at_joint = JointStates(
                q.columns(j),
                dq.columns(j),
                load.columns(j),
                slip.columns(j),
                graph,
            )
            terms = law.kind.columns(at_joint, law.shape)
            for term, (value, _, _) in zip(terms, law.figures, strict=True):
                torque = torque + value * term
        columns.append(torque)
    return graph.concat(columns)


def _features(graph: Graph, dq: Tensor, ddq: Tensor, load: Tensor) -> list[Tensor]:
    """Inputs of a joint's net (`joint_features`)."""
    near, far = (graph.tanh(dq / scale) for scale in DIRECTION_SCALES)
    size = graph.node("Sqrt", load * load + LOAD_ROUNDING**2)
    return [dq, ddq, near, far, load, size * near]


def _net(graph: Graph, model: HybridModel, dq: Tensor, ddq: Tensor, rigid: Tensor) -> Tensor:
    """The net of each joint [N m]; beyond its training it says what it says at the edge."""
    net = model.net
    assert net is not None
    assert net.bounds is not None
    assert isinstance(net.network, JointNets)
    first, last = (weights.astype(float) for weights in net.network.weights)
    bias, offset = (values.astype(float) for values in net.network.biases)
    low = net.bounds.low
    high = net.bounds.high
    inside = [graph.clip(term, low[k], high[k]) for k, term in enumerate((dq, ddq, rigid))]
    columns = []
    for j in range(net.n):
        x = graph.concat(_features(graph, *(term.columns(j) for term in inside)))
        scaled = (x - net.input_mean[j]) / net.input_std[j]
        hidden = scaled @ first[j] + bias[j]
        hidden = hidden / (1.0 + graph.exp(-hidden))
        said = hidden @ last[j] + offset[j]
        columns.append(said * float(net.output_std[j]))
    return graph.clip(graph.concat(columns), *net.bounds.torques)


def _memory(graph: Graph, model: HybridModel, states: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
    """The memory of each joint [N m], zero where it has none, and the state after this call."""
    n = model.arm.n
    assert model.memory is not None
    dt = graph.input("dt", (1,))
    state = graph.input("state", ("N", state_size(model)))
    begun = state.columns(0)
    after = [begun * 0.0 + 1.0]
    columns = []
    place = 1
    for j in range(n):
        count = 1 + len(RANGES) + AVERAGED * len(TIMES)
        before = state.columns(*range(place, place + count))
        own_states = [state_of_all.columns(j) for state_of_all in states]
        inputs, remembered = _remembered(graph, (begun, dt), before, own_states)
        place += count
        after.append(remembered)
        trees = model.memory.trees[j]
        if trees is None:
            columns.append(begun * 0.0)
        else:
            columns.append(_trees(graph, trees, graph.concat([*inputs, *states])))
    said = graph.concat(columns)
    if model.memory.nearness.steepness.any():
        said = said / _falling(graph, model, states[0])
    return said, graph.concat(after)


def _falling(graph: Graph, model: HybridModel, q: Tensor) -> Tensor:
    """By what each joint's memory is divided that far from poses that were seen (`Nearness`)."""
    assert model.memory is not None
    nearness = model.memory.nearness
    off = graph.reshape(q, -1, 1, model.arm.n) - nearness.poses[None]
    along = graph.constant(np.array([2], dtype=np.int64))
    squares = graph.node("ReduceSum", off * off, along, keepdims=0)
    return graph.node("ReduceMin", squares, axes=[1], keepdims=1) * nearness.steepness + 1.0


def _remembered(
    graph: Graph,
    time: tuple[Tensor, Tensor],
    before: Tensor,
    states: Sequence[Tensor],
) -> tuple[list[Tensor], Tensor]:
    """A joint's own inputs of its memory (`memory_inputs`), and what it remembers thereafter."""
    begun, dt = time
    q, dq, ddq, load = states
    inputs = _features(graph, dq, ddq, load)
    step = (q - before.columns(0)) * begun
    stops = []
    for k, size in enumerate(RANGES):
        stop = graph.clip(before.columns(1 + k) * begun + step, -size, size)
        stops.append(stop)
        inputs.append(stop / size)
    now = graph.concat([graph.tanh(dq / TURNING), abs(dq), load, q])
    averages = []
    for k, span in enumerate(TIMES):
        place = 1 + len(RANGES) + AVERAGED * k
        old = before.columns(*range(place, place + AVERAGED))
        share = dt / (dt + span)
        # The first value is taken as what went before it.
        mean = now + begun * ((1.0 - share) * (old - now))
        averages.append(mean)
        inputs += [mean.columns(0), mean.columns(1), mean.columns(2) - load, q - mean.columns(3)]
    return inputs, graph.concat([q, *stops, *averages])


def _trees(graph: Graph, trees: Trees, x: Tensor) -> Tensor:
    """Boosted oblivious trees: the answers of each are the digits of its leaf's number."""
    count, depth = trees.inputs.shape
    leaves = trees.leaves.shape[1]
    asked = x.columns(*map(int, trees.inputs.ravel()))
    above = graph.node("Greater", asked, graph.constant(trees.thresholds.reshape(1, -1)))
    digits = graph.reshape(graph.node("Cast", above, to=_integers()), -1, count, depth)
    worth = graph.constant(np.array(2 ** np.arange(depth)[::-1], dtype=np.int64))
    axis = graph.constant(np.array([2], dtype=np.int64))
    number = graph.node("ReduceSum", graph.node("Mul", digits, worth), axis, keepdims=0)
    first = graph.constant(np.array(leaves * np.arange(count), dtype=np.int64))
    values = graph.constant(trees.leaves.ravel())
    torques = graph.node("Gather", values, graph.node("Add", number, first), axis=0)
    along = graph.constant(np.array([1], dtype=np.int64))
    return graph.node("ReduceSum", torques, along, keepdims=1)


def _integers() -> int:
    from onnx import TensorProto

    return int(TensorProto.INT64)


def run_onnx(path: Path, runs: Sequence[Run], model: HybridModel) -> list[Float[Array, "T n"]]:
    """Torque that ONNX Runtime gives along motions, from a fresh state each [N m].

    Args:
        path: The file.
        runs: The motions, with the model's joints.
        model: The model, whose state's size is asked for.
    """
    onnxruntime = load_onnxruntime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    size = state_size(model)
    torques = []
    for run in runs:
        given: dict[str, Array] = {}
        for name, values in zip(("q", "dq", "ddq"), run, strict=False):
            given[name] = np.array(values, dtype=float)
        if not size:
            torques.append(session.run(["torque"], given)[0])
            continue
        said = np.empty(given["q"].shape)
        state = np.zeros((1, size))
        dt = np.array([run[3]])
        for row in range(len(said)):
            now = {name: values[row : row + 1] for name, values in given.items()}
            torque, state = session.run(["torque", "next_state"], {**now, "dt": dt, "state": state})
            said[row] = torque[0]
        torques.append(said)
    return torques


def compare_onnx(path: Path, runs: Sequence[Run], model: HybridModel) -> dict[str, object]:
    """How near a written file, loaded back, is to the model along motions.

    Args:
        path: The file.
        runs: Motions, recorded or made up.
        model: The model.

    Returns:
        "loads", "torque_difference_Nm" and "samples".
    """
    largest = 0.0
    samples = 0
    # The model finds the interval in the states: what remembers must be given the same.
    timed = [(q, dq, ddq, sampling_interval(q, dq) or interval) for q, dq, ddq, interval in runs]
    for run, said in zip(runs, run_onnx(path, timed, model), strict=True):
        difference = said - model.torque(*run[:3])
        largest = max(largest, float(np.max(np.abs(difference))))
        samples += len(said)
    return {"loads": True, "torque_difference_Nm": largest, "samples": samples}
