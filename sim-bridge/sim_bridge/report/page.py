"""The report's page: one HTML file with everything in it."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from html import escape

import numpy as np

from sim_bridge import html
from sim_bridge.evaluate import DISTANCE_MAX_M
from sim_bridge.poses import Array
from sim_bridge.report.figures import BODIES, Run, demonstrated_path, plain
from sim_bridge.report.pictures import OBJECT_COLOUR, SPHERE_COLOUR, TABLE_COLOUR, TOOL_COLOUR
from sim_bridge.report.plots import DEMONSTRATION_COLOUR, SELF_COLOUR

_CSS = f"""
h1 {{ font-size: 28px; margin: 0 12px 0 0; display: inline-block; }}
.badge {{ display: inline-block; padding: 3px 14px; border-radius: 16px; color: white;
  font-weight: bold; vertical-align: 5px; }}
.yes {{ background: {OBJECT_COLOUR}; }}
.no {{ background: #b3261e; }}
.lead {{ margin: 6px 0 22px; color: #4a5058; }}
.failures {{ border-color: #b3261e; background: #fdf3f2; }}
.failures ul {{ margin: 0; padding-left: 20px; }}
tr:first-child td {{ border-top: 0; }}
td:nth-child(2) {{ font-weight: bold; white-space: nowrap; }}
td:nth-child(3) {{ color: #5b626c; font-size: 14.5px; }}
img {{ display: block; max-width: 100%; height: auto; margin: 0 auto; border-radius: 4px; }}
figcaption {{ margin-top: 12px; color: #3a4048; }}
.key {{ display: inline-block; width: 12px; height: 12px; border-radius: 3px;
  margin: 0 5px 0 2px; vertical-align: -1px; }}
@media (max-width: 640px) {{ td:nth-child(3) {{ display: none; }} }}
"""


@dataclass(frozen=True)
class Figure:
    """A picture with its heading and what is seen in it (HTML)."""

    heading: str
    image: bytes
    kind: str
    """`png` or `gif`."""
    caption: str


def page(run: Run, values: dict, rows: list[tuple[str, str, str]], figures: list[Figure]) -> str:
    """The whole page."""
    title = f"{run.scene.task.skill.capitalize()}, seed {values['seed']}"
    badge = ("yes", "succeeded") if values["success"] else ("no", "failed")
    parts = [
        f'<h1>{escape(title)}</h1><span class="badge {badge[0]}">{badge[1]}</span>',
        f'<p class="lead">{escape(_lead(run))}</p>',
    ]
    if not values["success"]:
        items = "".join(f"<li>{escape(sentence)}</li>" for sentence in values["failures"])
        parts.append(f'<section class="failures"><h2>What failed</h2><ul>{items}</ul></section>')
    parts.append(f"<section><h2>The run in figures</h2>\n{html.rows(rows)}</section>")
    for figure in figures:
        data = base64.b64encode(figure.image).decode("ascii")
        parts.append(
            f"<section><h2>{escape(figure.heading)}</h2>\n<figure>"
            f'<img alt="{escape(figure.heading)}" src="data:image/{figure.kind};base64,{data}">'
            f"\n<figcaption>{figure.caption}</figcaption></figure></section>"
        )
    return html.document(title, _CSS, parts)


def _lead(run: Run) -> str:
    duration = run.log["time_s"][-1] - run.log["time_s"][0]
    return (
        f"{duration:.1f} s of motion, recorded in {run.bridge['mode']} at "
        f"{run.scene.physics.rate_hz:g} Hz. Every figure and picture below comes from the recorded "
        "log and the controller's own summary."
    )


def _key(colour: str, name: str) -> str:
    return f'<span class="key" style="background:{colour}"></span>{name}'


def motion_caption(run: Run) -> str:
    """For the still pictures."""
    box, sphere = _key(OBJECT_COLOUR, "green"), _key(SPHERE_COLOUR, "orange")
    end = "does not grip it"
    if run.judged["gripped"]:
        end = f"lifts it by {1e3 * run.judged['lifted_m']:.0f} mm"
    return (
        f"The arm moves its suction cup towards the moving box ({box}), beside the swinging sphere "
        f"({sphere}), and {end}. The line ({_key(TOOL_COLOUR, 'blue')}) is the path of the cup so "
        "far; times count from the first command."
    )


def animation_caption(speed: float) -> str:
    """For the animation; `speed` is how much faster than real time it plays."""
    real_time = abs(speed - 1.0) < 0.05
    pace = "in real time" if real_time else f"{speed:.1f} times as fast as in real time"
    return f"The same motion, {pace}. The last picture stays for a moment."


def path_caption(run: Run) -> str:
    """For the path in the object frame."""
    tips = [demonstrated_path(d, run.scene.task.goal_frame)[-1] for d in run.demonstrations]
    spread = 1e3 * max(float(np.linalg.norm(tip - run.grasp[:3, 3])) for tip in tips)
    row = len(run.path_in_object_m) - 1 if run.gripped_row is None else run.gripped_row - 1
    off = 1e3 * float(run.position_error_m[max(0, row)])
    end = "ends" if run.gripped_row is None else "ends at the grip,"
    return (
        f"The path of the cup as seen from the box ({_key(OBJECT_COLOUR, 'green')}), which moves "
        f"and rotates with its frame. This run ({_key(TOOL_COLOUR, 'blue')}) {end} {off:.2f} mm "
        f"from where the {len(tips)} demonstrations ({_key(DEMONSTRATION_COLOUR, 'grey')}) end in "
        f"the mean; these end within {spread:.2f} mm of it."
    )


def errors_caption(run: Run) -> str:
    """For the errors over time."""
    judged = run.judged
    if run.gripped_row is None:
        return "The box was not gripped; the errors are drawn up to the end of the run."
    return (
        f"The tool closes in on the box while the box moves. At the grip, after "
        f"{judged['gripped_at_s']:.2f} s, {judged['position_error_mm']:.2f} mm and "
        f"{judged['orientation_error_deg']:.2f}° are left. From then on (tinted) the box hangs on "
        "the cup."
    )


def clearance_caption(run: Run) -> str:
    """For the clearance over time."""
    colours = {"sphere": SPHERE_COLOUR, "table": TABLE_COLOUR, "self": SELF_COLOUR}
    names = {"sphere": "sphere", "table": "table", "self": "arm itself"}
    parts = [
        f"{_key(colours[body], names[body])} {1e3 * run.judged[f'clearance_{body}_m']:.1f} mm "
        f"({escape(plain(run.judged[f'clearance_{body}_where']))})"
        for body in BODIES
    ]
    return (
        f"The least distances: {', '.join(parts)}. Links that follow each other in the chain touch "
        "by design and are left out, so is the first link, which rotates on the table; distances "
        f"above {1e3 * DISTANCE_MAX_M:.0f} mm are not measured."
    )


def limits_caption(run: Run, name: str, values: Array, limits: Array) -> str:
    """For the small multiples of torques and velocities."""
    fractions = np.abs(values) / limits
    if np.all(np.isnan(fractions)):
        return "The arm was braked all the time."
    joint = int(np.nanargmax(np.nanmax(np.nan_to_num(fractions, nan=0.0), axis=0)))
    used = 100.0 * float(np.nanmax(fractions[:, joint]))
    nearest = plain(run.chain.joint_names[joint])
    return (
        f"Every joint's {name} against its limit (dashed). The joint nearest to it is "
        f"{escape(nearest)}, with {used:.0f} %."
    )


def latencies_caption(values: dict) -> str:
    """For the controller's times."""
    tick, age = values["tick_us"], values["state_age_us"]
    return (
        f"A tick of the controller computes for {tick['p50']:.0f} µs in the median and "
        f"{tick['max']:.0f} µs at most; the state it uses is {age['p50']:.0f} µs old in the median "
        f"and {age['max']:.0f} µs at most. {values['deadline_misses']} of {values['ticks']} "
        "deadlines were missed. Both axes are logarithmic."
    )
