"""How does a report look? Pieces of one self-contained HTML page: text, numbers, tables, charts, pictures.

Rule: everything is in the file and nothing is fetched: charts are inline SVG, pictures and films data, there is no script,
and the page forbids its browser to load anything. Charts and tables are made for paper as well as for a screen.
"""

from __future__ import annotations

import base64
import html
import io
import math
import pathlib
import re
from collections.abc import Iterable, Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_PICTURE = 1100  # pixels across
WIDTH = 9.6  # in
TYPES = {".mp4": "video/mp4", ".webp": "image/webp"}


class Raw(str):
    """Text that is HTML already."""


def text(value: Any) -> str:
    """A value as HTML."""
    return value if isinstance(value, Raw) else html.escape(str(value))


def number(value: Any, digits: int = 4) -> str:
    """A number as one reads it: `digits` significant ones, powers of ten where it is very large or small."""
    if value is None or not isinstance(value, int | float) or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    if isinstance(value, int) or 1e-3 <= abs(value) < 1e5:
        if isinstance(value, int) or abs(value) >= 10**digits:
            return _minus(f"{value:.0f}")
        return _minus(f"{value:#.{digits}g}".rstrip("."))
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    return Raw(f"{_minus(mantissa)} × 10<sup>{_minus(str(int(power)))}</sup>")


def _minus(shown: str) -> str:
    return shown.replace("-", "−")


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], *, caption: str = "", numeric: str = "") -> str:
    """A table; `numeric` has one letter for each column: n for numbers, w for wide text, anything else for text."""
    kinds = (numeric or "").ljust(len(head), ".")
    marks = [f' class="{kind}"' if kind in "nw" else "" for kind in kinds]
    lines = ['<div class="wide"><table>']
    if caption:
        lines.append(f"<caption>{text(caption)}</caption>")
    cells = "".join(f"<th{mark}>{text(name)}</th>" for name, mark in zip(head, marks, strict=True))
    lines.append(f"<thead><tr>{cells}</tr></thead><tbody>")
    for row in rows:
        cells = "".join(f"<td{mark}>{text(cell)}</td>" for cell, mark in zip(row, marks, strict=True))
        lines.append(f"<tr>{cells}</tr>")
    return "\n".join([*lines, "</tbody></table></div>"])


def chart(figure: Figure, name: str, caption: str) -> str:
    """A figure of matplotlib as inline SVG; its names get a prefix, because several stand on one page.

    All have one scale: a figure of `WIDTH` inches is as wide as the page.
    """
    from matplotlib import rc_context

    buffer = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.S)
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", svg)
    part = min(figure.get_figwidth() / WIDTH, 1.0)
    opening = rf'<svg \1 role="img" aria-label="{text(caption)}" style="--part: {part:.3f}">'
    svg = re.sub(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', opening, svg, count=1)
    svg = svg.replace("xlink:href", "href")
    return f'<figure><div class="chart">{svg}</div><figcaption>{text(caption)}</figcaption></figure>'


def picture(path: pathlib.Path, caption: str) -> str:
    """A picture in the page, not larger than a page needs, as the smaller of PNG and JPEG."""
    from PIL import Image

    with Image.open(path) as opened:
        image = opened.convert("RGB")
    image.thumbnail((LARGEST_PICTURE, LARGEST_PICTURE))
    made = []
    for kind, options in (("png", {"optimize": True}), ("jpeg", {"quality": 88})):
        buffer = io.BytesIO()
        image.save(buffer, kind, **options)
        made.append((len(buffer.getvalue()), kind, buffer.getvalue()))
    _, kind, data = min(made)
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    size = f'width="{image.width}" height="{image.height}"'
    return f'<figure><img src="{source}" {size} alt="{text(caption)}"><figcaption>{text(caption)}</figcaption></figure>'


def film(path: pathlib.Path, caption: str) -> str:
    """A film in the page, as it is."""
    source = f"data:{TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"
    shown = f'<video controls loop muted src="{source}"></video>'
    if path.suffix == ".webp":
        shown = f'<img src="{source}" alt="{text(caption)}">'
    return f"<figure>{shown}<figcaption>{text(caption)}</figcaption></figure>"


def page(title: str, body: Iterable[str]) -> str:
    """The whole file."""
    style = (resources.files("cosserat_fem.report") / "report.css").read_text(encoding="utf-8")
    allowed = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'"
    return "\n".join(
        [
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{allowed}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<title>{text(title)}</title>\n<link rel="icon" href="data:,">\n<style>\n{style}</style>\n</head>\n<body>',
            *body,
            "</body>\n</html>\n",
        ]
    )
