"""A ROS 2 node that records joint states run by run into the folder of a session.

`~/start` begins a run, `~/stop` ends it and writes its file; both are `std_srvs/Trigger`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from armgap_recorder.joint_log import JointLog


class Recorder(Node):
    """Listens to one topic; a run goes from `~/start` to `~/stop`."""

    def __init__(self) -> None:
        super().__init__("armgap_recorder")
        self.folder = Path(str(self.declare_parameter("session", "my_session").value))
        topic = str(self.declare_parameter("topic", "/joint_states").value)
        self.log: JointLog | None = None
        self.last = float("-inf")
        self.create_subscription(JointState, topic, self.take, qos_profile_sensor_data)
        self.create_service(Trigger, "~/start", self.start)
        self.create_service(Trigger, "~/stop", self.stop)

    def take(self, message: Any) -> None:
        """A message of the topic."""
        if self.log is not None:
            self.log.add(message)

    def start(self, _: Any, answer: Any) -> Any:
        """Begins a run."""
        answer.success = self.log is None
        answer.message = "recording" if answer.success else "a run is being recorded: stop it first"
        if self.log is None:
            self.log = JointLog(self.last)
        return answer

    def stop(self, _: Any, answer: Any) -> Any:
        """Ends the run and writes it."""
        log = self.log
        self.log = None
        answer.success = False
        if log is None:
            answer.message = "no run is being recorded"
            return answer
        path = self.free_name()
        try:
            log.write(path)
        except (OSError, ValueError) as error:
            answer.message = str(error)
            return answer
        self.last = log.last
        answer.success = True
        answer.message = f"{path}: {log.describe()}"
        self.get_logger().info(answer.message)
        return answer

    def free_name(self) -> Path:
        """The name of the next run: no file is written over."""
        number = 0
        while (self.folder / f"run_{number:03d}.csv").exists():
            number += 1
        return self.folder / f"run_{number:03d}.csv"


def main() -> None:
    """Runs the node until it is stopped."""
    rclpy.init()
    node = Recorder()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
