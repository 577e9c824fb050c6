"""The part of the report about joints: a table of all cases, and the grip over the lag."""

from __future__ import annotations

from html import escape

from sim_bridge import html
from sim_bridge.html import INK

COLOURS = {"position": "#3b6fb6", "velocity": "#d98324"}
WIDTH, HEIGHT, LEFT, BOTTOM = 420, 220, 40, 30
HEAD = ("case", "gripped after", "position error", "angle", "largest torque", "")


def joints_part(rows: list[dict]) -> str:
    """Table and picture."""
    lines = [
        (
            row["label"],
            _number(row["gripped_at_s"], "{:.2f} s"),
            _number(row["position_error_m"], "{:.2f} mm", 1e3),
            _number(row["orientation_error_deg"], "{:.2f}°"),
            _number(row["limit_fractions"]["torque"], "{:.0f} %", 100.0),
            "holds" if row["cause"] is None else "fails",
        )
        for row in rows
    ]
    return f"{_lags(rows)}<h3>All cases</h3>{html.rows(lines, head=HEAD)}"


def _number(value: float | None, text: str, scale: float = 1.0) -> str:
    return "–" if value is None else text.format(scale * value)


def _lags(rows: list[dict]) -> str:
    """Time of the grip over the lag of the servo."""
    lines: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        joints = row["settings"]["joints"]
        if row["kind"] == "servo" and row["gripped_at_s"] is not None:
            point = (joints["servo_lag_s"], row["gripped_at_s"])
            lines.setdefault(joints["interface"], []).append(point)
    if not lines:
        return ""
    top = 1.1 * max(t for points in lines.values() for _, t in points)
    parts = [
        f"<line x1='{LEFT}' y1='{HEIGHT - BOTTOM}' x2='{WIDTH}' y2='{HEIGHT - BOTTOM}' "
        f"stroke='{INK}'/><text x='4' y='14'>{top:.1f} s</text>"
        f"<text x='4' y='{HEIGHT - BOTTOM}'>0 s</text>"
        f"<text x='{WIDTH - 60}' y='{HEIGHT - 10}'>lag 0.2 s</text>"
    ]
    for k, (interface, points) in enumerate(sorted(lines.items())):
        at = [
            (
                LEFT + (WIDTH - LEFT - 10) * lag / 0.2,
                (HEIGHT - BOTTOM) * (1.0 - time_s / top),
            )
            for lag, time_s in sorted(points)
        ]
        colour, text = COLOURS[interface], " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
        parts.append(
            f"<polyline points='{text}' fill='none' stroke='{colour}' stroke-width='1.8'/>"
            f"<text x='{LEFT + 120 * k}' y='{HEIGHT - 10}' fill='{colour}'>"
            f"{escape(interface)} servo</text>"
        )
    svg = f"<svg width='{WIDTH}' height='{HEIGHT}'>{''.join(parts)}</svg>"
    return f"<figure>{svg}<figcaption>Time of the grip over the servo's lag.</figcaption></figure>"
