"""A ROS 2 node that steers a plant; the controller is `pinc serve`.

    pinc serve configs/van-der-pol/control.toml --only rk4 --listen 127.0.0.1:5025 &
    python3 examples/ros2/node.py 127.0.0.1:5025

It needs rclpy and std_msgs, from an installation of ROS 2 or from the Python index:
`pip install ros-rclpy ros-std-msgs ros-rmw-fastrtps-cpp`.

| topic | type | meaning |
|---|---|---|
| /pinc/measurement | std_msgs/Float64MultiArray | in, what is measured, in the order of `describe` |
| /pinc/reference | std_msgs/Float64MultiArray | in, for the controlled quantities; until one comes, the config's |
| /pinc/input | std_msgs/Float64MultiArray | out, every sample |
| /pinc/status | std_msgs/String | out, every sample |

Every sample it takes the newest measurement since the last sample; without one, all measurements count as
missing, and so does a number that is not finite. A measurement of another length, and a reference that is
not finite or of another length, are logged and skipped. When the controller is gone the node ends, and the
plant's own supervision has to take over.
"""

import json
import math
import socket
import sys

import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, String


class Controller(Node):
    """Asks the controller at `address` every sample."""

    def __init__(self, address):
        super().__init__("pinc")
        host, port = address.rsplit(":", 1)
        connection = socket.create_connection((host, int(port)))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.line = connection.makefile("rw")
        about = self.ask(command="describe")
        self.missing = [None] * len(about["measured"])
        self.controlled = len(about["controlled"])
        self.measured, self.targets, self.samples = self.missing, {}, 0
        self.create_subscription(Float64MultiArray, "pinc/measurement", self.measure, 1)
        self.create_subscription(Float64MultiArray, "pinc/reference", self.refer, 1)
        self.input = self.create_publisher(Float64MultiArray, "pinc/input", 1)
        self.status = self.create_publisher(String, "pinc/status", 1)
        self.create_timer(about["sample_time_s"], self.sample)

    def ask(self, **request):
        self.line.write(json.dumps(request) + "\n")
        self.line.flush()
        answer = json.loads(self.line.readline() or '{"error": "the controller has ended"}')
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def measure(self, message):
        if len(message.data) != len(self.missing):
            return self.skip("measurement", message, f"{len(self.missing)} numbers")
        self.measured = [value if math.isfinite(value) else None for value in message.data]

    def refer(self, message):
        if len(message.data) != self.controlled or not all(map(math.isfinite, message.data)):
            return self.skip("reference", message, f"{self.controlled} finite numbers")
        self.targets = {"reference": list(message.data)}

    def skip(self, topic, message, expected):
        self.get_logger().warning(f"{topic}: {list(message.data)} skipped, expected {expected}")

    def sample(self):
        answer = self.ask(y=self.measured, **self.targets)
        self.measured, self.samples = self.missing, self.samples + 1
        self.input.publish(Float64MultiArray(data=answer["u"]))
        self.status.publish(String(data=answer["status"]))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    rclpy.init(args=sys.argv)
    rclpy.spin(Controller(sys.argv[1]))
