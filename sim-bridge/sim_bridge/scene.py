"""The scene file: what stands where, how it moves, and between which limits a seed draws it.

Every key is needed and no other is taken; the unit stands in the key's name. A pair of numbers is
a range from which each seed draws uniformly.
"""

from __future__ import annotations

import json
import math
import random
from dataclasses import dataclass
from pathlib import Path

from sim_bridge.errors import BridgeError

SCHEMA = "tprmp-scene/1"


@dataclass(frozen=True)
class Range:
    """From where a seed draws uniformly."""

    low: float
    high: float

    def draw(self, generator: random.Random) -> float:
        """One value."""
        return self.low + (self.high - self.low) * generator.random()


@dataclass(frozen=True)
class RobotSettings:
    """Which arm, and where it starts."""

    urdf: Path
    tool_link: str
    tip_link: str
    home_position_rad: tuple[float, ...]


@dataclass(frozen=True)
class PhysicsSettings:
    """Step rate and gravity."""

    rate_hz: float
    gravity_m_s2: float


@dataclass(frozen=True)
class TableSettings:
    """A box whose top is the plane z = 0 of the robot's base frame."""

    size_m: tuple[float, float, float]
    centre_xy_m: tuple[float, float]
    friction: float


@dataclass(frozen=True)
class ObjectSettings:
    """The box to be picked: it moves on a circle, just above the table, with a constant yaw."""

    size_m: tuple[float, float, float]
    mass_kg: float
    friction: float
    table_gap_m: float
    circle_radius_m: float
    circle_speed_rad_s: float
    circle_centre_x_m: Range
    circle_centre_y_m: Range
    circle_phase_rad: Range
    yaw_rad: Range


@dataclass(frozen=True)
class SphereSettings:
    """The obstacle: a ball that swings along y."""

    radius_m: float
    centre_x_m: Range
    centre_y_m: Range
    height_m: Range
    amplitude_y_m: Range
    speed_rad_s: Range
    phase_rad: Range
    object_clearance_min_m: float
    start_clearance_min_m: float


@dataclass(frozen=True)
class SuctionSettings:
    """The suction cup: soft, and it seals only when it touches."""

    contact_stiffness_n_m: float
    contact_damping_n_s_m: float
    cup_radius_m: float
    tilt_max_rad: float
    seal_time_s: float


@dataclass(frozen=True)
class TaskSettings:
    """What the task is, and when it is done."""

    skill: str
    demonstrations: Path
    start_frame: str
    goal_frame: str
    lift_height_m: float
    hold_time_s: float
    hold_speed_max_m_s: float
    time_limit_s: float


@dataclass(frozen=True)
class RecordSettings:
    """How the scripted expert demonstrates."""

    count: int
    seed: int
    duration_s: Range
    start_variation_rad: float
    vertical_end_m: float
    vertical_delay: float
    compression_m: float
    sampling_time_s: float
    tracking_stiffness_1_s2: float
    tracking_damping_1_s: float


@dataclass(frozen=True)
class Scene:
    """A scene file, checked."""

    file: Path
    robot: RobotSettings
    physics: PhysicsSettings
    table: TableSettings
    object: ObjectSettings
    sphere: SphereSettings
    suction: SuctionSettings
    task: TaskSettings
    record: RecordSettings


@dataclass(frozen=True)
class Motion:
    """Pose and velocity of something that only yaws, in B."""

    position_m: tuple[float, float, float]
    yaw_rad: float
    velocity_m_s: tuple[float, float, float]


@dataclass(frozen=True)
class Episode:
    """What one seed drew."""

    seed: int
    circle_centre_m: tuple[float, float, float]
    circle_radius_m: float
    circle_speed_rad_s: float
    circle_phase_rad: float
    object_yaw_rad: float
    sphere_centre_m: tuple[float, float, float]
    sphere_amplitude_y_m: float
    sphere_speed_rad_s: float
    sphere_phase_rad: float

    def object_motion(self, time_s: float) -> Motion:
        """Where the box is on its circle; the velocity is the derivative of the position."""
        angle = self.circle_phase_rad + self.circle_speed_rad_s * time_s
        c, s = self.circle_radius_m * math.cos(angle), self.circle_radius_m * math.sin(angle)
        x, y, z = self.circle_centre_m
        w = self.circle_speed_rad_s
        return Motion((x + c, y + s, z), self.object_yaw_rad, (-w * s, w * c, 0.0))

    def sphere_motion(self, time_s: float) -> Motion:
        """Where the sphere is on its swing; the velocity is the derivative of the position."""
        angle = self.sphere_phase_rad + self.sphere_speed_rad_s * time_s
        x, y, z = self.sphere_centre_m
        a, w = self.sphere_amplitude_y_m, self.sphere_speed_rad_s
        return Motion((x, y + a * math.cos(angle), z), 0.0, (0.0, -a * w * math.sin(angle), 0.0))


def draw_episode(scene: Scene, seed: int) -> Episode:
    """What `seed` draws: the same seed always draws the same."""
    if seed < 0:
        raise BridgeError(f"seed: expected a whole number of 0 or more, found {seed}")
    generator = random.Random(seed)
    box, sphere = scene.object, scene.sphere
    height = box.table_gap_m + 0.5 * box.size_m[2]
    direction = 1.0 if generator.random() < 0.5 else -1.0
    return Episode(
        seed=seed,
        circle_centre_m=(
            box.circle_centre_x_m.draw(generator),
            box.circle_centre_y_m.draw(generator),
            height,
        ),
        circle_radius_m=box.circle_radius_m,
        circle_speed_rad_s=direction * box.circle_speed_rad_s,
        circle_phase_rad=box.circle_phase_rad.draw(generator),
        object_yaw_rad=box.yaw_rad.draw(generator),
        sphere_centre_m=(
            sphere.centre_x_m.draw(generator),
            sphere.centre_y_m.draw(generator),
            sphere.height_m.draw(generator),
        ),
        sphere_amplitude_y_m=sphere.amplitude_y_m.draw(generator),
        sphere_speed_rad_s=sphere.speed_rad_s.draw(generator),
        sphere_phase_rad=sphere.phase_rad.draw(generator),
    )


class _Section:
    """One object of the file, whose keys are taken one by one."""

    def __init__(self, file: Path, path: str, value: object) -> None:
        if not isinstance(value, dict):
            raise BridgeError(f"{file}: `{path}`: expected an object, found {_shown(value)}")
        self._file, self._path, self._values = file, path, dict(value)

    def _key(self, key: str) -> str:
        return f"{self._path}.{key}" if self._path else key

    def error(self, key: str, expected: str, found: object) -> BridgeError:
        return BridgeError(
            f"{self._file}: `{self._key(key)}`: expected {expected}, found {_shown(found)}"
        )

    def take(self, key: str, expected: str) -> object:
        if key not in self._values:
            raise BridgeError(f"{self._file}: `{self._key(key)}` is missing: expected {expected}")
        return self._values.pop(key)

    def section(self, key: str) -> _Section:
        return _Section(self._file, self._key(key), self.take(key, "an object"))

    def number(self, key: str, low: float = 0.0, high: float = math.inf) -> float:
        expected = f"a number from {low:g} to {high:g}"
        value = self.take(key, expected)
        if not _is_number(value) or not low <= value <= high:
            raise self.error(key, expected, value)
        return float(value)

    def positive(self, key: str) -> float:
        value = self.take(key, "a number above 0")
        if not _is_number(value) or value <= 0.0:
            raise self.error(key, "a number above 0", value)
        return float(value)

    def whole(self, key: str, low: int) -> int:
        value = self.take(key, f"a whole number of {low} or more")
        if not isinstance(value, int) or isinstance(value, bool) or value < low:
            raise self.error(key, f"a whole number of {low} or more", value)
        return value

    def numbers(self, key: str, count: int | None, expected: str) -> tuple[float, ...]:
        value = self.take(key, expected)
        right = isinstance(value, list) and all(map(_is_number, value))
        if not right or (count is not None and len(value) != count) or not value:
            raise self.error(key, expected, value)
        return tuple(float(item) for item in value)

    def size(self, key: str) -> tuple[float, float, float]:
        x, y, z = value = self.numbers(key, 3, "three numbers above 0")
        if min(value) <= 0.0:
            raise self.error(key, "three numbers above 0", list(value))
        return x, y, z

    def range(self, key: str, low_min: float = -math.inf) -> Range:
        expected = "a range [low, high] with low <= high"
        if low_min > -math.inf:
            expected += f", low at least {low_min:g}"
        low, high = self.numbers(key, 2, expected)
        if not low_min <= low <= high:
            raise self.error(key, expected, [low, high])
        return Range(low, high)

    def text(self, key: str) -> str:
        value = self.take(key, "a text that is not empty")
        if not isinstance(value, str) or not value:
            raise self.error(key, "a text that is not empty", value)
        return value

    def path(self, key: str) -> Path:
        # Kept relative: error messages stay short and what is written does not name this machine.
        return self._file.parent / self.text(key)

    def done(self) -> None:
        for key, value in self._values.items():
            raise self.error(key, "no such key", value)


def _is_number(value: object) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and math.isfinite(value)


def _shown(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def load_scene(file: Path) -> Scene:
    """Reads and checks a scene file; raises `BridgeError` naming file, key and expectation."""
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise BridgeError(f"{file}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise BridgeError(f"{file}: is not JSON: {error}") from error
    root = _Section(file, "", values)
    schema = root.text("schema")
    if schema != SCHEMA:
        raise root.error("schema", f'"{SCHEMA}"', schema)

    section = root.section("robot")
    robot = RobotSettings(
        urdf=section.path("urdf"),
        tool_link=section.text("tool_link"),
        tip_link=section.text("tip_link"),
        home_position_rad=section.numbers(
            "home_position_rad", None, "one number a joint of the robot"
        ),
    )
    section.done()

    section = root.section("physics")
    physics = PhysicsSettings(
        rate_hz=section.number("rate_hz", 100.0, 2000.0),
        gravity_m_s2=section.number("gravity_m_s2", 0.0, 20.0),
    )
    section.done()

    section = root.section("table")
    centre_x, centre_y = section.numbers("centre_xy_m", 2, "two numbers")
    table = TableSettings(
        size_m=section.size("size_m"),
        centre_xy_m=(centre_x, centre_y),
        friction=section.number("friction", 0.0, 10.0),
    )
    section.done()

    section = root.section("object")
    box = ObjectSettings(
        size_m=section.size("size_m"),
        mass_kg=section.positive("mass_kg"),
        friction=section.number("friction", 0.0, 10.0),
        table_gap_m=section.number("table_gap_m", 0.0, 1.0),
        circle_radius_m=section.number("circle_radius_m", 0.0, 1.0),
        circle_speed_rad_s=section.number("circle_speed_rad_s", 0.0, 100.0),
        circle_centre_x_m=section.range("circle_centre_x_m"),
        circle_centre_y_m=section.range("circle_centre_y_m"),
        circle_phase_rad=section.range("circle_phase_rad"),
        yaw_rad=section.range("yaw_rad"),
    )
    section.done()

    section = root.section("sphere")
    sphere = SphereSettings(
        radius_m=section.positive("radius_m"),
        centre_x_m=section.range("centre_x_m"),
        centre_y_m=section.range("centre_y_m"),
        height_m=section.range("height_m"),
        amplitude_y_m=section.range("amplitude_y_m", 0.0),
        speed_rad_s=section.range("speed_rad_s", 0.0),
        phase_rad=section.range("phase_rad"),
        object_clearance_min_m=section.number("object_clearance_min_m"),
        start_clearance_min_m=section.number("start_clearance_min_m"),
    )
    object_top = box.table_gap_m + box.size_m[2]
    height_min = object_top + sphere.object_clearance_min_m + sphere.radius_m
    if sphere.height_m.low < height_min:
        raise section.error(
            "height_m",
            f"a low end of at least {height_min:.4f} (the object's top at {object_top:.4f}, "
            "object_clearance_min_m and radius_m)",
            sphere.height_m.low,
        )
    section.done()

    section = root.section("suction")
    suction = SuctionSettings(
        contact_stiffness_n_m=section.positive("contact_stiffness_n_m"),
        contact_damping_n_s_m=section.number("contact_damping_n_s_m"),
        cup_radius_m=section.positive("cup_radius_m"),
        tilt_max_rad=section.number("tilt_max_rad", 0.0, math.pi / 2),
        seal_time_s=section.number("seal_time_s", 0.0, 10.0),
    )
    section.done()

    section = root.section("task")
    task = TaskSettings(
        skill=section.text("skill"),
        demonstrations=section.path("demonstrations"),
        start_frame=section.text("start_frame"),
        goal_frame=section.text("goal_frame"),
        lift_height_m=section.positive("lift_height_m"),
        hold_time_s=section.positive("hold_time_s"),
        hold_speed_max_m_s=section.positive("hold_speed_max_m_s"),
        time_limit_s=section.number("time_limit_s", 1.0, 600.0),
    )
    for key, name in (("start_frame", task.start_frame), ("goal_frame", task.goal_frame)):
        if len(name.encode()) > 24:
            raise section.error(key, "a name of at most 24 bytes", name)
    section.done()

    section = root.section("record")
    record = RecordSettings(
        count=section.whole("count", 1),
        seed=section.whole("seed", 0),
        duration_s=section.range("duration_s", 0.5),
        start_variation_rad=section.number("start_variation_rad", 0.0, 0.5),
        vertical_end_m=section.positive("vertical_end_m"),
        vertical_delay=section.number("vertical_delay", 0.0, 0.9),
        compression_m=section.number("compression_m", 0.0, 0.01),
        sampling_time_s=section.positive("sampling_time_s"),
        tracking_stiffness_1_s2=section.positive("tracking_stiffness_1_s2"),
        tracking_damping_1_s=section.positive("tracking_damping_1_s"),
    )
    section.done()
    root.done()
    return Scene(file, robot, physics, table, box, sphere, suction, task, record)
