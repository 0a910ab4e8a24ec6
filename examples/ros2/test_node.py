"""The node beside a node that simulates an oscillator. Does nothing where there is no rclpy.

    pip install ros-rclpy ros-std-msgs ros-rmw-fastrtps-cpp
    python3 examples/ros2/test_node.py target/release/pinc
"""

import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("ROS_DOMAIN_ID", "77")
try:
    import rclpy
    from std_msgs.msg import Float64MultiArray, String
except ImportError as error:
    print(f"not tested: {error}")
    sys.exit(0)

import node

TOP = Path(__file__).resolve().parents[2]
STEP_S = 0.1
STEPS = 120


def serve(pinc):
    """The controller at a free port, sampled faster than in the config so that the test is short."""
    config = TOP / "configs/van-der-pol/control.toml"
    sets = [f"--set=model.horizon_s={STEP_S}", "--set=control.n2=20"]
    command = [pinc, "serve", config, "--only", "rk4", *sets, "--listen", "127.0.0.1:0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    return process, json.loads(process.stdout.readline())["listening"]


class Oscillator(rclpy.node.Node):
    """The oscillator in steps of 1 ms; for a quarter of a second nothing is measured. One message in ten
    cannot be used."""

    def __init__(self):
        super().__init__("oscillator")
        self.x1, self.x2, self.u, self.elapsed, self.seen = 1.0, 0.0, 0.0, 0, {}
        self.began = time.monotonic()
        self.create_subscription(Float64MultiArray, "pinc/input", self.act, 1)
        self.create_subscription(String, "pinc/status", self.count, 1)
        self.measurement = self.create_publisher(Float64MultiArray, "pinc/measurement", 1)
        self.target = self.create_publisher(Float64MultiArray, "pinc/reference", 1)
        self.moves = 0
        self.create_timer(0.01, self.move)

    def act(self, message):
        (self.u,) = message.data

    def count(self, message):
        self.seen[message.data] = self.seen.get(message.data, 0) + 1

    def move(self):
        while self.elapsed < 1000 * (time.monotonic() - self.began):
            x1, x2 = self.x1, self.x2
            self.x1, self.x2 = x1 + 1e-3 * x2, x2 + 1e-3 * ((1 - x1**2) * x2 - x1 + self.u)
            self.elapsed += 1
        self.moves += 1
        reference, measurement = [-0.5, 0.0], [self.x1, self.x2]
        if self.moves % 10 == 0:
            reference = ([math.nan, 0.0], [], [1.0])[self.moves // 10 % 3]
            measurement = ([self.x1, self.x2, 5.0], [])[self.moves // 10 % 2]
        self.target.publish(Float64MultiArray(data=reference))
        if not 2000 < self.elapsed < 2250:
            self.measurement.publish(Float64MultiArray(data=measurement))


def main(pinc):
    process, address = serve(pinc)
    rclpy.init()
    controller, plant = node.Controller(address), Oscillator()
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(controller)
    executor.add_node(plant)
    try:
        while controller.samples < STEPS:
            executor.spin_once()
    finally:
        process.terminate()
        process.wait()
    print(f"x1 = {plant.x1:.4f} after {STEPS} samples, {plant.seen}")
    assert plant.seen["bad-argument"] in (1, 2, 3), "samples without a measurement"
    assert plant.seen["converged"] >= STEPS - 10
    assert abs(plant.x1 + 0.5) < 0.05


main(sys.argv[1])
