"""Laws of the ROS 2 recorder: what messages say is what armgap reads. ROS itself is not needed."""

from __future__ import annotations

import importlib
import sys
import types
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from ident.recordings.load import load_session

PACKAGE = Path(__file__).parents[2] / "examples" / "ros2_recorder"
SAMPLES = 50
JOINTS = ["shoulder", "elbow"]
START = 1_700_000_000


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The package, as `colcon build` would have installed it."""
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name in [name for name in sys.modules if name.startswith("armgap_recorder")]:
        monkeypatch.delitem(sys.modules, name)
    return importlib.import_module("armgap_recorder.joint_log")


@pytest.fixture
def messages() -> Any:
    """Makes joint states by the definitions of ROS 2, through their bytes and back."""
    stores = pytest.importorskip("rosbags.typesys")
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    kinds = store.types
    kind = "sensor_msgs/msg/JointState"

    def make(time: float, names: list[str], **quantities: list[float]) -> Any:
        stamp = kinds["builtin_interfaces/msg/Time"](sec=int(time), nanosec=round(time % 1 * 1e9))
        header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
        values = {}
        for quantity in ("position", "velocity", "effort"):
            values[quantity] = np.array(quantities.get(quantity, []), dtype=float)
        written = store.serialize_cdr(kinds[kind](header=header, name=names, **values), kind)
        return store.deserialize_cdr(written, kind)

    return make


def states(messages: Any, start: float = START) -> list[Any]:
    """A run whose messages name the joints in either order."""
    made = []
    for k in range(SAMPLES):
        order = [0, 1] if k % 2 == 0 else [1, 0]
        values = np.array([[0.1 * k, -0.2 * k], [1.0, 2.0], [3.0 + k, 4.0]])[:, order].tolist()
        names = [JOINTS[j] for j in order]
        quantities = dict(zip(("position", "velocity", "effort"), values, strict=True))
        made.append(messages(start + 0.01 * k, names, **quantities))
    return made


def test_what_messages_say_is_what_is_read(recorder: Any, messages: Any, tmp_path: Path) -> None:
    log = recorder.JointLog()
    for message in states(messages):
        log.add(message)
    log.write(tmp_path / "run_000.csv")
    (run,) = load_session(tmp_path).runs
    assert list(run.joints) == JOINTS
    np.testing.assert_allclose(np.diff(run.time), 0.01, atol=1e-6)
    np.testing.assert_array_equal(run.position[:, 1], -0.2 * np.arange(SAMPLES))
    np.testing.assert_array_equal(run.effort[:, 0], 3.0 + np.arange(SAMPLES))
    assert [path.name for path in tmp_path.iterdir()] == ["run_000.csv"]


def test_what_does_not_fit_is_left_out_and_counted(recorder: Any, messages: Any) -> None:
    log = recorder.JointLog(after=START + 0.005)
    for message in states(messages):
        log.add(message)
    log.add(messages(START + 5.0, ["gripper"], position=[0.0]))
    log.add(messages(START + 6.0, JOINTS, position=[0.0, 0.0]))
    log.add(messages(START + 7.0, JOINTS, position=[0.0]))
    assert len(log.rows) == SAMPLES - 1
    assert sum(log.left_out.values()) == 4
    assert "1 messages left out: it is of other joints than the first message" in log.describe()


def test_without_effort_the_recorder_says_what_is_missing(recorder: Any, messages: Any) -> None:
    log = recorder.JointLog()
    log.add(messages(START, JOINTS, position=[0.0, 0.0]))
    assert log.columns == ["time", "shoulder/position", "elbow/position"]
    assert "without effort" in log.describe()


def test_nothing_is_written_of_nothing(recorder: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no message came"):
        recorder.JointLog().write(tmp_path / "session" / "run.csv")
    assert not list(tmp_path.iterdir())


class Node:
    """A node without a network: parameters are what the test says."""

    given: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.name = name
        self.services: dict[str, Any] = {}

    def declare_parameter(self, name: str, usual: Any) -> Any:
        return types.SimpleNamespace(value=self.given.get(name, usual))

    def create_subscription(self, _: Any, topic: str, take: Any, __: Any) -> None:
        self.topic = topic
        self.listener = take

    def create_service(self, _: Any, name: str, answer: Any) -> None:
        self.services[name] = answer

    def get_logger(self) -> Any:
        return types.SimpleNamespace(info=lambda _: None)


@pytest.fixture
def node(recorder: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The node on stand-ins for what it imports of ROS."""
    places = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"JointState": None},
        "std_srvs": {},
        "std_srvs.srv": {"Trigger": None},
    }
    for name, held in places.items():
        module = types.ModuleType(name)
        module.__dict__.update(held)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(Node, "given", {"session": str(tmp_path / "session")})
    return importlib.import_module("armgap_recorder.node").Recorder()


def ask(node: Any, service: str) -> Any:
    """Calls a service of the node."""
    return node.services[service](None, types.SimpleNamespace(success=None, message=""))


def test_a_session_goes_on_run_by_run(node: Any, messages: Any, tmp_path: Path) -> None:
    """Law: each start and stop makes one run, on one clock, and nothing is written over."""
    assert node.topic == "/joint_states"
    assert not ask(node, "~/stop").success
    for start in (START, START + 60.0):
        assert ask(node, "~/start").success
        assert not ask(node, "~/start").success
        for message in states(messages, start):
            node.listener(message)
        assert f"{SAMPLES} samples of 2 joints" in ask(node, "~/stop").message
    session = load_session(tmp_path / "session")
    assert [len(run) for run in session.runs] == [SAMPLES, SAMPLES]
    assert session.common_clock


def test_a_run_without_messages_is_said(node: Any, tmp_path: Path) -> None:
    ask(node, "~/start")
    answer = ask(node, "~/stop")
    assert (answer.success, "no message came" in answer.message) == (False, True)
    assert not (tmp_path / "session").exists()
