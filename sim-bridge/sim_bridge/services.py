"""Opening the services of an instance, with errors a user can act on, and stopping cleanly."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

import iceoryx2

from sim_bridge.errors import BridgeError
from sim_bridge.instance_files import Files, check_memory
from sim_bridge.wire import (
    FRAME_SOURCES_MAX,
    SERVICES,
    ControllerStatus,
    JointCommand,
    RobotState,
    TaskFrames,
    ToolCommand,
)

if TYPE_CHECKING:
    from typing_extensions import Self

_NAME = re.compile(r"[A-Za-z0-9-]{1,32}")
_PORT_ERRORS = (
    iceoryx2.PublishSubscribeOpenOrCreateError,
    iceoryx2.PublisherCreateError,
    iceoryx2.SubscriberCreateError,
)


class Instance:
    """One running system: a robot, its publisher and its controller have one instance name.

    Its files are `/dev/shm/tprmp_<user id>_<name>_*` and the folder `/tmp/tprmp-<user id>/<name>/`,
    readable and writable by this user only: two users may each have an instance of one name.
    """

    def __init__(self, name: str) -> None:
        if not _NAME.fullmatch(name):
            raise BridgeError(
                f"instance name `{name}`: expected 1 to 32 of the characters a-z, A-Z, 0-9 and `-`"
            )
        self.name = name
        self.files = Files(name)

    def node(self) -> iceoryx2.Node:
        """A node of this instance; raises `BridgeError` when it cannot be created."""
        check_memory()
        iceoryx2.set_log_level(iceoryx2.LogLevel.Error)
        config = iceoryx2.config.default()
        config.global_cfg.prefix = iceoryx2.FileName.new(self.files.prefix)
        config.global_cfg.root_path = iceoryx2.Path.new(f"{self.files.folder}/")
        try:
            return (
                iceoryx2.NodeBuilder.new()
                .config(config)
                .signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)
                .create(iceoryx2.ServiceType.Ipc)
            )
        except iceoryx2.NodeCreationFailure as error:
            raise BridgeError(
                f"no shared-memory node could be created ({error}): check that {self.files.folder} "
                "and /dev/shm are writable by this user; `controller clean` removes what killed "
                "processes left"
            ) from error

    def service(
        self, node: iceoryx2.Node, topic: str, message: type[ctypes.Structure]
    ) -> iceoryx2.PortFactoryPublishSubscribe:
        """Opens or creates a service; raises `BridgeError` when the other side differs."""
        bounds = self.bounds(topic)
        with self._explained(topic, message):
            service = (
                node.service_builder(iceoryx2.ServiceName.new(self._name(topic)))
                .publish_subscribe(message)
                .max_publishers(bounds["max_publishers"])
                .max_subscribers(bounds["max_subscribers"])
                .max_nodes(bounds["max_nodes"])
                .history_size(bounds["history_size"])
                .subscriber_max_buffer_size(bounds["subscriber_max_buffer_size"])
                .enable_safe_overflow(bounds["has_safe_overflow"])
                .open_or_create()
            )
        # iceoryx2 compares some of them only, and only where they are smaller.
        found = {bound: getattr(service.static_config, bound) for bound in bounds}
        if found != bounds:
            raise BridgeError(
                f"service `{self._name(topic)}` exists with other bounds: expected "
                f"{_listed(bounds)}; found {_listed(found)}: make it with the expected ones"
            )
        return service

    @staticmethod
    def bounds(topic: str) -> dict[str, int | bool]:
        """What the service of a topic is made with, on both sides."""
        return {name: bound for name, bound in SERVICES[topic].items() if name != "name"}

    def publisher(
        self, node: iceoryx2.Node, topic: str, message: type[ctypes.Structure]
    ) -> iceoryx2.Publisher:
        """The publisher of a service; raises `BridgeError` when there is one already."""
        service = self.service(node, topic, message)
        with self._explained(topic, message):
            return service.publisher_builder().create()

    def subscriber(
        self, node: iceoryx2.Node, topic: str, message: type[ctypes.Structure]
    ) -> iceoryx2.Subscriber:
        """A subscriber of a service, which gets the newest message."""
        service = self.service(node, topic, message)
        with self._explained(topic, message):
            return service.subscriber_builder().buffer_size(1).create()

    def _name(self, topic: str) -> str:
        return SERVICES[topic]["name"].replace("<instance>", self.name)

    @contextmanager
    def _explained(self, topic: str, message: type[ctypes.Structure]) -> Iterator[None]:
        """Turns iceoryx2's errors into `BridgeError`; their kind stands in their text alone."""
        try:
            yield
        except _PORT_ERRORS as error:
            service = f"service `{self._name(topic)}`"
            text = f"{service} could not be opened: {error}"
            if "IncompatibleTypes" in str(error):
                text = (
                    f"{service} exists with another message type or size than this program's "
                    f"{message.type_name()} of {ctypes.sizeof(message)} bytes: both sides must be "
                    "of the same version"
                )
            if "ExceedsMaxSupportedPublishers" in str(error):
                text = f"{service} already has a publisher: another one is running on this instance"
                if topic == "task_frames":
                    text = f"{service} already has {FRAME_SOURCES_MAX} sources of frames: end one"
            raise BridgeError(text) from error


def _listed(bounds: dict[str, int | bool]) -> str:
    return ", ".join(f"{name} {value}" for name, value in bounds.items())


class _Ports:
    """Ports of an instance; closed at the end of the `with` block, without leftovers."""

    def __init__(self, instance: Instance) -> None:
        self._instance = instance
        self._node = None
        claimed = False
        try:
            with instance.files.claim():
                claimed = True
                self._node = instance.node()
                self._open(instance, self._node)
                instance.files.reserve()
        except BridgeError:
            # Without the lock, which closing takes itself; what is not ours stays as it is.
            if claimed:
                self.close()
            raise

    def _open(self, instance: Instance, node: iceoryx2.Node) -> None:
        """Opens the ports, as attributes."""
        raise NotImplementedError

    def close(self) -> None:
        """Closes every port and then the node, and removes what they leave."""
        for port in [name for name in vars(self) if not name.startswith("_")]:
            delattr(self, port)
        self._node = None
        self._instance.files.remove_leftovers()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class StatePublisherPorts(_Ports):
    """The ports of a state publisher."""

    def _open(self, instance: Instance, node: iceoryx2.Node) -> None:
        self.state = instance.publisher(node, "robot_state", RobotState)
        self.frames = instance.publisher(node, "task_frames", TaskFrames)
        self.command = instance.subscriber(node, "joint_command", JointCommand)
        self.status = instance.subscriber(node, "controller_status", ControllerStatus)

    def publish(self, frames: TaskFrames, state: RobotState) -> None:
        """Publishes the frames first, so that whoever waits for the state finds both."""
        self.frames.send_copy(frames)
        self.state.send_copy(state)

    def receive_command(self, into: JointCommand) -> bool:
        """Copies the newest command that was not received yet; `False` when there is none."""
        return _receive(self.command, into)

    def receive_status(self, into: ControllerStatus) -> bool:
        """Copies the newest status that was not received yet; `False` when there is none."""
        return _receive(self.status, into)

    def update_connections(self) -> None:
        """Connects to subscribers that appeared, which hands them the last message."""
        self.frames.update_connections()
        self.state.update_connections()


class FrameSourcePorts(_Ports):
    """The port of a source of frames beside the state publisher, with a `source` of its own."""

    def _open(self, instance: Instance, node: iceoryx2.Node) -> None:
        self.frames = instance.publisher(node, "task_frames", TaskFrames)

    def publish(self, frames: TaskFrames) -> int:
        """Publishes frames and obstacles; returns how many read them."""
        return self.frames.send_copy(frames)


class ToolCommandPorts(_Ports):
    """The ports of an external command of the tool, beside the skill."""

    def _open(self, instance: Instance, node: iceoryx2.Node) -> None:
        self.command = instance.publisher(node, "tool_command", ToolCommand)
        self.state = instance.subscriber(node, "robot_state", RobotState)

    def publish(self, command: ToolCommand) -> int:
        """Publishes a command; returns how many controllers listen."""
        return self.command.send_copy(command)

    def receive_state(self, into: RobotState) -> bool:
        """Copies the newest state that was not received yet; `False` when there is none."""
        return _receive(self.state, into)


def _receive(subscriber: iceoryx2.Subscriber, into: ctypes.Structure) -> bool:
    sample = subscriber.receive()
    if sample is None:
        return False
    ctypes.memmove(ctypes.byref(into), sample.payload_ptr, ctypes.sizeof(into))
    sample.delete()
    return True


SIGNALS_TOGETHER_S = 0.5
"""Signals within this time are one: launchers and supervisors send theirs to a process and to its
group."""


class StopSignal:
    """SIGINT, SIGTERM and SIGHUP ask for a clean stop.

    Another one that comes half a second after the first, or later, ends the process at once.
    """

    def __init__(self) -> None:
        self._first_s: float | None = None
        self._before: dict[int, object] = {}

    @property
    def requested(self) -> bool:
        """Whether a signal has come."""
        return self._first_s is not None

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        now_s = time.monotonic()
        if self._first_s is None:
            self._first_s = now_s
        elif now_s - self._first_s >= SIGNALS_TOGETHER_S:
            os._exit(128 + number)

    def __enter__(self) -> StopSignal:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            self._before[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
