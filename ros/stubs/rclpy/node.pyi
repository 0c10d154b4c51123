from collections.abc import Callable
from typing import Any, Generic, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.qos import QoSProfile

Message = TypeVar("Message")

class Parameter:
    @property
    def value(self) -> Any: ...

class Publisher(Generic[Message]):
    def publish(self, msg: Message) -> None: ...

class Logger:
    def error(self, message: str) -> bool: ...
    def info(self, message: str) -> bool: ...

class Time:
    @property
    def nanoseconds(self) -> int: ...

class Clock:
    def now(self) -> Time: ...

class Timer: ...

class Node:
    def __init__(self, node_name: str) -> None: ...
    def declare_parameter(self, name: str, value: str | bool | int) -> Parameter: ...
    def create_publisher(
        self, msg_type: type[Message], topic: str, qos_profile: QoSProfile | int
    ) -> Publisher[Message]: ...
    def create_service(
        self,
        srv_type: type[Any],
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        callback_group: CallbackGroup | None = None,
    ) -> Any: ...
    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], None],
        callback_group: CallbackGroup | None = None,
    ) -> Timer: ...
    def get_clock(self) -> Clock: ...
    def get_logger(self) -> Logger: ...
    def destroy_node(self) -> None: ...
