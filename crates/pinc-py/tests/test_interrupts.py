"""Ctrl-C in calls that take long, in a process of its own."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

CALLS = {
    "steps": "batch.steps(np.tile([0.5, 0.1], (10**7, 1)), [0.0, 0.0])",
    "gradients": "batch.gradients(np.tile([0.5, 0.1], (10**7, 1)), [0.0, 0.0], [1.0])",
    "loops": "batch.loops(np.tile([0.5, 0.1], (10**6, 1)), np.zeros((300, 2)))",
    "simulate": "pinc.Plant(config).simulate([0.5, 0.1], np.zeros((10**8, 1)))",
    "certify": "pinc.certify(config, only='rk4', points=10**6, out=out)",
}


@pytest.mark.parametrize("name", list(CALLS))
def test_ctrl_c_ends_the_call(name: str, smoke: Path, tmp_path: Path) -> None:
    program = (
        "import sys, numpy as np, pinc_nmpc as pinc\n"
        f"config, out = {str(smoke)!r}, {str(tmp_path / 'out')!r}\n"
        "batch = pinc.NmpcBatch(config, only='rk4', threads=2)\n"
        "print('begun', flush=True)\n"
        f"try: {CALLS[name]}\n"
        "except KeyboardInterrupt: sys.exit(3)\n"
    )
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"begun\n"
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        # All calls would take much longer; a call that goes on is killed.
        try:
            assert process.wait(timeout=60) == 3
        finally:
            process.kill()


SHARED = """
import pickle, sys, threading
import numpy as np, pinc_nmpc as pinc

batch = pinc.NmpcBatch(sys.argv[1], only="rk4", threads=1)
x = np.full((50, 2), 0.1)
calls = [
    lambda: batch.steps(x, [0.5, 0.0]),
    lambda: batch.gradients(x, [0.5, 0.0], [1.0]),
    lambda: batch.loops(x, np.zeros((5, 2))),
    lambda: (batch.states, pickle.dumps(batch)),
]

def repeat(call):
    for _ in range(20):
        call()

threads = [threading.Thread(target=repeat, args=(call,)) for call in calls * 2]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
"""


def test_threads_take_turns_with_a_batch(smoke: Path) -> None:
    """One looks for Ctrl-C, which takes the interpreter, while others wait for the batch."""
    subprocess.run([sys.executable, "-c", SHARED, str(smoke)], check=True, timeout=120)
