"""Steers a plant behind an OPC UA server: measurements, references and inputs are its nodes, the controller
is `pinc serve`.

    pip install asyncua
    pinc serve configs/van-der-pol/control.toml --only rk4 --listen 127.0.0.1:5025 &
    python3 examples/opc-ua/gateway.py opc.tcp://plc:4840 'ns=2;s=Plant.{name}' 127.0.0.1:5025

The second argument is the id of a node, with `{name}` for the names of measurements, of inputs, and of
references with `_ref` behind them. Every sample the gateway reads, asks for a step and writes the inputs.
A node that cannot be read, or whose quality is bad, is a missing measurement; a reference that is missing
is the config's. A late sample is taken at once; those before it that a stall has missed are skipped. When
the controller or the server is gone the gateway ends, and the plant's own supervision has to take over:
watch the node `{name}` = `heartbeat`, which counts the samples.
"""

import asyncio
import json
import math
import sys

from asyncua import Client, ua


class Controller:
    """`pinc serve` at a port."""

    def __init__(self, reader, writer):
        self.reader, self.writer = reader, writer

    async def ask(self, **request):
        """The answer to a request; an error of the controller is raised."""
        self.writer.write(json.dumps(request).encode() + b"\n")
        await self.writer.drain()
        answer = json.loads(await self.reader.readline() or '{"error": "the controller has ended"}')
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer


async def read(nodes):
    """Numbers of nodes; None where one is missing."""
    found = await asyncio.gather(*(node.read_value() for node in nodes), return_exceptions=True)
    good = [isinstance(value, (int, float)) and math.isfinite(value) for value in found]
    return [float(value) if is_good else None for value, is_good in zip(found, good)]


async def write(node, value, kind=ua.VariantType.Double):
    """Writes a number without a time of its own, which many servers refuse."""
    await node.write_value(ua.DataValue(ua.Variant(value, kind)))


def following(due, step_s, now):
    """When the sample after the one at `due` is due, and how many before it have been missed."""
    due += step_s
    missed = max(0, math.floor((now - due) / step_s))
    return due + missed * step_s, missed


async def run(url, pattern, address, steps=None):
    """Steers until the controller or the server is gone, or for a number of steps."""
    host, port = address.rsplit(":", 1)
    controller = Controller(*await asyncio.open_connection(host, int(port)))
    about = await controller.ask(command="describe")
    async with Client(url) as server:
        def nodes(names, ending=""):
            return [server.get_node(pattern.format(name=name + ending)) for name in names]

        measured, targets = nodes(about["measured"]), nodes(about["controlled"], "_ref")
        inputs = nodes(one["name"] for one in about["inputs"])
        (heartbeat,) = nodes(["heartbeat"])
        clock = asyncio.get_running_loop()
        due, count = clock.time(), 0
        while steps is None or count < steps:
            reference = await read(targets)
            request = {"y": await read(measured)}
            if None not in reference:
                request["reference"] = reference
            answer = await controller.ask(**request)
            await asyncio.gather(*(write(node, u) for node, u in zip(inputs, answer["u"])))
            count += 1
            await write(heartbeat, count, ua.VariantType.Int64)
            if answer["status"] != "converged":
                print(f"sample {count}: {answer['status']}", file=sys.stderr)
            due, missed = following(due, about["sample_time_s"], clock.time())
            if missed > 0:
                print(f"sample {count}: {missed} missed after it", file=sys.stderr)
            await asyncio.sleep(max(0.0, due - clock.time()))
    controller.writer.close()


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    asyncio.run(run(*sys.argv[1:]))
