"""The report of a run: a table on the terminal, `result.json`, `report.html` and `demo.png`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from sim_bridge.files import write
from sim_bridge.report import page, plots
from sim_bridge.report.figures import Run, load_run, result, table
from sim_bridge.report.page import Figure
from sim_bridge.report.pictures import Stage, animation, png_below, stamp, tile

RESULT_FILE = "result.json"
PAGE_FILE = "report.html"
PICTURE_FILE = "demo.png"
PICTURE_BYTES_MAX = 300_000
# Longer runs play faster than in real time.
FRAME_TIME_MAX_S = 0.2
LAST_FRAME_S = 1.5


@dataclass(frozen=True)
class Detail:
    """How much is rendered."""

    width: int = 560
    height: int = 420
    frames: int = 56
    """Pictures of the animation."""
    stills: int = 8
    """Pictures side by side on the page."""
    picture_stills: int = 6
    """Of these, how many go into `demo.png`."""


def report(folder: Path, detail: Detail | None = None) -> int:
    """Judges and draws the run in `folder`; gives the exit code, 1 when the pick failed."""
    run = load_run(folder)
    values = result(run)
    rows = table(run, values)
    _print(run, values, rows)
    # Judged and drawn anew: a report is no record of anything.
    write(folder / RESULT_FILE, json.dumps(values, indent=1) + "\n", force=True)
    # The figures are there by now, whatever becomes of the pictures.
    figures, picture = _draw(run, values, detail or Detail())
    write(folder / PICTURE_FILE, picture, force=True)
    write(folder / PAGE_FILE, page.page(run, values, rows, figures), force=True)
    print(f"report: {folder / PAGE_FILE}")
    return 0 if values["success"] else 1


def _print(run: Run, values: dict, rows: list[tuple[str, str, str]]) -> None:
    print(f"{run.scene.task.skill}, seed {values['seed']}, {run.bridge['mode']}")
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    for name, value, remark in rows:
        print(f"  {name:{widths[0]}}  {value:>{widths[1]}}  {remark}")
    for sentence in values.get("failures", []):
        print(f"  failed: {sentence}")
    sys.stdout.flush()


class _Progress:
    """Counts on standard error: in place on a terminal, every tenth line elsewhere."""

    def __init__(self, total: int) -> None:
        self.done, self.total = 0, total
        self.terminal = sys.stderr.isatty()

    def step(self) -> None:
        """One picture more."""
        self.done += 1
        last = self.done == self.total
        text = f"rendering {self.done}/{self.total}"
        if self.terminal:
            print(f"\r{text}", end="\n" if last else "", file=sys.stderr, flush=True)
        elif last or self.done % 10 == 0:
            print(text, file=sys.stderr, flush=True)


def moments(run: Run, count: int) -> dict[int, str]:
    """Rows of the log worth a picture, in order, and a note to each (may be empty).

    Start, end, the grip and the nearest approach to the sphere; then the longest gap in time is
    halved until there are `count`. More of them contain fewer of them.
    """
    time_s = run.log["time_s"]
    last = len(time_s) - 1
    chosen = {0: "start", last: "end"}
    if run.gripped_row is not None:
        chosen[run.gripped_row] = "gripped"
    near = int(np.argmin(run.clearance_m["sphere"]))
    distance_mm = 1e3 * run.clearance_m["sphere"][near]
    note = "touches the sphere" if distance_mm <= 0.0 else f"{distance_mm:.0f} mm from the sphere"
    row = int(np.searchsorted(time_s, run.clearance_time_s[near]))
    if np.min(np.abs(time_s[list(chosen)] - time_s[row])) > 0.02 * (time_s[-1] - time_s[0]):
        chosen[row] = note
    while len(chosen) < min(count, last + 1):
        order = sorted(chosen)
        left, right = max(zip(order, order[1:]), key=lambda gap: gap[1] - gap[0])
        chosen[(left + right) // 2] = ""
    return dict(sorted(chosen.items()))


def _draw(run: Run, values: dict, detail: Detail) -> tuple[list[Figure], bytes]:
    """Every figure of the page, and the picture for elsewhere."""
    time_s = run.log["time_s"]
    last = len(time_s) - 1
    stills = moments(run, detail.stills)
    few = moments(run, detail.picture_stills)
    frame_rows = sorted(set(np.linspace(0, last, detail.frames).round().astype(int).tolist()))
    stage = Stage(run.scene, run.log, detail.width, detail.height)
    try:
        pictures = _render(stage, sorted({*stills, *few, *frame_rows}))
    finally:
        stage.close()

    def stamped(rows: dict[int, str], fraction: float) -> list[Image.Image]:
        size = round(fraction * detail.width)
        return [stamp(pictures[row], time_s[row], note, size) for row, note in rows.items()]

    frames = stamped(dict.fromkeys(frame_rows, ""), 0.04)
    # Four side by side are smaller than three.
    sheet = tile(stamped(stills, 0.062), 4)
    picture = tile(stamped(few, 0.05), 3)
    duration_s = float(time_s[-1] - time_s[0])
    frame_s = duration_s / max(1, len(frames) - 1)
    picture_s = min(max(round(frame_s, 2), 0.02), FRAME_TIME_MAX_S)
    sheet_png = png_below(sheet, 900_000)
    gif = animation(frames, picture_s, LAST_FRAME_S)
    speed = frame_s / picture_s
    figures = [
        Figure("The motion in pictures", sheet_png, "png", page.motion_caption(run)),
        Figure("The motion", gif, "gif", page.animation_caption(speed)),
        *_plots(run, values),
    ]
    return figures, png_below(picture, PICTURE_BYTES_MAX)


def _render(stage: Stage, rows: Sequence[int]) -> dict[int, Image.Image]:
    progress = _Progress(len(rows))
    pictures = {}
    for row in rows:
        pictures[row] = stage.picture(row)
        progress.step()
    return pictures


def _plots(run: Run, values: dict) -> list[Figure]:
    torque = page.limits_caption(run, "torque", run.log["torque_n_m"], run.chain.effort_max_n_m)
    velocity = page.limits_caption(
        run, "velocity", run.log["velocity_rad_s"], run.chain.velocity_max_rad_s
    )
    drawn = [
        ("The path of the tool", plots.path(run), page.path_caption(run)),
        ("Errors against the demonstrated grasp", plots.errors(run), page.errors_caption(run)),
        ("Clearances", plots.clearance(run), page.clearance_caption(run)),
        ("Joint torques", plots.torques(run), torque),
        ("Joint velocities", plots.velocities(run), velocity),
    ]
    histogram = plots.latencies(run)
    if histogram is not None:
        drawn.append(("Times of the controller", histogram, page.latencies_caption(values)))
    return [Figure(heading, png, "png", caption) for heading, png, caption in drawn]
