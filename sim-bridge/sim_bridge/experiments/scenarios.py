"""Draws the scenarios. What is drawn depends on experiment and seed alone, never on an outcome.

A **pick**: the box stands, or moves on a circle of at most 0.15 m at up to 0.3π rad/s, yaw ±60°. A
ball of 0.04 to 0.10 m radius passes the path of the tool at 0.05 to 0.25 m/s: it crosses once on
a line, or swings to and fro. The arm is pushed at a random link by up to 40 N for 0.2 s, once to
three times. Of the ball is drawn anew what no arm could do anything about:

* at the start it is nearer than 0.18 m to the arm's bones (the lines between its joints);
* it comes nearer than 0.25 m to the axis of the base, which cannot give way;
* it would pass through table or box: its lower end keeps above the box.

**Adversarial** frames: for eight seconds the announced goal is where no goal should be; then it is
at the box. **Singular**: the arm starts stretched, or with its wrist aligned, or has to pass there,
or the box lies where the arm has to stretch.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field, replace

import numpy as np

from sim_bridge.kinematics import Chain, segment_poses
from sim_bridge.poses import Array
from sim_bridge.scene import BoxOnCircle, Motion, Scene

BONE_CLEARANCE_M = 0.18
BASE_CLEARANCE_M = 0.25
BOX_CLEARANCE_M = {"crosses": 0.03, "swings": 0.10}
DRAWS_MAX = 1000
SECONDS_SEEN = 40.0
FAR_M = (0.0, 0.0, -5.0)
"""Where the ball is when there is none: below the table."""

PICKS = ("static", "circle")
GOALS = (
    "out of reach",
    "inside an obstacle",
    "inside the robot",
    "behind the base",
    "below the table",
    "jumping by 1 m",
)
SINGULAR = (
    "stretched at the start",
    "wrist aligned at the start",
    "wrist aligned on the way",
    "stretched on the way",
)
KINDS = {"adversarial": GOALS, "singular": SINGULAR}


@dataclass(frozen=True)
class Push:
    """A force on a link, in the base frame."""

    from_s: float
    duration_s: float
    link: int
    """Index among the moving links that have a shape, from the base on, modulo their number."""
    force_n: tuple[float, float, float]

    def acts(self, time_s: float) -> bool:
        """Whether it acts in the step that begins now."""
        return self.from_s <= time_s < self.from_s + self.duration_s


@dataclass(frozen=True)
class Ball:
    """The obstacle. At `passes_s` it is at `point_m`."""

    motion: str
    """`rests`, `crosses` or `swings`."""
    radius_m: float
    point_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    passes_s: float = 0.0
    speed_rad_s: float = 1.0
    """Of a swing, whose largest velocity is `velocity_m_s`."""

    def at(self, time_s: float) -> Motion:
        """Where it is; the velocity is the derivative of the position."""
        t = time_s - self.passes_s
        if self.motion == "swings":
            along = math.sin(self.speed_rad_s * t) / self.speed_rad_s
            rate = math.cos(self.speed_rad_s * t)
        else:
            along, rate = t, 1.0
        x, y, z = (p + v * along for p, v in zip(self.point_m, self.velocity_m_s))
        vx, vy, vz = (v * rate for v in self.velocity_m_s)
        return Motion((x, y, z), 0.0, (vx, vy, vz))


@dataclass(frozen=True)
class FalseGoal:
    """Where the goal frame is announced instead of at the box, one place after the other."""

    from_s: float
    until_s: float
    change_s: float
    """How long it stays at a place."""
    places_m: tuple[tuple[float, float, float], ...]
    yaws_rad: tuple[float, ...]

    def at(self, time_s: float) -> Motion | None:
        """The announced goal, `None` when it is at the box."""
        if not self.from_s <= time_s < self.until_s:
            return None
        k = int((time_s - self.from_s) / self.change_s) % len(self.places_m)
        return Motion(self.places_m[k], self.yaws_rad[k], (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Scenario(BoxOnCircle):
    """What happens in one episode. Has what `World` asks of an episode."""

    experiment: str
    kind: str
    robot: str
    seed: int
    home_rad: tuple[float, ...]
    circle_centre_m: tuple[float, float, float]
    circle_radius_m: float
    circle_speed_rad_s: float
    circle_phase_rad: float
    object_yaw_rad: float
    ball: Ball
    pushes: tuple[Push, ...] = ()
    false_goal: FalseGoal | None = field(default=None)

    def sphere_motion(self, time_s: float) -> Motion:
        """Where the ball is."""
        return self.ball.at(time_s)


def draw(scene: Scene, chain: Chain, robot: str, experiment: str, seed: int) -> Scenario:
    """The scenario of a seed."""
    generator = random.Random(f"{experiment} {seed}")
    kinds = KINDS.get(experiment, PICKS)
    kind = kinds[seed % len(kinds)]
    home = scene.robot.home_position_rad
    box = _box(scene, generator, kind == "circle")
    no_ball = Ball("rests", 0.05, FAR_M)
    scenario = Scenario(experiment, kind, robot, seed, home, *box, no_ball)
    bones = arm_bones(chain, home)
    if experiment == "adversarial":
        return _adversarial(scenario, bones, generator)
    if experiment == "singular":
        return _singular(scenario, generator)
    for _ in range(DRAWS_MAX):
        ball = _ball(scene, generator, bones[-1], scenario)
        if may_be(ball, bones):
            break
    pushes = tuple(_push(generator) for _ in range(generator.randint(1, 3)))
    return replace(scenario, ball=ball, pushes=pushes)


def arm_bones(chain: Chain, q: tuple[float, ...]) -> Array:
    """Origins of the links from the base to the tip, Kx3."""
    poses = segment_poses(chain, np.array(q))
    return np.array([[0.0, 0.0, 0.0], *(x[:3, 3] for x in poses)])


def may_be(ball: Ball, bones: Array) -> bool:
    """Whether the arm is not met at its start, and its base never."""
    start = np.array(ball.at(0.0).position_m)
    if distance_from_line(start, bones) < ball.radius_m + BONE_CLEARANCE_M:
        return False
    times = np.arange(0.0, SECONDS_SEEN, 0.05)
    path = np.array([ball.at(t).position_m[:2] for t in times])
    return bool(np.min(np.linalg.norm(path, axis=1)) >= ball.radius_m + BASE_CLEARANCE_M)


def distance_from_line(point: Array, corners: Array) -> float:
    """Distance of a point from a line through `corners`, Kx3 [m]."""
    least = math.inf
    for a, b in zip(corners[:-1], corners[1:]):
        along = b - a
        square = float(along @ along)
        fraction = min(1.0, max(0.0, float((point - a) @ along) / square)) if square > 0.0 else 0.0
        least = min(least, float(np.linalg.norm(point - a - fraction * along)))
    return least


def _box(scene: Scene, generator: random.Random, moves: bool) -> tuple:
    box = scene.object
    centre = (
        box.circle_centre_x_m.draw(generator),
        box.circle_centre_y_m.draw(generator),
        box.table_gap_m + 0.5 * box.size_m[2],
    )
    radius = generator.uniform(0.05, 0.15)
    speed = generator.uniform(0.1, 0.3) * math.pi * generator.choice((-1.0, 1.0))
    phase = generator.uniform(0.0, 2.0 * math.pi)
    yaw = generator.uniform(-math.pi / 3.0, math.pi / 3.0)
    return (centre, radius, speed if moves else 0.0, phase, yaw)


def _ball(scene: Scene, generator: random.Random, tool: Array, scenario: Scenario) -> Ball:
    motion = generator.choice(("crosses", "swings"))
    radius = generator.uniform(0.04, 0.10)
    box = scene.object
    lowest = box.table_gap_m + box.size_m[2] + BOX_CLEARANCE_M[motion] + radius
    passes = generator.uniform(1.0, 3.0)
    goal = np.array(scenario.object_motion(passes).position_m)
    fraction = generator.uniform(0.2, 0.8 if motion == "crosses" else 0.5)
    on_the_path = tool + fraction * (goal - tool)
    x, y = (p + generator.uniform(-0.05, 0.05) for p in on_the_path[:2])
    z = lowest + generator.uniform(0.0, 0.2)
    speed = generator.uniform(0.05, 0.25)
    heading = generator.uniform(0.0, 2.0 * math.pi)
    velocity = (speed * math.cos(heading), speed * math.sin(heading), 0.0)
    # Of a swing this makes the amplitude.
    speed_rad_s = speed / generator.uniform(0.08, 0.2)
    return Ball(motion, radius, (x, y, z), velocity, passes, speed_rad_s)


def _push(generator: random.Random) -> Push:
    size = generator.uniform(10.0, 40.0)
    heading, height = generator.uniform(0.0, 2.0 * math.pi), generator.uniform(-1.0, 1.0)
    flat = size * math.sqrt(1.0 - height * height)
    force = (flat * math.cos(heading), flat * math.sin(heading), size * height)
    return Push(generator.uniform(0.3, 5.0), 0.2, generator.randrange(100), force)


def _adversarial(scenario: Scenario, bones: Array, generator: random.Random) -> Scenario:
    kind = scenario.kind
    heading = generator.uniform(0.0, 2.0 * math.pi)
    height = generator.uniform(0.03, 0.4)
    yaw = generator.uniform(-math.pi / 3.0, math.pi / 3.0)
    change = 100.0
    yaws = (yaw,)
    if kind == "out of reach":
        r = generator.uniform(1.3, 2.5)
        places = ((r * math.cos(heading), r * math.sin(heading), height),)
    elif kind == "inside an obstacle":
        x, y = generator.uniform(0.35, 0.55), generator.uniform(0.0, 0.25)
        radius = generator.uniform(0.06, 0.10)
        z = generator.uniform(radius + 0.02, 0.22)
        scenario = replace(scenario, ball=Ball("rests", radius, (x, y, z)))
        off = (generator.uniform(-0.5, 0.5) * radius for _ in range(3))
        places = ((x + next(off), y + next(off), z + next(off)),)
    elif kind == "inside the robot":
        k = generator.randrange(1, len(bones) - 1)
        fraction = generator.random()
        x, y, z = (1.0 - fraction) * bones[k] + fraction * bones[k - 1]
        places = ((float(x), float(y), float(z)),)
    elif kind == "behind the base":
        places = ((generator.uniform(-0.6, -0.3), generator.uniform(-0.3, 0.3), height),)
    elif kind == "below the table":
        places = ((generator.uniform(0.35, 0.6), generator.uniform(-0.3, 0.3), -height),)
    else:
        change = generator.uniform(0.4, 1.0)
        x, y, z = scenario.object_motion(0.0).position_m
        away = (generator.uniform(-1.0, 1.0) for _ in range(3))
        step = np.array([next(away), next(away), 0.5 * next(away)])
        step /= np.linalg.norm(step)
        places = ((x, y, z), (x + float(step[0]), y + float(step[1]), z + float(step[2])))
        yaws = (yaw, -yaw)
    begin = generator.uniform(0.0, 2.0)
    return replace(scenario, false_goal=FalseGoal(begin, begin + 8.0, change, places, yaws))


def _singular(scenario: Scenario, generator: random.Random) -> Scenario:
    kind = scenario.kind
    pan, lift, elbow, wrist_1, wrist_2, wrist_3 = scenario.home_rad
    if kind == "stretched at the start":
        # The tool points down as at home: lift, elbow and first wrist have the same sum.
        down = lift + elbow + wrist_1
        lift = generator.uniform(-1.1, -0.7)
        elbow = generator.uniform(-0.02, 0.02)
        wrist_1 = down - lift - elbow
        pan += generator.uniform(-0.3, 0.3)
    elif kind == "wrist aligned at the start":
        wrist_2 = generator.uniform(-0.02, 0.02)
    elif kind == "wrist aligned on the way":
        wrist_2 = generator.uniform(0.2, 0.6)
    else:
        # Where an arm whose wrist points down is stretched, or just is not.
        reach, heading = generator.uniform(0.72, 0.88), generator.uniform(-0.9, 0.2)
        x, y = reach * math.cos(heading), reach * math.sin(heading)
        scenario = replace(
            scenario,
            circle_radius_m=0.0,
            circle_centre_m=(x, y, scenario.circle_centre_m[2]),
        )
    return replace(scenario, home_rad=(pan, lift, elbow, wrist_1, wrist_2, wrist_3))
