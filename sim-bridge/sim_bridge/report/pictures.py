"""Pictures of a recorded run, rendered from its log in pybullet's software renderer.

The renderer has no shadows worth seeing and no smooth edges. So every picture is rendered at
twice its size and reduced, and the shadow on the table is computed here: a second, small picture
from the light's point of view says which points of the table the light reaches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFilter, ImageFont

from sim_bridge.html import INK
from sim_bridge.kinematics import load_chain
from sim_bridge.log import Log
from sim_bridge.poses import Array
from sim_bridge.scene import Scene

# From there, because it keeps what pybullet prints when it is imported off the terminal.
from sim_bridge.world import BulletClient, pybullet, quiet

# Colours of things, the same in every picture and plot (Okabe and Ito's, safe for colour-blind).
TOOL_COLOUR = "#0072b2"
OBJECT_COLOUR = "#009e73"
SPHERE_COLOUR = "#d55e00"
TABLE_COLOUR = "#8a6d3b"

TABLE_SHADE = (226, 222, 212)
BACKGROUND_SHADE = (246, 247, 249)
SHADOW_FRACTION = 0.30
SUPERSAMPLING = 2
NEAR_M, FAR_M = 0.3, 6.0
LIGHT_PIXELS = 512
LIGHT_BIAS_M = 0.015
# Rows of the log between two points of the drawn path.
PATH_ROWS = 10
# An overlaid line this far behind a surface still counts as lying on it.
OVERLAY_TOLERANCE_M = 0.01


@dataclass(frozen=True)
class Camera:
    """Where a picture is taken from, in B."""

    eye_m: tuple[float, float, float]
    target_m: tuple[float, float, float]
    opening_deg: float


CAMERA = Camera((1.62, -0.85, 0.86), (0.27, -0.12, 0.20), 32.0)
LIGHT = Camera((1.0, -0.9, 2.6), (0.25, -0.1, 0.1), 40.0)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green, blue 0 … 255 of `#rrggbb`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The font that comes with matplotlib: the same on every machine."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf" / name), size)


class _View:
    """A camera's matrices, and what they do to points."""

    def __init__(self, camera: Camera, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.view = pybullet.computeViewMatrix(camera.eye_m, camera.target_m, [0.0, 0.0, 1.0])
        self.projection = pybullet.computeProjectionMatrixFOV(
            camera.opening_deg, width / height, NEAR_M, FAR_M
        )
        # OpenGL's matrices come column by column.
        view = np.array(self.view).reshape(4, 4).T
        self.matrix = np.array(self.projection).reshape(4, 4).T @ view
        self.eye = np.array(camera.eye_m)

    def project(self, points: Array) -> tuple[Array, Array]:
        """Pixels (column, row) and depths [m] of points [m] in B."""
        clip = np.hstack([points, np.ones((len(points), 1))]) @ self.matrix.T
        ndc = clip[:, :2] / clip[:, 3:]
        pixels = (ndc * [0.5, -0.5] + 0.5) * [self.width, self.height]
        return pixels, clip[:, 3]

    def on_table(self) -> Array:
        """Where the ray of every pixel meets the plane z = 0, rows x columns x 3 [m]."""
        columns = (np.arange(self.width) + 0.5) / self.width * 2.0 - 1.0
        rows = 1.0 - (np.arange(self.height) + 0.5) / self.height * 2.0
        x, y = np.meshgrid(columns, rows)
        clip = np.stack([x, y, np.ones_like(x), np.ones_like(x)], axis=-1)
        far = clip @ np.linalg.inv(self.matrix).T
        ray = far[..., :3] / far[..., 3:] - self.eye
        scale = -self.eye[2] / np.minimum(ray[..., 2:], -1e-6)
        return self.eye + scale * ray


class Stage:
    """The scene of a log with colours, a camera and a light."""

    def __init__(self, scene: Scene, log: Log, width: int, height: int) -> None:
        self.log, self.size = log, (width, height)
        with quiet(1):
            self.client = BulletClient(connection_mode=pybullet.DIRECT)
            self._load(scene)
        self.view = _View(CAMERA, SUPERSAMPLING * width, SUPERSAMPLING * height)
        self.light = _View(LIGHT, LIGHT_PIXELS, LIGHT_PIXELS)
        ground = self.view.on_table().reshape(-1, 3)
        pixels, self._ground_depth = self.light.project(ground)
        self._ground_pixels = np.clip(np.floor(pixels), 0, LIGHT_PIXELS - 1).astype(int)
        # What the light's picture does not show is lit.
        outside = np.any((pixels < 1) | (pixels >= LIGHT_PIXELS - 1), axis=1)
        self._ground_depth[outside] = -np.inf

    def close(self) -> None:
        """Disconnects from the renderer."""
        self.client.disconnect()

    def _load(self, scene: Scene) -> None:
        p = self.client
        self.arm = p.loadURDF(str(scene.robot.urdf), useFixedBase=True)
        by_name = {
            p.getJointInfo(self.arm, i)[1].decode(): i for i in range(p.getNumJoints(self.arm))
        }
        chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
        self.joints = [by_name[name] for name in chain.joint_names]
        half = [0.5 * size for size in scene.table.size_m]
        self.table = self._body(
            [*scene.table.centre_xy_m, -half[2]], "#d8d4ca", shapeType=p.GEOM_BOX, halfExtents=half
        )
        half = [0.5 * size for size in scene.object.size_m]
        self.box = self._body([0.0] * 3, OBJECT_COLOUR, shapeType=p.GEOM_BOX, halfExtents=half)
        vertices, indices = _ball(24)
        self.sphere = self._body(
            [0.0] * 3,
            SPHERE_COLOUR,
            shapeType=p.GEOM_MESH,
            vertices=(scene.sphere.radius_m * vertices).tolist(),
            normals=vertices.tolist(),
            indices=indices,
        )

    def _body(self, position: Sequence[float], colour: str, **shape: object) -> int:
        rgba = [channel / 255.0 for channel in rgb(colour)] + [1.0]
        visual = self.client.createVisualShape(rgbaColor=rgba, **shape)
        return self.client.createMultiBody(baseVisualShapeIndex=visual, basePosition=list(position))

    def _place(self, row: int) -> None:
        log, p = self.log, self.client
        for joint, position in zip(self.joints, log["position_rad"][row].tolist()):
            p.resetJointState(self.arm, joint, position)
        w, x, y, z = log["object_quaternion_wxyz"][row].tolist()
        position = log["object_position_m"][row].tolist()
        p.resetBasePositionAndOrientation(self.box, position, (x, y, z, w))
        position = log["sphere_position_m"][row].tolist()
        p.resetBasePositionAndOrientation(self.sphere, position, (0.0, 0.0, 0.0, 1.0))

    def _capture(self, view: _View) -> tuple[Array, Array, Array]:
        """Colours, depths [m] and body numbers of a view."""
        _, _, colours, depths, bodies = self.client.getCameraImage(
            view.width,
            view.height,
            view.view,
            view.projection,
            shadow=0,
            lightDirection=[0.8, -0.9, 2.0],
            lightColor=[1.0, 1.0, 1.0],
            lightAmbientCoeff=0.62,
            lightDiffuseCoeff=0.42,
            lightSpecularCoeff=0.08,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        shape = (view.height, view.width)
        depth = np.reshape(depths, shape)
        metres = FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * depth)
        colour = np.reshape(colours, (*shape, 4))[..., :3].astype(np.float32)
        return colour, metres, np.reshape(bodies, shape)

    def _shadow(self) -> Array:
        """How much of the light is kept from the table at every pixel, 0 … 1."""
        _, depth, _ = self._capture(self.light)
        columns, rows = self._ground_pixels.T
        hidden = self._ground_depth - depth[rows, columns] > LIGHT_BIAS_M
        mask = (255 * hidden.reshape(self.view.height, self.view.width)).astype(np.uint8)
        radius = self.view.width / 240
        soft = Image.fromarray(mask).filter(ImageFilter.GaussianBlur(radius))
        return np.asarray(soft, dtype=np.float32) / 255.0

    def picture(self, row: int) -> Image.Image:
        """The scene at a row of the log, with the tool's path so far."""
        self._place(row)
        colour, depth, bodies = self._capture(self.view)
        ground = bodies == self.table
        shade = np.array(TABLE_SHADE, dtype=np.float32)
        lit = 1.0 - SHADOW_FRACTION * self._shadow()
        colour[ground] = shade * lit[ground][:, None]
        colour[bodies < 0] = BACKGROUND_SHADE
        image = Image.fromarray(np.clip(colour, 0, 255).astype(np.uint8))
        self._overlay(image, depth, row)
        return image.resize(self.size, Image.Resampling.BOX)

    def _overlay(self, image: Image.Image, depth: Array, row: int) -> None:
        log = self.log
        width = max(2, round(self.view.width / 190))
        rows = np.append(np.arange(0, row, PATH_ROWS), row)
        if len(rows) > 1:
            self._line(image, depth, log["tool_position_m"][rows], rgb(TOOL_COLOUR), width)

    def _line(
        self, image: Image.Image, depth: Array, points: Array, colour: tuple, width: int
    ) -> None:
        """Draws a line through points [m] where nothing stands before it."""
        pixels, distance = self.view.project(points)
        column = np.clip(pixels[:, 0].astype(int), 0, self.view.width - 1)
        line = np.clip(pixels[:, 1].astype(int), 0, self.view.height - 1)
        seen = distance <= depth[line, column] + OVERLAY_TOLERANCE_M
        draw = ImageDraw.Draw(image)
        stretch: list[tuple[float, float]] = []
        for pixel, visible in zip(pixels.tolist(), seen.tolist()):
            if visible:
                stretch.append((pixel[0], pixel[1]))
                continue
            if len(stretch) > 1:
                draw.line(stretch, fill=colour, width=width, joint="curve")
            stretch = []
        if len(stretch) > 1:
            draw.line(stretch, fill=colour, width=width, joint="curve")


def _ball(rings: int) -> tuple[Array, list[int]]:
    """Vertices and triangles of a round ball of radius 1: pybullet's own has few corners."""
    around = 2 * rings
    polar, azimuth = np.meshgrid(
        np.linspace(0.0, math.pi, rings + 1),
        np.linspace(0.0, 2.0 * math.pi, around, endpoint=False),
    )
    sine = np.sin(polar.T)
    vertices = np.stack([sine * np.cos(azimuth.T), sine * np.sin(azimuth.T), np.cos(polar.T)], -1)
    indices = []
    for ring in range(rings):
        for step in range(around):
            a, b = ring * around + step, ring * around + (step + 1) % around
            indices += [a, a + around, b, b, a + around, b + around]
    return vertices.reshape(-1, 3), indices


def stamp(picture: Image.Image, time_s: float, note: str, size: int) -> Image.Image:
    """Writes the time into the upper left corner and a note, if any, into the lower left one."""
    stamped = picture.copy()
    draw = ImageDraw.Draw(stamped)
    margin = size // 2
    draw.text((margin, margin), f"{time_s:.2f} s", fill=rgb(INK), font=font(size, bold=True))
    below = (margin, picture.height - margin)
    draw.text(below, note, fill=rgb(INK), font=font(size), anchor="ls")
    return stamped


def tile(pictures: Sequence[Image.Image], columns: int, gap: int = 6) -> Image.Image:
    """Pictures of one size side by side, row after row, on white."""
    width, height = pictures[0].size
    rows = math.ceil(len(pictures) / columns)
    sheet = Image.new(
        "RGB", (columns * width + (columns - 1) * gap, rows * height + (rows - 1) * gap), "white"
    )
    for index, picture in enumerate(pictures):
        line, column = divmod(index, columns)
        sheet.paste(picture, (column * (width + gap), line * (height + gap)))
    return sheet


def animation(pictures: Sequence[Image.Image], frame_s: float, last_s: float) -> bytes:
    """An endless GIF; the last picture stays for `last_s` [s]."""
    # One palette for all, from a sheet of some: else colours flicker.
    some = pictures[:: max(1, len(pictures) // 6)]
    palette = tile(some, 3).quantize(256, method=Image.Quantize.MEDIANCUT)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    duration = [round(1e3 * frame_s)] * (len(frames) - 1) + [round(1e3 * last_s)]
    buffer = BytesIO()
    frames[0].save(
        buffer, "GIF", save_all=True, append_images=frames[1:], duration=duration, loop=0
    )
    return buffer.getvalue()


def png_below(picture: Image.Image, bytes_max: int) -> bytes:
    """A PNG of at most `bytes_max` bytes: with a palette, and then smaller, if it must be."""
    content = _png(picture)
    fraction = 1.0
    while len(content) > bytes_max and fraction > 0.2:
        size = (round(fraction * picture.width), round(fraction * picture.height))
        smaller = picture if fraction == 1.0 else picture.resize(size, Image.Resampling.LANCZOS)
        content = _png(smaller.quantize(256, dither=Image.Dither.NONE))
        fraction -= 0.1
    return content


def _png(picture: Image.Image) -> bytes:
    buffer = BytesIO()
    picture.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()
