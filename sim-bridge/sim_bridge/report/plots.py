"""Plots of a report, each as a PNG."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

from sim_bridge.html import INK
from sim_bridge.poses import Array
from sim_bridge.report.figures import Run, demonstrated_path, plain
from sim_bridge.report.pictures import OBJECT_COLOUR, SPHERE_COLOUR, TABLE_COLOUR, TOOL_COLOUR

DEMONSTRATION_COLOUR = "#a3a9b2"
SELF_COLOUR = "#8e4c9e"
LIMIT_COLOUR = "#b3261e"
WIDTH_IN = 10.0
DPI = 140
# More points than a plot has pixels across would only cost time.
POINTS_MAX = 4000

_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 11,
    "axes.titlesize": 11.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 11,
    "axes.edgecolor": "#8b919a",
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.8,
    "xtick.color": "#4a5058",
    "ytick.color": "#4a5058",
    "legend.frameon": False,
    "legend.fontsize": 10.5,
    "lines.linewidth": 1.8,
    "figure.facecolor": "white",
    "text.color": INK,
}


@contextmanager
def _figure(height_in: float) -> Iterator[tuple[Figure, list[bytes]]]:
    """A figure in the report's style; its PNG is in the list when the block has ended."""
    with pyplot.rc_context(_STYLE):
        figure = pyplot.figure(figsize=(WIDTH_IN, height_in), layout="constrained")
        png: list[bytes] = []
        try:
            yield figure, png
            buffer = BytesIO()
            figure.savefig(buffer, format="png", dpi=DPI)
            png.append(_small(buffer))
        finally:
            pyplot.close(figure)


def _small(buffer: BytesIO) -> bytes:
    """The same picture with a palette: a third of the size."""
    small = BytesIO()
    image = Image.open(buffer).convert("RGB").quantize(160, dither=Image.Dither.NONE)
    image.save(small, "PNG", optimize=True)
    return small.getvalue()


def _thin(rows: int) -> slice:
    return slice(None, None, max(1, rows // POINTS_MAX))


def _mark_grip(axes: Axes, run: Run, *, label: bool = False) -> None:
    """A vertical line at the grip, and a tint while the box is held."""
    if run.gripped_row is None:
        return
    time_s = run.log["time_s"]
    at = float(time_s[run.gripped_row])
    axes.axvspan(at, float(time_s[-1]), color=OBJECT_COLOUR, alpha=0.07, linewidth=0)
    axes.axvline(at, color=OBJECT_COLOUR, linewidth=1.2, alpha=0.7, zorder=1)
    if label:
        axes.annotate(
            "gripped",
            (at, 1.0),
            (4, -4),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            va="top",
            color=OBJECT_COLOUR,
        )


def path(run: Run) -> bytes:
    """The tool's path up to the grip in the object frame, against the demonstrations."""
    end = len(run.path_in_object_m) if run.gripped_row is None else run.gripped_row
    end = max(end, 2)
    own = 1e3 * run.path_in_object_m[:end][_thin(end)]
    goal_frame = run.scene.task.goal_frame
    demonstrated = [1e3 * demonstrated_path(d, goal_frame) for d in run.demonstrations]
    half = 500.0 * np.array(run.scene.object.size_m)
    with _figure(8.2) as (figure, png):
        grid = figure.add_gridspec(2, 2, height_ratios=[1.3, 1.0])
        # Placed by hand: the layout would leave much room around a view in three dimensions.
        space = figure.add_axes((0.08, 0.42, 0.84, 0.64), projection="3d")
        _space(space, own, demonstrated, half)
        views = ((grid[1, 0], 0, 1, "From above"), (grid[1, 1], 1, 2, "From the side"))
        for cell, across, up, title in views:
            _projection(figure.add_subplot(cell), own, demonstrated, half, (across, up), title)
    return png[0]


def _space(axes: Axes, own: Array, demonstrated: list[Array], half: Array) -> None:
    for index, points in enumerate(demonstrated):
        label = "demonstrations" if index == 0 else None
        axes.plot(*points.T, color=DEMONSTRATION_COLOUR, linewidth=1.2, label=label)
    axes.plot(*own.T, color=TOOL_COLOUR, linewidth=2.4, label="this run")
    axes.scatter(*own[0], color=TOOL_COLOUR, s=34, label="start")
    x, y, z = half
    faces = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
            faces.append(np.insert(corners, axis, sign, axis=1) * [x, y, z])
    axes.add_collection3d(
        Poly3DCollection(faces, facecolor=OBJECT_COLOUR, alpha=0.35, edgecolor=OBJECT_COLOUR)
    )
    everything = np.vstack([own, *demonstrated, [half, -half]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_zlim(low[2], high[2])
    axes.set_box_aspect(high - low, zoom=1.1)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.figure.text(0.01, 0.975, "In the object frame", fontweight="bold")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.975, 0.978, 0.982, 1.0))
        axis.set_major_locator(matplotlib.ticker.MaxNLocator(4))
        axis.labelpad = 8
    axes.view_init(elev=22, azim=-58)
    where = {"bbox_to_anchor": (0.0, 0.97), "bbox_transform": axes.figure.transFigure}
    axes.legend(loc="upper left", **where)


def _projection(
    axes: Axes,
    own: Array,
    demonstrated: list[Array],
    half: Array,
    plane: tuple[int, int],
    title: str,
) -> None:
    across, up = plane
    for points in demonstrated:
        axes.plot(points[:, across], points[:, up], color=DEMONSTRATION_COLOUR, linewidth=1.2)
    corner, size = (-half[across], -half[up]), (2.0 * half[across], 2.0 * half[up])
    axes.add_patch(
        Rectangle(corner, *size, facecolor=OBJECT_COLOUR, alpha=0.35, edgecolor=OBJECT_COLOUR)
    )
    axes.plot(own[:, across], own[:, up], color=TOOL_COLOUR, linewidth=2.2)
    axes.plot(*own[0, [across, up]], "o", color=TOOL_COLOUR, markersize=5.5)
    axes.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]", title=title)
    axes.set_aspect("equal", adjustable="datalim")


def errors(run: Run) -> bytes:
    """Distance and angle of the tool from the demonstrated grasp over time, log scale."""
    time_s = run.log["time_s"]
    thin = _thin(len(time_s))
    panels = (
        ("Distance", "mm", 1e3 * run.position_error_m, "position_error_mm"),
        ("Angle", "°", np.degrees(run.orientation_error_rad), "orientation_error_deg"),
    )
    with _figure(5.6) as (figure, png):
        both = figure.subplots(2, 1, sharex=True)
        for axes, (name, unit, error, key) in zip(both, panels):
            low = max(1e-3, 0.5 * float(np.min(error)))
            axes.semilogy(time_s[thin], np.maximum(error, low)[thin], color=TOOL_COLOUR)
            axes.set_ylim(0.7 * low, 1.6 * float(np.max(error)) + low)
            axes.set(ylabel=f"{name} [{unit}]")
            axes.set_title(f"{name} of the tool from the demonstrated grasp")
            axes.yaxis.set_major_formatter(matplotlib.ticker.FormatStrFormatter("%g"))
            _mark_grip(axes, run, label=True)
            if run.gripped_row is not None:
                before = max(0, run.gripped_row - 1)
                value = run.judged[key]
                axes.plot(time_s[before], max(value, low), "o", color=TOOL_COLOUR, markersize=6)
                axes.annotate(
                    f"{value:.2f} {unit}",
                    (time_s[before], max(value, low)),
                    (-10, 8),
                    textcoords="offset points",
                    ha="right",
                    fontweight="bold",
                    color=TOOL_COLOUR,
                )
        both[1].set(xlabel="time [s]", xlim=(time_s[0], time_s[-1]))
    return png[0]


def clearance(run: Run) -> bytes:
    """Least distances of any link over time."""
    colours = {"sphere": SPHERE_COLOUR, "table": TABLE_COLOUR, "self": SELF_COLOUR}
    names = {"sphere": "to the sphere", "table": "to the table", "self": "to itself"}
    time_s = run.clearance_time_s
    with _figure(4.2) as (figure, png):
        axes = figure.subplots()
        for body, colour in colours.items():
            distance = 1e3 * run.clearance_m[body]
            least = int(np.argmin(distance))
            # Dashed: it may lie on another one.
            style = {"color": colour, "linestyle": (0, (4, 2.5)) if body == "self" else "-"}
            label = f"{names[body]}: {distance[least]:.1f} mm"
            axes.plot(time_s, distance, label=label, **style)
            axes.plot(time_s[least], distance[least], "o", color=colour, markersize=6)
        axes.axhline(0.0, color=LIMIT_COLOUR, linewidth=1.6, linestyle="--")
        bottom = min(0.0, 1e3 * min(float(d.min()) for d in run.clearance_m.values()))
        top = 1e3 * max(float(d.max()) for d in run.clearance_m.values())
        axes.set_ylim(bottom - 0.06 * top, 1.08 * top)
        axes.annotate(
            "contact",
            (0.0, 0.0),
            (4, 3),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            color=LIMIT_COLOUR,
        )
        axes.set(xlabel="time [s]", ylabel="distance [mm]", xlim=(time_s[0], time_s[-1]))
        axes.set_title("Least distance of any link (dots: the least of all)")
        _mark_grip(axes, run, label=True)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return png[0]


def torques(run: Run) -> bytes:
    """Torque of every joint against its limit."""
    gravity = ("of it gravity", run.log["gravity_torque_n_m"])
    return _joints(run, ("torque", run.log["torque_n_m"]), gravity, run.chain.effort_max_n_m, "N m")


def velocities(run: Run) -> bytes:
    """Velocity of every joint against its limit."""
    measured = ("velocity", run.log["velocity_rad_s"])
    return _joints(run, measured, None, run.chain.velocity_max_rad_s, "rad/s")


def _joints(
    run: Run,
    main: tuple[str, Array],
    other: tuple[str, Array] | None,
    limits: Array,
    unit: str,
) -> bytes:
    time_s = run.log["time_s"]
    thin = _thin(len(time_s))
    columns = 3
    rows = -(-len(limits) // columns)
    with _figure(2.45 * rows + 0.5) as (figure, png):
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for axes in grid.flat[len(limits) :]:
            axes.set_visible(False)
        for joint, (axes, limit) in enumerate(zip(grid.flat, limits)):
            for sign in (-1.0, 1.0):
                label = "limit" if sign > 0 else None
                style = {"color": LIMIT_COLOUR, "linestyle": "--", "linewidth": 1.5}
                axes.axhline(sign * limit, label=label, **style)
            _mark_grip(axes, run)
            if other is not None:
                style = {"color": "#c3c8cf", "linewidth": 4.0}
                axes.plot(time_s[thin], other[1][thin, joint], label=other[0], **style)
            style = {"color": TOOL_COLOUR, "linewidth": 1.5}
            axes.plot(time_s[thin], main[1][thin, joint], label=main[0], **style)
            fraction = np.abs(main[1][:, joint]) / limit
            used = (
                "none" if np.all(np.isnan(fraction)) else f"up to {100 * np.nanmax(fraction):.0f} %"
            )
            name = plain(run.chain.joint_names[joint])
            axes.set_title(f"{name}: {used}")
            half = 1.15 * max(limit, _largest(main[1][:, joint]))
            axes.set_ylim(-half, half)
            axes.set_xlim(time_s[0], time_s[-1])
            if joint % columns == 0:
                axes.set_ylabel(f"{main[0]} [{unit}]")
            if joint + columns >= len(limits):
                axes.set_xlabel("time [s]")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    return png[0]


def _largest(values: Array) -> float:
    return 0.0 if np.all(np.isnan(values)) else float(np.nanmax(np.abs(values)))


def latencies(run: Run) -> bytes | None:
    """Histograms of the controller's times; `None` when it left none or never ticked."""
    if run.controller is None or not run.controller["histograms"]["tick_us"]:
        return None
    found = run.controller["histograms"]
    histograms = (
        ("tick_us", "computing time of a tick", TOOL_COLOUR),
        ("wake_up_us", "lateness of the wake-up", TABLE_COLOUR),
        ("state_age_us", "age of the state at its use", SELF_COLOUR),
    )
    with _figure(4.2) as (figure, png):
        axes = figure.subplots()
        largest = 1.0
        for key, name, colour in histograms:
            if not found[key]:
                continue
            upper, counts = np.array(found[key], dtype=float).T
            largest = max(largest, counts.max())
            p50, p99 = (run.controller[key][p] for p in ("p50", "p99"))
            label = f"{name}: p50 {p50:.0f} µs, p99 {p99:.0f} µs"
            _histogram(axes, upper, counts, colour, label)
        axes.set(xscale="log", yscale="log", xlabel="time [µs]", ylabel="ticks in a bucket")
        axes.set_ylim(0.6, 60.0 * largest)
        axes.set_title("Times of the control loop (eight buckets an octave)")
        plain = matplotlib.ticker.FuncFormatter(lambda value, _: f"{value:g}")
        axes.xaxis.set_major_formatter(plain)
        axes.yaxis.set_major_formatter(plain)
        axes.legend(loc="upper left")
    return png[0]


def _histogram(axes: Axes, upper: Array, counts: Array, colour: str, label: str) -> None:
    """A stepped outline over logarithmic buckets; those without a count are not in the list."""
    octave = np.round(8.0 * np.log2(upper)).astype(int)
    first, last = octave.min(), octave.max()
    full = np.zeros(last - first + 1)
    np.add.at(full, octave - first, counts)
    edges = np.exp2(np.arange(first - 1, last + 1) / 8.0)
    style = {"color": colour, "linewidth": 1.8}
    axes.stairs(full, edges, baseline=0.6, fill=True, color=colour, alpha=0.14)
    axes.stairs(np.maximum(full, 0.6), edges, baseline=0.6, label=label, **style)
