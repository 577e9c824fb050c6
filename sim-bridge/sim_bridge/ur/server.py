"""A server that stands in for a Universal Robot: RTDE, the scripts' ports and the dashboard.

It speaks RTDE of protocol version 2 (port 30004), runs URScript that arrives at the ports 30001 to
30003, and answers the dashboard (29999) as far as clients need it to start. The arm behind it is
`arm.py`. It streams nothing at the scripts' ports.
"""

from __future__ import annotations

import re
import selectors
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from sim_bridge.errors import BridgeError
from sim_bridge.ur import protocol, urscript
from sim_bridge.ur.arm import Arm, Safety
from sim_bridge.ur.protocol import Kind, ProtocolError, Recipe

RTDE_PORT = 30004
SCRIPT_PORTS = (30001, 30002, 30003)
DASHBOARD_PORT = 29999
BEHIND_MAX_S = 0.02
"""So much is caught up with; what the machine was late by beyond is left out [s]."""
UNSENT_MAX = 1 << 20
"""A client that leaves more than this unread is let go [bytes]."""
VERSIONS = {125: (3, 15, 8, 106339), 500: (5, 12, 6, 1102099)}
"""Of the controller's software, by its rate [Hz]."""


@dataclass
class Client:
    """A connection, and what was agreed with it."""

    socket: socket.socket
    receive: Callable[[Client, bytes], None]
    reader: protocol.Reader = field(default_factory=protocol.Reader)
    text: str = ""
    unsent: bytearray = field(default_factory=bytearray)
    version: int = 1
    outputs: Recipe | None = None
    every: int = 1
    """A data package every so many steps."""
    started: bool = False
    inputs: dict[int, Recipe] = field(default_factory=dict)
    closed: bool = False


class Server:
    """Listens at `host`; `step` does all that is due in one period of the arm."""

    def __init__(self, host: str, arm: Arm) -> None:
        self.host, self.arm = host, arm
        self.rate_hz = round(1.0 / arm.period_s)
        self.version = VERSIONS.get(self.rate_hz, VERSIONS[500])
        self.steps = 0
        self.clients: list[Client] = []
        self._selector = selectors.DefaultSelector()
        self._listening: list[socket.socket] = []
        ports = {RTDE_PORT: self._rtde, DASHBOARD_PORT: self._dashboard}
        ports.update(dict.fromkeys(SCRIPT_PORTS, self._script))
        try:
            for port, receive in ports.items():
                self._listen(port, receive)
        except OSError as error:
            self.close()
            raise BridgeError(
                f"{host}:{port} cannot be listened at ({error.strerror}): clients of a UR expect "
                "these ports; end what uses them, or choose another --host, such as 127.0.0.2"
            ) from error

    def _listen(self, port: int, receive: Callable[[Client, bytes], None]) -> None:
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listening.append(listening)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((self.host, port))
        listening.listen()
        listening.setblocking(False)
        self._selector.register(listening, selectors.EVENT_READ, receive)

    def close(self) -> None:
        """Ends every connection."""
        for client in list(self.clients):
            self._drop(client)
        for listening in self._listening:
            listening.close()
        self._selector.close()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # The loop.

    def run(self, stopped: Callable[[], bool]) -> None:
        """Steps on the machine's clock until `stopped`."""
        due_s = time.monotonic()
        while not stopped():
            self.step()
            period_s = self.arm.period_s
            due_s = max(due_s + period_s, time.monotonic() - BEHIND_MAX_S)
            while not stopped():
                left_s = due_s - time.monotonic()
                self.serve(max(0.0, left_s))
                if time.monotonic() >= due_s:
                    break

    def step(self) -> None:
        """One period of the arm, and the data packages of it."""
        self.arm.step()
        self.steps += 1
        for client in list(self.clients):
            if client.started and self.steps % client.every == 0:
                values = [self.arm.output(name) for name in client.outputs.names]
                self._send(client, protocol.package(Kind.DATA, client.outputs.pack(values)))

    def serve(self, wait_s: float) -> None:
        """Reads what has arrived, waiting up to `wait_s` for something."""
        for key, _ in self._selector.select(wait_s):
            if isinstance(key.data, Client):
                self._read(key.data)
            else:
                self._accept(key.fileobj, key.data)
        for client in [client for client in self.clients if client.closed]:
            self._drop(client)

    def _accept(self, listening: socket.socket, receive: Callable) -> None:
        connection, _ = listening.accept()
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = Client(connection, receive)
        self.clients.append(client)
        self._selector.register(connection, selectors.EVENT_READ, client)
        if receive == self._dashboard:
            self._send(client, b"Connected: Universal Robots Dashboard Server\n")

    def _read(self, client: Client) -> None:
        try:
            data = client.socket.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            client.closed = True
            return
        try:
            client.receive(client, data)
        except ProtocolError as error:
            # After what is no package nobody knows where the next one begins.
            self._send(client, protocol.text(str(error)))
            client.closed = True

    def _send(self, client: Client, data: bytes) -> None:
        client.unsent += data
        try:
            del client.unsent[: client.socket.send(client.unsent)]
        except BlockingIOError:
            client.closed |= len(client.unsent) > UNSENT_MAX
        except OSError:
            client.closed = True

    def _drop(self, client: Client) -> None:
        self.clients.remove(client)
        self._selector.unregister(client.socket)
        client.socket.close()

    # RTDE.

    def _rtde(self, client: Client, data: bytes) -> None:
        for kind, content in client.reader.feed(data):
            if kind not in (Kind.VERSION, Kind.CONTROL_VERSION) and client.version != 2:
                raise ProtocolError("expected protocol version 2 to be requested first")
            answer = {
                Kind.VERSION: self._choose_version,
                Kind.CONTROL_VERSION: self._control_version,
                Kind.OUTPUTS: self._set_up_outputs,
                Kind.INPUTS: self._set_up_inputs,
                Kind.START: self._start,
                Kind.PAUSE: self._pause,
                Kind.DATA: self._data,
                Kind.TEXT: lambda *_: None,
            }[kind](client, content)
            if answer is not None:
                self._send(client, protocol.package(kind, answer))

    @staticmethod
    def _choose_version(client: Client, content: bytes) -> bytes:
        if len(content) != 2:
            raise ProtocolError(f"a version: expected 2 bytes, found {len(content)}")
        accepted = int.from_bytes(content, "big") == protocol.VERSION
        client.version = 2 if accepted else client.version
        return bytes([accepted])

    def _control_version(self, _client: Client, _content: bytes) -> bytes:
        return b"".join(part.to_bytes(4, "big") for part in self.version)

    @staticmethod
    def _names(content: bytes) -> list[str]:
        return [name for name in content.decode("ascii", "replace").split(",") if name]

    def _set_up_outputs(self, client: Client, content: bytes) -> bytes:
        if len(content) < 8:
            raise ProtocolError(f"an output recipe: expected 8 bytes or more, found {len(content)}")
        frequency_hz = struct.unpack(">d", content[:8])[0]
        names = self._names(content[8:])
        kinds = [protocol.OUTPUTS.get(name, protocol.NOT_FOUND) for name in names]
        fits = 1.0 <= frequency_hz <= self.rate_hz and names
        client.started, client.outputs = False, None
        if fits and protocol.NOT_FOUND not in kinds:
            client.outputs = Recipe(1, names, protocol.OUTPUTS)
            client.every = round(self.rate_hz / frequency_hz)
        return bytes([client.outputs is not None]) + ",".join(kinds).encode()

    def _set_up_inputs(self, client: Client, content: bytes) -> bytes:
        names = self._names(content)
        taken = {
            name
            for other in self.clients
            if other is not client
            for recipe in other.inputs.values()
            for name in recipe.names
        }
        kinds = [
            protocol.IN_USE if name in taken else protocol.INPUTS.get(name, protocol.NOT_FOUND)
            for name in names
        ]
        number = 0
        if names and not {protocol.IN_USE, protocol.NOT_FOUND} & set(kinds):
            number = len(client.inputs) + 1
            if number > 255:
                raise ProtocolError("expected at most 255 input recipes")
            client.inputs[number] = Recipe(number, names, protocol.INPUTS)
        return bytes([number]) + ",".join(kinds).encode()

    @staticmethod
    def _start(client: Client, _content: bytes) -> bytes:
        client.started = client.outputs is not None
        return bytes([client.started])

    @staticmethod
    def _pause(client: Client, _content: bytes) -> bytes:
        client.started = False
        return b"\x01"

    def _data(self, client: Client, content: bytes) -> None:
        recipe = client.inputs.get(content[0]) if content else None
        if recipe is None:
            raise ProtocolError("a data package: expected the number of an input recipe")
        self.arm.write(recipe.unpack(content))

    # Scripts.

    def _script(self, client: Client, data: bytes) -> None:
        client.text += data.decode("utf-8", "replace").replace("\r", "")
        if len(client.text) > urscript.BYTES_MAX:
            raise ProtocolError(f"a program: expected at most {urscript.BYTES_MAX} bytes")
        programs, client.text = urscript.complete(client.text)
        for program in programs:
            if program.strip() == "run program":
                continue
            try:
                self.arm.play(program)
            except urscript.ScriptError as error:
                self.arm.stop_program(f"another one {error}")
                self.arm.messages.append(f"a program {error}")

    # The dashboard.

    def _dashboard(self, client: Client, data: bytes) -> None:
        client.text += data.decode("utf-8", "replace").replace("\r", "")
        *lines, client.text = client.text[-4096:].split("\n")
        for line in lines:
            self._send(client, f"{self._answer(line.strip())}\n".encode())

    def _answer(self, line: str) -> str:
        arm = self.arm
        state = "PLAYING program" if arm.playing else "STOPPED program"
        answers = {
            "PolyscopeVersion": "URSoftware " + ".".join(map(str, self.version)),
            "running": f"Program running: {str(arm.playing).lower()}",
            "programState": state,
            "is in remote control": "true",
            "robotmode": f"Robotmode: {arm.mode.name}",
            "safetymode": f"Safetymode: {arm.safety.name}",
            "safetystatus": f"Safetystatus: {arm.safety.name}",
            "close popup": "closing popup",
            "close safety popup": "closing safety popup",
            "get robot model": "UR5",
            "get serial number": "20000000",
        }
        if line in answers:
            return answers[line]
        if line == "stop":
            arm.stop_program("the dashboard said so")
            return "Stopped"
        if line == "unlock protective stop":
            stopped = arm.safety == Safety.PROTECTIVE_STOP
            arm.release()
            return "Protective stop releasing" if stopped else "Robot is not in protective stop"
        if re.match(r"popup |addToLog ", line):
            return "done"
        return f"could not understand: '{line}'"
