"""What the pages of this package have in common: one HTML file each, with everything in it."""

from __future__ import annotations

from html import escape

INK = "#23262b"

_CSS = f"""
:root {{ color-scheme: light; }}
* {{ box-sizing: border-box; }}
body {{ margin: 0; background: #f4f5f7; color: {INK};
  font: 16px/1.5 "DejaVu Sans", "Segoe UI", Helvetica, Arial, sans-serif; }}
main {{ max-width: 1080px; margin: 0 auto; padding: 32px 20px 64px; }}
h2 {{ font-size: 20px; margin: 0 0 10px; }}
section {{ background: white; border: 1px solid #e1e4e8; border-radius: 10px;
  padding: 20px 24px; margin: 0 0 22px; }}
table {{ border-collapse: collapse; width: 100%; }}
td, th {{ padding: 7px 14px 7px 0; border-top: 1px solid #eceef1; text-align: left;
  vertical-align: baseline; font-variant-numeric: tabular-nums; }}
figure {{ margin: 0; }}
"""


def document(title: str, css: str, parts: list[str]) -> str:
    """A page of these parts; `css` is added to the style that all pages have."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_CSS}{css}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )


def rows(cells: list[tuple[str, ...]], *, head: tuple[str, ...] = ()) -> str:
    """A table of texts."""
    lines = [f"<tr>{''.join(f'<th>{escape(text)}</th>' for text in head)}</tr>\n"] if head else []
    for row in cells:
        lines.append(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>\n")
    return f"<table>\n{''.join(lines)}</table>"
