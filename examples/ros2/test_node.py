"""The node between an oscillator on the same topics and `pinc serve`.

    pip install cyclonedds
    python3 examples/ros2/test_node.py target/release/pinc
"""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

os.environ.setdefault("ROS_DOMAIN_ID", "77")

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


def plant(ended, seen):
    """The oscillator in steps of 1 ms; for a quarter of a second nothing is measured."""
    topics = node.Topics()
    measurement, target = topics.writer("pinc/measurement"), topics.writer("pinc/reference")
    inputs, states = topics.reader("pinc/input"), topics.reader("pinc/status", node.Text)
    x1, x2, u, elapsed = 1.0, 0.0, 0.0, 0
    began = time.monotonic()
    while not ended.is_set():
        for sample in inputs.take(N=8):
            u = sample.data[0]
        for sample in states.take(N=8):
            seen[sample.data] = seen.get(sample.data, 0) + 1
        while elapsed < 1000 * (time.monotonic() - began):
            x1, x2 = x1 + 1e-3 * x2, x2 + 1e-3 * ((1 - x1**2) * x2 - x1 + u)
            elapsed += 1
        target.write(node.numbers([-0.5, 0.0]))
        if not 2000 < elapsed < 2250:
            measurement.write(node.numbers([x1, x2]))
        time.sleep(0.01)
    seen["x1"] = x1


def main(pinc):
    process, address = serve(pinc)
    ended, seen = threading.Event(), {}
    thread = threading.Thread(target=plant, args=(ended, seen))
    thread.start()
    time.sleep(0.5)  # until the participants have found each other
    try:
        node.run(address, steps=STEPS)
    finally:
        ended.set()
        thread.join()
        process.terminate()
        process.wait()
    print(f"x1 = {seen['x1']:.4f} after {STEPS} samples, {seen}")
    assert seen["bad-argument"] in (1, 2, 3), "samples without a measurement"
    assert seen["converged"] >= STEPS - 10
    assert abs(seen["x1"] + 0.5) < 0.05


main(sys.argv[1])
