"""The report: one HTML file with its pictures as SVG in it."""

from __future__ import annotations

import math
from collections import Counter
from html import escape

from sim_bridge import html
from sim_bridge.experiments.page_joints import joints_part
from sim_bridge.experiments.verdict import Verdict
from sim_bridge.html import INK

GOOD, BAD, BALL, BOX, GOAL = "#1b7f4b", "#b3261e", "#d98324", "#3b6fb6", "#7a3fb0"
TITLES = {
    "pick": "Picks: moving ball, pushes, box at rest or on a circle",
    "panda": "The same skill on another arm (Franka Panda)",
    "iiwa": "The same skill on a third arm (KUKA LBR iiwa 14)",
    "adversarial": "Frames where no goal should be",
    "singular": "Near singularities",
    "joints": "Joints with friction, rotors, unknown loads and servos, in MuJoCo",
}
DRAWN_MAX = 12
"""Episodes that are drawn one by one, failures first."""
LEGEND = (
    "From above: the path of the tool, green, or red where the episode failed; the box, blue; the "
    "ball where the arm is nearest to it, orange, its path dashed; the pushes, black, 20 cm long "
    "at 40 N; places of a false goal, violet; the base, grey. Below: clearance of the arm from the "
    "ball over time, marked where the controller reports blocked, red, or unreachable, violet."
)

_CSS = f"""
h1 {{ font-size: 26px; }}
h3 {{ font-size: 15px; margin: 16px 0 6px; }}
.yes {{ color: {GOOD}; font-weight: bold; }} .no {{ color: {BAD}; font-weight: bold; }}
.pictures {{ display: flex; flex-wrap: wrap; gap: 14px; }}
figcaption {{ font-size: 13px; color: #4a5058; max-width: 340px; }}
svg text {{ font: 11px "DejaVu Sans", sans-serif; fill: {INK}; }}
"""


def page(rows: list[dict], traces: list[list], found: list[Verdict], *, quick: bool) -> str:
    """The whole page."""
    parts = [
        "<h1>Experiments of the whole arm</h1>",
        f"<p>{len(rows)} episodes in lockstep{', a short look' if quick else ''}, in pybullet, "
        "those about joints in MuJoCo. "
        "Contacts of all links are taken from the physics at every step.</p>",
        _verdict_table(found),
    ]
    for experiment in dict.fromkeys(row["experiment"] for row in rows):
        own = [(row, t) for row, t in zip(rows, traces) if row["experiment"] == experiment]
        parts.append(_section(experiment, own))
    return html.document("Experiments of the arm", _CSS, parts)


def _verdict_table(found: list[Verdict]) -> str:
    lines = [
        f"<tr><td>{escape(v.experiment)}</td><td>{escape(v.must)}</td>"
        f"<td>{escape(v.measured)}</td>"
        f"<td class='{'yes' if v.holds else 'no'}'>{'holds' if v.holds else 'fails'}</td></tr>"
        for v in found
    ]
    return (
        "<section><h2>What must hold</h2><table><tr><th>experiment</th><th>must</th>"
        f"<th>measured</th><th></th></tr>{''.join(lines)}</table></section>"
    )


def _section(experiment: str, own: list[tuple[dict, list]]) -> str:
    rows = [row for row, _ in own]
    parts = [f"<section><h2>{escape(TITLES.get(experiment, experiment))}</h2>", _kinds(rows)]
    least = [row["clearance_min_m"] for row in rows]
    parts.append("<div class='pictures'>")
    parts.append(_figure(_top_view(own), "Path of the tool from above, all episodes."))
    errors = [1e3 * row["position_error_m"] for row in rows if row["position_error_m"] is not None]
    near, own_near = (
        [1e3 * c[what] for c in least if c[what] is not None] for what in ("obstacle", "self")
    )
    used = [100.0 * max(row["limit_fractions"].values()) for row in rows]
    for values, low, high, limit, caption in (
        (errors, 0.0, 6.0, 5.0, "Position error at the grip [mm]; the limit is 5."),
        (near, -10.0, 150.0, 0.0, "Least clearance from the obstacle [mm]; a contact is at 0."),
        (own_near, -10.0, 60.0, 0.0, "Least clearance of the arm from itself [mm]."),
        (used, 0.0, 120.0, 100.0, "Largest fraction of a position, velocity or torque limit [%]."),
    ):
        if values:
            parts.append(_figure(_histogram(values, low, high, limit), caption))
    parts.append("</div>")
    if experiment == "joints":
        parts.append(joints_part(rows))
    failed = [row for row in rows if row["cause"] is not None]
    if failed:
        lines = [(str(row["seed"]), row["kind"], row["cause"]) for row in failed]
        parts.append(f"<h3>Failures</h3>{html.rows(lines, head=('seed', 'kind', 'cause'))}")
    drawn = sorted(own, key=lambda pair: pair[0]["cause"] is None)[:DRAWN_MAX]
    parts.append(f"<h3>Episodes</h3><p>{escape(LEGEND)}</p><div class='pictures'>")
    parts += [_figure(_episode(row, trace), _outcome(row)) for row, trace in drawn]
    parts.append("</div></section>")
    return "\n".join(parts)


def _kinds(rows: list[dict]) -> str:
    lines = []
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        picked = sum(row["picked"] for row in own)
        times = sorted(row["gripped_at_s"] for row in own if row["gripped_at_s"] is not None)
        median = f"{times[len(times) // 2]:.1f} s" if times else "–"
        reasons = Counter(reason for row in own for reason in row["reasons"] if reason != "none")
        reported = ", ".join(f"{reason} in {count}" for reason, count in reasons.items()) or "–"
        lines.append((kind, f"{picked} of {len(own)}", median, reported))
    return html.rows(
        lines, head=("kind", "picked", "gripped after (median)", "reasons reported on the way")
    )


def _figure(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def _outcome(row: dict) -> str:
    what = row["cause"] or f"picked at {row['gripped_at_s']:.1f} s"
    return f"seed {row['seed']}, {row['kind']}: {what}"


class _Plane:
    """A picture of part of a plane."""

    def __init__(self, x: tuple[float, float], y: tuple[float, float], width: int = 340) -> None:
        self.x, self.y, self.width = x, y, width
        self.scale = width / (x[1] - x[0])
        self.height = round(self.scale * (y[1] - y[0]))
        self.parts: list[str] = []

    def at(self, x: float, y: float) -> tuple[float, float]:
        return (x - self.x[0]) * self.scale, (self.y[1] - y) * self.scale

    def line(self, points: list[tuple[float, float]], colour: str, width: float, more="") -> None:
        text = " ".join(f"{a:.1f},{b:.1f}" for a, b in (self.at(*p) for p in points))
        self.parts.append(
            f"<polyline points='{text}' fill='none' stroke='{colour}' "
            f"stroke-width='{width}' {more}/>"
        )

    def circle(self, x: float, y: float, radius: float, fill: str, more: str = "") -> None:
        a, b = self.at(x, y)
        size = radius * self.scale
        self.parts.append(
            f"<circle cx='{a:.1f}' cy='{b:.1f}' r='{size:.1f}' fill='{fill}' {more}/>"
        )

    def svg(self) -> str:
        return (
            f"<svg width='{self.width}' height='{self.height}' "
            f"viewBox='0 0 {self.width} {self.height}'>"
            "<rect width='100%' height='100%' fill='#fafbfc' stroke='#e1e4e8'/>"
            f"{''.join(self.parts)}</svg>"
        )


VIEW = ((-0.75, 0.95), (-0.75, 0.75))


def _base(plane: _Plane) -> None:
    plane.circle(0.0, 0.0, 0.075, "#c9ced6")
    a, b = plane.at(VIEW[0][0] + 0.05, VIEW[1][0] + 0.06)
    plane.line(
        [(VIEW[0][0] + 0.05, VIEW[1][0] + 0.04), (VIEW[0][0] + 0.25, VIEW[1][0] + 0.04)], INK, 2
    )
    plane.parts.append(f"<text x='{a:.0f}' y='{b - 3:.0f}'>0.2 m</text>")


def _top_view(own: list[tuple[dict, list]]) -> str:
    plane = _Plane(*VIEW)
    _base(plane)
    for row, trace in own:
        if trace:
            colour = GOOD if row["cause"] is None else BAD
            plane.line([(p[1], p[2]) for p in trace], colour, 0.8, "opacity='0.5'")
    return plane.svg()


def _episode(row: dict, trace: list) -> str:
    """From above, and below it the clearance over time."""
    plane = _Plane(*VIEW)
    _base(plane)
    if not trace:
        return plane.svg()
    radius = row["settings"]["ball"]["radius_m"]
    if trace[0][9] > -1.0:
        plane.line([(p[7], p[8]) for p in trace], BALL, 1.0, "stroke-dasharray='3 3'")
        nearest = min(trace, key=lambda p: p[13])
        plane.circle(nearest[7], nearest[8], radius, BALL, "opacity='0.45'")
    plane.line([(p[4], p[5]) for p in trace], BOX, 1.0, "stroke-dasharray='2 2'")
    plane.circle(trace[-1][4], trace[-1][5], 0.03, BOX)
    if row["settings"]["false_goal"] is not None:
        for x, y in dict.fromkeys((p[10], p[11]) for p in trace):
            held_x = min(max(x, VIEW[0][0]), VIEW[0][1])
            held_y = min(max(y, VIEW[1][0]), VIEW[1][1])
            plane.circle(held_x, held_y, 0.018, GOAL, "opacity='0.6'")
    plane.line([(p[1], p[2]) for p in trace], GOOD if row["cause"] is None else BAD, 1.8)
    plane.circle(trace[0][1], trace[0][2], 0.012, INK)
    for push in row["settings"]["pushes"]:
        near = min(trace, key=lambda p: abs(p[0] - push["from_s"]))
        fx, fy, _ = push["force_n"]
        length = 0.2 / 40.0
        plane.line(
            [(near[1], near[2]), (near[1] + length * fx, near[2] + length * fy)], "#111", 2.2
        )
    return plane.svg() + "<br>" + _over_time(trace)


def _over_time(trace: list) -> str:
    width, height, top = 340, 76, 0.3
    end = max(trace[-1][0], 1.0)
    points = " ".join(
        f"{30 + (width - 40) * p[0] / end:.1f},{8 + 50 * (1.0 - min(p[13], top) / top):.1f}"
        for p in trace
    )
    stands = "".join(
        f"<rect x='{30 + (width - 40) * p[0] / end:.1f}' y='58' width='2' height='6' "
        f"fill='{BAD if p[14] == 17 else GOAL}'/>"
        for p in trace
        if p[14] >= 17
    )
    return (
        f"<svg width='{width}' height='{height}'><polyline points='{points}' fill='none' "
        f"stroke='{BALL}' stroke-width='1.5'/><line x1='30' y1='58' x2='{width - 10}' y2='58' "
        f"stroke='{INK}'/>{stands}<text x='2' y='16'>0.3</text><text x='2' y='60'>0 m</text>"
        f"<text x='{width - 40}' y='74'>{end:.1f} s</text></svg>"
    )


def _histogram(values: list[float], low: float, high: float, limit: float, bins: int = 32) -> str:
    width, height = 340, 150
    counts = [0] * bins
    for value in values:
        fraction = (min(max(value, low), high) - low) / (high - low)
        counts[min(bins - 1, math.floor(bins * fraction))] += 1
    top = max([1, *counts])
    step = (width - 20) / bins
    bars = "".join(
        f"<rect x='{10 + k * step:.1f}' y='{120 - 100 * count / top:.1f}' "
        f"width='{step - 1:.1f}' height='{100 * count / top:.1f}' fill='{BOX}'/>"
        for k, count in enumerate(counts)
    )
    x = 10 + (width - 20) * (limit - low) / (high - low)
    return (
        f"<svg width='{width}' height='{height}'>{bars}"
        f"<line x1='10' y1='120' x2='{width - 10}' y2='120' stroke='{INK}'/>"
        f"<line x1='{x:.1f}' y1='14' x2='{x:.1f}' y2='120' stroke='{BAD}' stroke-dasharray='4 3'/>"
        f"<text x='10' y='136'>{low:g}</text>"
        f"<text x='{width - 10}' y='136' text-anchor='end'>{high:g}</text>"
        f"<text x='{x:.1f}' y='12' text-anchor='middle'>{limit:g}</text>"
        f"<text x='{width / 2}' y='136' text-anchor='middle'>"
        f"{len(values)} episodes, most {top} in a bar</text></svg>"
    )
