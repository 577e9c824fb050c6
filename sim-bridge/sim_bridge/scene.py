"""The scene file: what stands where, how it moves, and between which limits a seed draws it.

A pair of numbers is a range from which each seed draws uniformly.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from pathlib import Path
from typing import get_type_hints

from sim_bridge import settings
from sim_bridge.errors import BridgeError
from sim_bridge.files import NAME_BYTES_MAX
from sim_bridge.settings import Range

SCHEMA = "tprmp-scene/1"


@dataclass(frozen=True)
class RobotSettings:
    """Which arm, and where it starts."""

    urdf: Path = settings.path()
    tool_link: str = settings.text()
    tip_link: str = settings.text()
    home_position_rad: tuple[float, ...] = settings.key(
        "one number a joint of the robot",
        lambda value: isinstance(value, list) and value and all(map(settings.is_number, value)),
        settings.floats,
    )


@dataclass(frozen=True)
class PhysicsSettings:
    """Step rate and gravity."""

    rate_hz: float = settings.number(100.0, 2000.0)
    gravity_m_s2: float = settings.number(0.0, 20.0)


@dataclass(frozen=True)
class TableSettings:
    """A box whose top is the plane z = 0 of the robot's base frame."""

    size_m: tuple[float, float, float] = settings.size()
    centre_xy_m: tuple[float, float] = settings.key(
        "two numbers", lambda value: settings.are_numbers(value, 2), settings.floats
    )
    friction: float = settings.number(0.0, 10.0)


@dataclass(frozen=True)
class ObjectSettings:
    """The box to be picked: it moves on a circle, just above the table, with a constant yaw."""

    size_m: tuple[float, float, float] = settings.size()
    mass_kg: float = settings.positive()
    friction: float = settings.number(0.0, 10.0)
    table_gap_m: float = settings.number(0.0, 1.0)
    circle_radius_m: float = settings.number(0.0, 1.0)
    circle_speed_rad_s: float = settings.number(0.0, 100.0)
    circle_centre_x_m: Range = settings.interval()
    circle_centre_y_m: Range = settings.interval()
    circle_phase_rad: Range = settings.interval()
    yaw_rad: Range = settings.interval()


@dataclass(frozen=True)
class SphereSettings:
    """The obstacle: a ball that swings along y."""

    radius_m: float = settings.positive()
    centre_x_m: Range = settings.interval()
    centre_y_m: Range = settings.interval()
    height_m: Range = settings.interval()
    amplitude_y_m: Range = settings.interval(0.0)
    speed_rad_s: Range = settings.interval(0.0)
    phase_rad: Range = settings.interval()
    object_clearance_min_m: float = settings.number()
    start_clearance_min_m: float = settings.number()


@dataclass(frozen=True)
class SuctionSettings:
    """The suction cup: soft, and it seals only when it touches."""

    contact_stiffness_n_m: float = settings.positive()
    contact_damping_n_s_m: float = settings.number()
    cup_radius_m: float = settings.positive()
    tilt_max_rad: float = settings.number(0.0, math.pi / 2)
    seal_time_s: float = settings.number(0.0, 10.0)


@dataclass(frozen=True)
class TaskSettings:
    """What the task is, and when it is done."""

    skill: str = settings.name(NAME_BYTES_MAX)
    demonstrations: Path = settings.path()
    start_frame: str = settings.name()
    goal_frame: str = settings.name()
    lift_height_m: float = settings.positive()
    hold_time_s: float = settings.positive()
    hold_speed_max_m_s: float = settings.positive()
    time_limit_s: float = settings.number(1.0, 600.0)


@dataclass(frozen=True)
class RecordSettings:
    """How the scripted expert demonstrates."""

    count: int = settings.whole(1)
    seed: int = settings.whole(0)
    duration_s: Range = settings.interval(0.5)
    start_variation_rad: float = settings.number(0.0, 0.5)
    vertical_end_m: float = settings.positive()
    vertical_delay: float = settings.number(0.0, 0.9)
    compression_m: float = settings.number(0.0, 0.01)
    sampling_time_s: float = settings.positive()
    tracking_stiffness_1_s2: float = settings.positive()
    tracking_damping_1_s: float = settings.positive()


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


class BoxOnCircle:
    """Motion of the box of an episode, which has these values."""

    circle_centre_m: tuple[float, float, float]
    circle_radius_m: float
    circle_speed_rad_s: float
    circle_phase_rad: float
    object_yaw_rad: float

    def object_motion(self, time_s: float) -> Motion:
        """Where the box is on its circle; the velocity is the derivative of the position."""
        w, r = self.circle_speed_rad_s, self.circle_radius_m
        angle = self.circle_phase_rad + w * time_s
        c, s = r * math.cos(angle), r * math.sin(angle)
        x, y, z = self.circle_centre_m
        return Motion((x + c, y + s, z), self.object_yaw_rad, (-w * s, w * c, 0.0))


@dataclass(frozen=True)
class Episode(BoxOnCircle):
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


def load_scene(file: Path) -> Scene:
    """Reads and checks a scene file; raises `BridgeError` naming file, key and expectation."""
    values = settings.read_json(file)
    kinds = {name: kind for name, kind in get_type_hints(Scene).items() if name != "file"}
    settings.check_keys(
        file, "", values, {"schema": f'"{SCHEMA}"', **dict.fromkeys(kinds, "an object")}
    )
    if values["schema"] != SCHEMA:
        raise settings.refused(file, "schema", f'"{SCHEMA}"', values["schema"])
    scene = Scene(
        file, **{key: settings.section(kind, file, key, values[key]) for key, kind in kinds.items()}
    )
    box, sphere = scene.object, scene.sphere
    object_top = box.table_gap_m + box.size_m[2]
    height_min = object_top + sphere.object_clearance_min_m + sphere.radius_m
    if sphere.height_m.low < height_min:
        expected = (
            f"a low end of at least {height_min:.4f} (the object's top at {object_top:.4f}, "
            "object_clearance_min_m and radius_m)"
        )
        raise settings.refused(file, "sphere.height_m", expected, sphere.height_m.low)
    return scene
