"""As much of rclpy as the node uses, in this process: messages are those of the package rosbags."""

from __future__ import annotations

import array
import sys
import types
from dataclasses import dataclass, field

import numpy as np


def checked(kinds, name, given):
    """A message, after checks of its fields that rclpy makes and rosbags does not."""
    plain = {}
    for key, value in given.items():
        if isinstance(value, array.array):
            assert value.typecode in "Bd"
            value = np.frombuffer(value, np.uint8 if value.typecode == "B" else np.float64)
        elif isinstance(value, np.ndarray):
            assert value.dtype == np.float64, f"{name}.{key}: rclpy takes fixed arrays of doubles"
            assert value.ndim == 1
        elif isinstance(value, bytes):
            assert len(value) == 1
            value = value[0]
        else:
            assert not isinstance(value, np.generic), f"{name}.{key}: rclpy takes no NumPy numbers"
        plain[key] = value
    return kinds[name](**plain)


@dataclass
class Topic:
    name: str
    latched: bool
    messages: list = field(default_factory=list)

    def publish(self, message):
        self.messages.append(message)


class Node:
    given: dict = {}  # noqa: RUF012, set by the tests
    now_ns = 1_800_000_000_123_456_789

    def __init__(self, name):
        self.name = name
        self.topics, self.services, self.timers, self.errors = {}, {}, [], []

    def declare_parameter(self, name, default):
        value = self.given.get(name, default)
        assert type(value) is type(default)
        return types.SimpleNamespace(value=value)

    def create_publisher(self, _, name, quality):
        topic = Topic(name.replace("~", f"/{self.name}"), quality != 10)
        self.topics[topic.name] = topic
        return topic

    def create_service(self, _, name, callback, **__):
        self.services[name.replace("~", f"/{self.name}")] = callback

    def create_timer(self, _, callback, **__):
        self.timers.append(callback)

    def get_clock(self):
        now = types.SimpleNamespace(nanoseconds=self.now_ns)
        return types.SimpleNamespace(now=lambda: now)

    def get_logger(self):
        return types.SimpleNamespace(error=self.errors.append)

    def destroy_node(self):
        pass

    def call(self, name):
        """Call a service as a client does."""
        response = types.SimpleNamespace(success=None, message=None)
        return self.services[f"/{self.name}/{name}"](None, response)


def install(monkeypatch, kinds):
    """Put the modules in place for a test; ``kinds`` are the messages of rosbags by name."""

    def module(name, **content):
        made = types.ModuleType(name)
        vars(made).update(content)
        monkeypatch.setitem(sys.modules, name, made)

    def message(name):
        return lambda **given: checked(kinds, name, given)

    packages = {}
    for name in kinds:
        package, part, kind = name.split("/")
        if part == "msg":
            packages.setdefault(package, {})[kind] = message(name)
    for package, content in packages.items():
        module(package)
        module(f"{package}.msg", **content)
    module("std_srvs")
    module("std_srvs.srv", Trigger=types.SimpleNamespace(Request=None, Response=None))
    module("rclpy")
    plain = types.SimpleNamespace
    module(
        "rclpy.callback_groups", MutuallyExclusiveCallbackGroup=plain, ReentrantCallbackGroup=plain
    )
    module("rclpy.executors", ExternalShutdownException=KeyError, MultiThreadedExecutor=plain)
    module("rclpy.node", Node=Node)
    module(
        "rclpy.qos",
        DurabilityPolicy=plain(TRANSIENT_LOCAL=1),
        ReliabilityPolicy=plain(RELIABLE=1),
        QoSProfile=lambda **given: given,
    )
