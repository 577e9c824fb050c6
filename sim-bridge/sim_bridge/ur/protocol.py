"""Packages of RTDE, protocol version 2: how they are framed, and what variables they carry.

A package is its size [bytes] as uint16, its kind as uint8, and its content, all big-endian. Joint
quantities are in rad and rad/s.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum

VERSION = 2
HEADER = struct.Struct(">HB")
REGISTERS = 48
"""Registers of a kind, in each direction."""
NOT_FOUND = "NOT_FOUND"
IN_USE = "IN_USE"


class Kind(IntEnum):
    """What a package is."""

    VERSION = ord("V")
    CONTROL_VERSION = ord("v")
    TEXT = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")


CODES = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
"""Types of variables, as `struct` calls them."""


def _registers(direction: str) -> dict[str, str]:
    kinds = {"int": "INT32", "double": "DOUBLE"}
    names = {
        f"{direction}_{kind}_register_{i}": of for kind, of in kinds.items() for i in range(48)
    }
    bits = ("0_to_31", "32_to_63")
    return names | {f"{direction}_bit_registers{which}": "UINT32" for which in bits}


OUTPUTS = {
    "timestamp": "DOUBLE",
    "target_q": "VECTOR6D",
    "target_qd": "VECTOR6D",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    "runtime_state": "UINT32",
    "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE",
    "actual_digital_input_bits": "UINT64",
    "actual_digital_output_bits": "UINT64",
    **_registers("output"),
}
"""What the server can be asked for."""

INPUTS = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    **_registers("input"),
}
"""What the server can be told."""


class ProtocolError(Exception):
    """A package that is none: what was expected and found."""


class Recipe:
    """An ordered choice of variables, packed one after the other."""

    def __init__(self, number: int, names: Sequence[str], types: dict[str, str]) -> None:
        self.number = number
        self.names = tuple(names)
        self._types = [types[name] for name in names]
        self._layout = struct.Struct(">B" + "".join(CODES[kind] for kind in self._types))

    def pack(self, values: Sequence[object]) -> bytes:
        """The content of a data package."""
        flat: list[object] = []
        for kind, value in zip(self._types, values):
            if kind.startswith("VECTOR"):
                flat.extend(value)
            else:
                flat.append(value)
        return self._layout.pack(self.number, *flat)

    def unpack(self, content: bytes) -> dict[str, object]:
        """The values of a data package by name; raises `ProtocolError` at another length."""
        if len(content) != self._layout.size:
            raise ProtocolError(
                f"recipe {self.number}: expected {self._layout.size} bytes, found {len(content)}"
            )
        flat = list(self._layout.unpack(content))[1:]
        values = {}
        for name, kind in zip(self.names, self._types):
            count = int(kind[6]) if kind.startswith("VECTOR") else 1
            part, flat = flat[:count], flat[count:]
            values[name] = part if kind.startswith("VECTOR") else part[0]
        return values


def package(kind: Kind, content: bytes = b"") -> bytes:
    """A package with its header."""
    return HEADER.pack(HEADER.size + len(content), kind) + content


def text(message: str, level: int = 1) -> bytes:
    """A text message; levels are 0 exception, 1 error, 2 warning, 3 information."""
    data, source = message.encode()[:255], b"RTDE"
    content = bytes([len(data)]) + data + bytes([len(source)]) + source + bytes([level])
    return package(Kind.TEXT, content)


class Reader:
    """Splits what arrives at a connection into packages."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[tuple[Kind, bytes]]:
        """Whole packages so far; raises `ProtocolError` at a size or kind that cannot be."""
        self._buffer += data
        found = []
        while len(self._buffer) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._buffer)
            if size < HEADER.size:
                raise ProtocolError(f"a package's size: expected 3 or more, found {size}")
            if kind not in frozenset(Kind):
                raise ProtocolError(f"a package's kind: expected one of VvMUOISP, found {kind}")
            if len(self._buffer) < size:
                break
            found.append((Kind(kind), bytes(self._buffer[HEADER.size : size])))
            del self._buffer[:size]
        return found
