"""Closes the loop between `pinc serve` and a simulator of one's own, here of the Van der Pol oscillator.

The controller is a process: a line of JSON with what was measured goes to its standard input, a line with
the input to apply comes back. Run from the top of the repository, with Python's standard library alone:

    python3 examples/serve-client/client.py target/release/pinc
"""

import json
import subprocess
import sys

CONFIG = "configs/van-der-pol/control.toml"
STEP_S = 0.5
STEPS = 40


class Controller:
    """The controller of a config, served by the program `pinc`."""

    def __init__(self, pinc, config, *arguments):
        command = [pinc, "serve", config, *arguments]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )

    def step(self, y, reference=None, u_applied=None):
        """What to apply for a plant measured to be at y."""
        request = {"y": y}
        if reference is not None:
            request["reference"] = reference
        if u_applied is not None:
            request["u_applied"] = u_applied
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError("the controller has ended; it says why on standard error")
        answer = json.loads(line)
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def close(self):
        """Ends the controller."""
        self.process.stdin.close()
        self.process.wait()


def derivative(x, u):
    """The oscillator: x1' = x2, x2' = (1 - x1^2) x2 - x1 + u."""
    return [x[1], (1.0 - x[0] ** 2) * x[1] - x[0] + u]


def simulate(x, u, duration_s, substeps=100):
    """The plant after some seconds, by the Runge-Kutta method of order 4."""
    h = duration_s / substeps

    def along(k, part):
        return [a + part * h * b for a, b in zip(x, k)]

    for _ in range(substeps):
        k1 = derivative(x, u)
        k2 = derivative(along(k1, 0.5), u)
        k3 = derivative(along(k2, 0.5), u)
        k4 = derivative(along(k3, 1.0), u)
        x = [
            a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e)
            for a, b, c, d, e in zip(x, k1, k2, k3, k4)
        ]
    return x


def main():
    """Steers the oscillator from (1, 0) to (0, 0), then to (-0.5, 0)."""
    pinc = sys.argv[1] if len(sys.argv) > 1 else "pinc"
    controller = Controller(pinc, CONFIG, "--only", "rk4")
    x, converged = [1.0, 0.0], 0
    for k in range(STEPS):
        reference = [0.0, 0.0] if k < STEPS // 2 else [-0.5, 0.0]
        answer = controller.step(x, reference)
        converged += answer["status"] == "converged"
        print(f"{k * STEP_S:5.1f} s  x = {x[0]:8.4f} {x[1]:8.4f}  u = {answer['u'][0]:8.4f}")
        x = simulate(x, answer["u"][0], STEP_S)
    controller.close()
    print(f"{STEPS} steps, {converged} converged, at x1 = {x[0]:.4f}")
    if abs(x[0] + 0.5) > 0.01:
        sys.exit("the reference was not reached")


if __name__ == "__main__":
    main()
