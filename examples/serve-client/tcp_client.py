"""Steers an oscillator by `pinc serve .. --listen 127.0.0.1:5025`, with Python's standard library.

    pinc serve configs/van-der-pol/control.toml --only rk4 --listen 127.0.0.1:5025 &
    python3 examples/serve-client/tcp_client.py 5025
"""

import json
import socket
import sys


def ask(line, **request):
    """The answer to a request; an error of the controller is raised."""
    line.write(json.dumps(request) + "\n")
    line.flush()
    answer = json.loads(line.readline() or '{"error": "the controller has ended"}')
    if "error" in answer:
        raise ValueError(answer["error"])
    return answer


port = int(sys.argv[1]) if len(sys.argv) > 1 else 5025
with socket.create_connection(("127.0.0.1", port)) as connection:
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    with connection.makefile("rw") as line:
        ask(line, command="reset")
        step_s = ask(line, command="describe")["sample_time_s"]
        x1, x2 = 1.0, 0.0
        for _ in range(40):
            (u,) = ask(line, y=[x1, x2], reference=[-0.5, 0.0])["u"]
            for _ in range(1000):  # the plant: the oscillator, by Euler's method
                h = step_s / 1000
                x1, x2 = x1 + h * x2, x2 + h * ((1 - x1**2) * x2 - x1 + u)
print(f"x1 = {x1:.4f}")
