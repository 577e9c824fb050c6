"""Settings read from JSON: a dataclass a section, whose fields say what their keys may hold.

Every key is needed and no other is taken; the unit stands in the key's name.
"""

from __future__ import annotations

import json
import math
import os
import random
import stat
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TypeVar

from sim_bridge import files
from sim_bridge.errors import BridgeError
from sim_bridge.messages import NAME_CAPACITY

_Settings = TypeVar("_Settings")


# Largest file [bytes]: a scene has some thousand, the summary of a controller some ten thousand.
BYTES_MAX = 4 << 20
# Largest number: its square is finite, and no quantity of a scene is near it.
NUMBER_MAX = 1e12


def read_text(file: Path) -> str:
    """The text of a file of at most 4 MiB; raises `BridgeError` naming the file."""
    try:
        # A pipe that nobody writes to would be waited for when it is opened.
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as stream:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise BridgeError(f"{file}: expected a file, found a device, a pipe or a folder")
            content = stream.read(BYTES_MAX + 1)
    except OSError as error:
        raise BridgeError(f"{file}: cannot be read: {error.strerror}") from error
    if len(content) > BYTES_MAX:
        raise BridgeError(f"{file}: expected at most {BYTES_MAX} bytes, found more")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise BridgeError(
            f"{file}: expected text in UTF-8, found something else from byte {error.start} on"
        ) from error


def read_json(file: Path) -> object:
    """What a JSON file of at most 4 MiB holds; raises `BridgeError` naming the file."""
    try:
        return json.loads(read_text(file))
    except ValueError as error:
        raise BridgeError(f"{file}: is not JSON: {error}") from error
    except RecursionError as error:
        raise BridgeError(f"{file}: is nested deeper than any file of ours") from error


@dataclass(frozen=True)
class Range:
    """From where a seed draws uniformly."""

    low: float
    high: float

    def draw(self, generator: random.Random) -> float:
        """One value."""
        return self.low + (self.high - self.low) * generator.random()


@dataclass(frozen=True)
class _Rule:
    """What a key may hold."""

    expected: str
    accepts: Callable[[object], bool]
    convert: Callable[[object], object]


def key(expected: str, accepts: Callable, convert: Callable) -> object:
    """A field of a section: what is expected, whether a value is that, and its conversion."""
    return field(metadata={"rule": _Rule(expected, accepts, convert)})


def is_number(value: object) -> bool:
    """Whether it is a number that can be computed with: whole ones may be too large for a float."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and abs(value) <= NUMBER_MAX


def are_numbers(value: object, count: int) -> bool:
    """Whether they are finite numbers, as many as asked for."""
    return isinstance(value, list) and len(value) == count and all(map(is_number, value))


def floats(value: list) -> tuple[float, ...]:
    """Numbers as they are computed with."""
    return tuple(map(float, value))


def number(low: float = 0.0, high: float = math.inf) -> object:
    """A number of a range."""
    expected = f"a number from {low:g} to {high:g}"
    return key(expected, lambda value: is_number(value) and low <= value <= high, float)


def positive() -> object:
    """A number above 0."""
    return key("a number above 0", lambda value: is_number(value) and value > 0.0, float)


def whole(low: int) -> object:
    """A whole number."""

    def accepts(value: object) -> bool:
        return isinstance(value, int) and not isinstance(value, bool) and value >= low

    return key(f"a whole number of {low} or more", accepts, int)


def size() -> object:
    """Lengths of a box."""

    def accepts(value: object) -> bool:
        return are_numbers(value, 3) and min(value) > 0.0

    return key("three numbers above 0", accepts, floats)


def interval(low_min: float = -math.inf) -> object:
    """A range from which a seed draws."""

    def accepts(value: object) -> bool:
        return are_numbers(value, 2) and low_min <= value[0] <= value[1]

    expected = "a range [low, high] with low <= high"
    if low_min > -math.inf:
        expected += f", low at least {low_min:g}"
    return key(expected, accepts, lambda value: Range(*floats(value)))


def text() -> object:
    """A text."""
    return key("a text that is not empty", lambda value: isinstance(value, str) and value, str)


def name(bytes_max: int = NAME_CAPACITY) -> object:
    """A name; by default one that a message carries."""

    def accepts(value: object) -> bool:
        return files.is_name(value) and len(value.encode()) <= bytes_max

    return key(files.NAME.replace(str(files.NAME_BYTES_MAX), str(bytes_max)), accepts, str)


def path() -> object:
    """A path relative to the file."""
    return key("a text that is not empty", lambda value: isinstance(value, str) and value, Path)


def section(kind: type[_Settings], file: Path, name: str, values: object) -> _Settings:
    """One object of the file, checked by the rules of its keys; without a name the whole file."""
    rules = {item.name: item.metadata["rule"] for item in fields(kind)}
    check_keys(file, name, values, {key: rule.expected for key, rule in rules.items()})
    settings = {}
    for key, rule in rules.items():
        if not rule.accepts(values[key]):
            raise refused(file, f"{name}.{key}".lstrip("."), rule.expected, values[key])
        value = rule.convert(values[key])
        # Kept relative: error messages stay short and what is written does not name this machine.
        settings[key] = file.parent / value if isinstance(value, Path) else value
    return kind(**settings)


def check_keys(file: Path, name: str, values: object, expected: dict[str, str]) -> None:
    """Raises `BridgeError` unless every key is there, and no other one."""
    if not isinstance(values, dict):
        raise refused(file, name, "an object", values)
    prefix = f"{name}." if name else ""
    for key, what in expected.items():
        if key not in values:
            raise BridgeError(f"{file}: `{prefix}{key}` is missing: expected {what}")
    for key in values:
        if key not in expected:
            raise refused(file, f"{prefix}{key}", "no such key", values[key])


def refused(file: Path, key: str, expected: str, value: object) -> BridgeError:
    """The error of a value that is not what was expected."""
    found = json.dumps(value)
    found = found if len(found) <= 60 else f"{found[:57]}..."
    return BridgeError(f"{file}: `{key}`: expected {expected}, found {found}")
