"""Steers a plant on ROS 2 topics; the controller is `pinc serve`.

    pip install cyclonedds
    pinc serve configs/van-der-pol/control.toml --only rk4 --listen 127.0.0.1:5025 &
    python3 examples/ros2/node.py 127.0.0.1:5025

It speaks DDS as ROS 2 nodes do, so that it needs no installation of ROS 2. `ROS_DOMAIN_ID` is the domain.

| topic | type | meaning |
|---|---|---|
| /pinc/measurement | std_msgs/Float64MultiArray | in, what is measured, in the order of `describe` |
| /pinc/reference | std_msgs/Float64MultiArray | in, for the controlled quantities; until one comes, the config's |
| /pinc/input | std_msgs/Float64MultiArray | out, every sample |
| /pinc/status | std_msgs/String | out, every sample |

Every sample it takes the newest measurement since the last sample; without one, all measurements count as
missing. When the controller is gone the node ends, and the plant's own supervision has to take over.
"""

import json
import os
import socket
import sys
import time
from dataclasses import dataclass

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Dimension(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayDimension_"):
    label: str
    size: uint32
    stride: uint32


@dataclass
class Layout(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayLayout_"):
    dim: sequence[Dimension]
    data_offset: uint32


@dataclass
class Numbers(IdlStruct, typename="std_msgs.msg.dds_.Float64MultiArray_"):
    layout: Layout
    data: sequence[float64]


@dataclass
class Text(IdlStruct, typename="std_msgs.msg.dds_.String_"):
    data: str


NEWEST = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1))


def numbers(values):
    """A list of numbers without a layout."""
    return Numbers(Layout([], 0), list(values))


class Topics:
    """The topics of one participant, by the names that ROS 2 has for them."""

    def __init__(self):
        self.participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))

    def reader(self, name, kind=Numbers):
        return DataReader(self.participant, Topic(self.participant, f"rt/{name}", kind), NEWEST)

    def writer(self, name, kind=Numbers):
        return DataWriter(self.participant, Topic(self.participant, f"rt/{name}", kind), NEWEST)


def newest(reader):
    """The newest list since the last call; None without one."""
    samples = [sample.data for sample in reader.take(N=8) if isinstance(sample, Numbers)]
    return samples[-1] if samples else None


def run(address, steps=None):
    """Steers until the controller is gone, or for a number of steps."""
    host, port = address.rsplit(":", 1)
    topics = Topics()
    measurement, targets = topics.reader("pinc/measurement"), topics.reader("pinc/reference")
    plant, states = topics.writer("pinc/input"), topics.writer("pinc/status", Text)
    with socket.create_connection((host, int(port))) as connection, connection.makefile("rw") as line:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def ask(**request):
            line.write(json.dumps(request) + "\n")
            line.flush()
            answer = json.loads(line.readline() or '{"error": "the controller has ended"}')
            if "error" in answer:
                raise ValueError(answer["error"])
            return answer

        about = ask(command="describe")
        missing = [None] * len(about["measured"])
        request = {}
        due, count = time.monotonic(), 0
        while steps is None or count < steps:
            request["y"] = newest(measurement) or missing
            request["reference"] = newest(targets) or request.get("reference")
            answer = ask(**{key: value for key, value in request.items() if value is not None})
            plant.write(numbers(answer["u"]))
            states.write(Text(answer["status"]))
            due, count = due + about["sample_time_s"], count + 1
            time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    run(sys.argv[1])
