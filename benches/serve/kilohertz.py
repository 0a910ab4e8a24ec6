"""Steers a motor by `pinc serve` once a millisecond, and counts the answers that came after the next sample.

    python3 benches/serve/kilohertz.py target/release/pinc [steps]

The motor of configs/gallery/motor.toml turns to and fro, a second each way. An input acts from the
sample after its own. Half-way the process is ended and another one goes on from the state that was saved.
"""

import json
import math
import subprocess
import sys
import time

PERIOD_S = 1e-3
CHANGES = {"model.horizon_s": PERIOD_S, "control.rk4_substeps": 2, "control.delay_steps": 1}
SETS = [f"--set={key}={value}" for key, value in CHANGES.items()]


class Controller:
    """`pinc serve` as a process."""

    def __init__(self, pinc):
        command = [pinc, "serve", "configs/gallery/motor.toml", "--only", "rk4", *SETS]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)

    def ask(self, **request):
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def end(self):
        self.process.stdin.close()
        self.process.wait()


def motor(x, u, parts=20):
    """The motor after a period, by Euler's method."""
    angle, speed, current = x
    h = PERIOD_S / parts
    for _ in range(parts):
        torque = 0.05 * current - 1e-3 * speed - 0.02 * math.tanh(speed / 0.01)
        voltage = u - current - 0.05 * speed
        angle, speed, current = angle + h * speed, speed + h * torque / 1e-3, current + h * voltage / 5e-3
    return [angle, speed, current]


def main(pinc, steps):
    controller = Controller(pinc)
    controller.ask(y=[0.0, 0.0, 0.0])  # the first step takes more iterations
    x, u, missed, statuses, answers = [0.0, 0.0, 0.0], 0.0, 0, {}, []
    due = time.perf_counter()
    for k in range(steps):
        if k == steps // 2:
            state = controller.ask(command="save")["state"]
            controller.end()
            controller = Controller(pinc)
            controller.ask(command="restore", state=state)
            due = time.perf_counter()
        while (left := due - time.perf_counter()) > 0.0:
            time.sleep(max(0.0, left - 2e-4))
        asked = time.perf_counter()
        answer = controller.ask(y=x, reference=[float(k // 1000 % 2), 0.0])
        answers.append(1e6 * (time.perf_counter() - asked))
        due += PERIOD_S
        statuses[answer["status"]] = statuses.get(answer["status"], 0) + 1
        x = motor(x, u)  # while the answer was under way
        if time.perf_counter() > due:
            missed += 1
            due = time.perf_counter()  # the samples in between are gone
        else:
            (u,) = answer["u"]
    controller.end()
    answers.sort()
    middle, late, worst = (answers[int(q * (steps - 1))] for q in (0.5, 0.999, 1.0))
    print(f"{steps} steps, {missed} missed, {statuses}; answers in us: median {middle:.0f}, "
          f"99.9 % {late:.0f}, largest {worst:.0f}; at {x[0]:.3f} rad")


main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 100_000)
