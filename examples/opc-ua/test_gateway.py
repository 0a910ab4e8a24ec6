"""The gateway between a real OPC UA server, with an oscillator behind it, and `pinc serve`.

    pip install asyncua
    python3 examples/opc-ua/test_gateway.py target/release/pinc
"""

import asyncio
import json
import subprocess
import sys
from pathlib import Path

import gateway
from asyncua import Server, ua

TOP = Path(__file__).resolve().parents[2]
URL = "opc.tcp://127.0.0.1:48400"
STEP_S = 0.1


def serve(pinc):
    """The controller at a free port, sampled faster than in the config so that the test is short."""
    config = TOP / "configs/van-der-pol/control.toml"
    sets = [f"--set=model.horizon_s={STEP_S}", "--set=control.n2=20"]
    command = [pinc, "serve", config, "--only", "rk4", *sets, "--listen", "127.0.0.1:0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    return process, json.loads(process.stdout.readline())["listening"]


async def plant(server, nodes, missing):
    """The oscillator in steps of 1 ms; its second state is not measured once."""
    x1, x2, elapsed = 1.0, 0.0, 0
    clock = asyncio.get_running_loop()
    began = clock.time()
    while True:
        u = await nodes["u"].read_value()
        while elapsed < 1000 * (clock.time() - began):
            x1, x2 = x1 + 1e-3 * x2, x2 + 1e-3 * ((1 - x1**2) * x2 - x1 + u)
            elapsed += 1
        await nodes["x1"].write_value(x1)
        bad = missing["from"] <= await nodes["heartbeat"].read_value() < missing["to"]
        code = ua.StatusCodes.BadSensorFailure if bad else ua.StatusCodes.Good
        value = ua.Variant(x2, ua.VariantType.Double)
        await nodes["x2"].write_value(ua.DataValue(value, ua.StatusCode(code)))
        missing["seen"] |= bad
        await asyncio.sleep(0.01)


def check_that_missed_samples_are_skipped():
    assert gateway.following(4.0, 0.5, 4.125) == (4.5, 0)
    assert gateway.following(4.0, 0.5, 4.75) == (4.5, 0), "a late one is taken at once"
    assert gateway.following(4.0, 0.5, 9.25) == (9.0, 9)


async def main(pinc):
    process, address = serve(pinc)
    server = Server()
    await server.init()
    server.set_endpoint(URL)
    space = await server.register_namespace("plant")
    nodes = {}
    starts = {"x1": 1.0, "x2": 0.0, "x1_ref": -0.5, "x2_ref": 0.0, "u": 0.0, "heartbeat": 0}
    for name, start in starts.items():
        id = ua.NodeId(f"Plant.{name}", space)
        nodes[name] = await server.nodes.objects.add_variable(id, name, start)
        await nodes[name].set_writable()
    missing = {"from": 20, "to": 22, "seen": False}
    async with server:
        running = asyncio.create_task(plant(server, nodes, missing))
        await gateway.run(URL, f"ns={space};s=Plant.{{name}}", address, steps=120)
        running.cancel()
        x1, count = await nodes["x1"].read_value(), await nodes["heartbeat"].read_value()
    process.terminate()
    process.wait()
    print(f"x1 = {x1:.4f} after {count} samples")
    assert missing["seen"] and count == 120
    assert abs(x1 + 0.5) < 0.05, x1


check_that_missed_samples_are_skipped()
asyncio.run(main(sys.argv[1]))
