"""From a :class:`~ctlabs.reporting.report.Report` to files: Markdown, HTML, figures, CSV tables, results.json.

A folder is written beside its final place under a temporary name and then renamed, so an interrupted run leaves the
report that was there. Figures are palette PNGs without dates, so the same numbers give the same bytes.
"""

from __future__ import annotations

import base64
import csv
import io
import json
import re
import shutil
import tempfile
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import numpy as np
from jinja2 import Environment, PackageLoader
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

from ctlabs.reporting.agreement import known
from ctlabs.reporting.cells import plain_words, reasons
from ctlabs.reporting.crossrefs import ANCHOR, END, FOLD, TITLE
from ctlabs.reporting.drawing import Drawing
from ctlabs.reporting.keeping import keep
from ctlabs.reporting.markdown import SMALL, markdown
from ctlabs.reporting.mathfont import font
from ctlabs.reporting.mathml import STYLE, lines, mathml
from ctlabs.reporting.paper import to_matplotlib
from ctlabs.reporting.params import plain
from ctlabs.reporting.report import Picture, Report, Table
from ctlabs.text import Uncertain, _, number, translated

#: Resolution of figures, dots per inch.
DPI = 130
#: Colours of a figure: those of its curves with their shades.
COLOURS = 64
#: The small copy of the key figure, as a share of the figure.
COPY = 0.5
#: What tells an index of ours from somebody's README.md or index.html.
MARK = "<!-- index written by ctlabs -->"
#: Lists of at most so many elements are short enough for a terminal.
SHORT = 4
#: Of sentences on a terminal, in characters.
WIDTH = 100


def write(report: Report, folder: Path) -> None:
    """Write the report to ``folder`` (``OUT/LAB``), replacing what was there as a whole."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    place = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        place.chmod(0o755)
        _fill(report, place)
        keep(place, folder)
        swap(place, folder)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def html(report: Report, pictures: dict[str, bytes]) -> str:
    """The report as one self-contained page: equations as MathML, figures inside, no request to any server."""
    return page(translated(report.meta["title"]), markdown(report, "page"), report.around, pictures)


def page(
    title: str,
    text: str,
    around: Mapping[str, tuple[str, str]] = MappingProxyType({}),
    pictures: Mapping[str, bytes] = MappingProxyType({}),
) -> str:
    """Markdown for a page as such a page, with the ways ``around`` it and the pictures that it shows, by name."""
    body = _markdown_it().render(text)
    body = re.sub(rf"<p>{FOLD}(.*?){TITLE}</p>", r"<details><summary>\1</summary>", body).replace(f"<p>{END}</p>", "</details>")
    body = re.sub(f"<p>({ANCHOR.pattern})</p>", r"\1", body)
    contents = [(int(level), name, title) for level, title, name in re.findall(rf"<h([23])[^>]*>(.*?){ANCHOR.pattern}</h\1>", body)]
    body = ANCHOR.sub(r'<a id="\1"></a>', body)
    for name, data in pictures.items():
        source, small = f'src="figures/{name}.png"', f' alt="{_(SMALL)}"'
        if source + small in body:
            body = body.replace(source + small, f'src="{embedded(data, COPY)}"{small}')
        body = body.replace(source, f'src="{embedded(data)}"')
    template = environment().get_template("report.html")
    return template.render(
        title=title, body=body, contents=contents, around=around, matrices=STYLE, font=font(body) if "<math" in body else "", _=_,
    )


def embedded(picture: bytes, share: float = 1.0) -> str:
    """A PNG for the inside of a page: as WebP, which loses nothing and takes fewer bytes; ``share`` of its width."""
    image, packed = Image.open(io.BytesIO(picture)).convert("RGB"), io.BytesIO()
    if share < 1:
        image = image.resize((max(1, int(share * image.width)), max(1, int(share * image.height))), Image.Resampling.LANCZOS)
        image = _of_few_colours(image, COLOURS // 2).convert("RGB")
    image.save(packed, "webp", lossless=True)
    return f"data:image/webp;base64,{base64.b64encode(packed.getvalue()).decode()}"


def inline(text: str) -> str:
    """A line of Markdown as HTML, without a paragraph around it."""
    return str(_markdown_it().renderInline(text))


def summary(report: Report, tables: Sequence[str] = ()) -> list[str]:
    """The report's short values, and the ``tables`` of these names, as aligned lines for a terminal."""
    lines = [translated(report.meta["title"])]
    values = [
        value
        for value in report.values.values()
        if not isinstance(value.value, list) or (len(value.value) <= SHORT and not any(map(_nested, value.value)))
    ]
    sentences = [value.value for value in values if isinstance(value.value, str) and " " in value.value]
    short = [value for value in values if value.value not in sentences]
    rows = [
        [value.name, number(_single(value.value)), "" if value.unit == "1" else value.unit, reason]
        for value, reason in zip(short, reasons(short), strict=True)
    ]
    lines += ["", *_columns(rows)]
    for block in report.blocks:
        if isinstance(block, Table) and block.name in tables:
            cells = [
                [plain_words(column) for column in block.columns],
                *([number(cell, 3) for cell in row] for row in block.rows),
            ]
            lines += ["", *_columns(cells)]
    return lines + [line for sentence in sentences for line in ("", *textwrap.wrap(sentence, WIDTH))]


def drawn(figure: Drawing | Figure) -> Figure:
    """A figure as matplotlib has it."""
    return to_matplotlib(figure) if isinstance(figure, Drawing) else figure


def svg(figure: Drawing | Figure) -> bytes:
    """A figure as SVG; the same figure gives the same bytes."""
    figure, raw = drawn(figure), io.BytesIO()
    FigureCanvasSVG(figure)
    with mpl.rc_context({"svg.hashsalt": "ctlabs"}):
        figure.savefig(raw, format="svg", metadata={"Date": None}, facecolor="white")
    return raw.getvalue()


def png(figure: Drawing | Figure) -> bytes:
    """A figure as a palette PNG; the same figure gives the same bytes."""
    figure = drawn(figure)
    figure.set(dpi=DPI, facecolor="white")
    canvas, packed = FigureCanvasAgg(figure), io.BytesIO()
    canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib's. Once: savefig would draw twice, into a file only to be read
    dots = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])  # type: ignore[no-untyped-call]
    _of_few_colours(dots, COLOURS).save(packed, format="png", optimize=True)
    return packed.getvalue()


def _of_few_colours(image: Image.Image, count: int) -> Image.Image:
    """A picture with a palette, no dot of which is scattered."""
    return image.quantize(count, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def _fill(report: Report, place: Path) -> None:
    (place / "figures").mkdir()
    (place / "tables").mkdir()
    pictures = {block.name: png(block.figure) for block in report.blocks if isinstance(block, Picture)}
    for name, data in pictures.items():
        (place / "figures" / f"{name}.png").write_bytes(data)
    for block in report.blocks:
        if isinstance(block, Table):
            with (place / "tables" / f"{block.name}.csv").open("w", newline="", encoding="utf-8") as file:
                csv.writer(file).writerows(
                    [[plain_words(c) for c in block.columns], *([_csv(cell) for cell in row] for row in block.rows)]
                )
    for name, content in report.files.items():
        (place / name).write_bytes(content)
    (place / "report.md").write_text(markdown(report), encoding="utf-8")
    (place / "report.html").write_text(html(report, pictures), encoding="utf-8")
    (place / "results.json").write_text(_json(report.results()), encoding="utf-8")


def swap(place: Path, folder: Path) -> None:
    """Rename ``place`` to ``folder``; what stood there goes only when the new one is in its place."""
    old = place.with_name(place.name + "-old")
    try:
        if folder.exists():
            folder.rename(old)
        place.rename(folder)
    except BaseException:
        if old.exists() and not folder.exists():
            old.rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)


def replace(path: Path, text: str) -> None:
    """Write an index, but never over a file that is not one (``--out .`` in somebody's project)."""
    if path.exists() and MARK not in path.read_text(encoding="utf-8", errors="replace"):
        return
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)


def _json(results: dict[str, Any]) -> str:
    """JSON with one value and one check a line: readable, and small differences give small diffs."""
    lines = []
    for key, value in results.items():
        if isinstance(value, dict) and value:
            inner = ",\n".join(
                f"  {json.dumps(k)}: {json.dumps(v, ensure_ascii=False, allow_nan=False)}" for k, v in value.items()
            )
            lines.append(f" {json.dumps(key)}: {{\n{inner}\n }}")
        elif isinstance(value, list) and value:
            inner = ",\n".join(f"  {json.dumps(v, ensure_ascii=False, allow_nan=False)}" for v in value)
            lines.append(f" {json.dumps(key)}: [\n{inner}\n ]")
        else:
            lines.append(f" {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _nested(value: Any) -> bool:
    """Whether a value is a list: of a matrix, a complex number, a polynomial."""
    return isinstance(value, list)


def _single(value: Any) -> Any:
    """The element of a list that has one."""
    return value[0] if isinstance(value, list) and len(value) == 1 else value


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of words with their columns one below the other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _csv(value: Any) -> Any:
    if isinstance(value, Uncertain):
        return known(float(value.value))
    return "" if value is None else json.dumps(known(plain(value))) if isinstance(value, list | tuple | np.ndarray) else known(value)


def environment() -> Environment:
    """The templates."""
    return Environment(loader=PackageLoader("ctlabs.reporting"), autoescape=True, trim_blocks=True, lstrip_blocks=True)


def _markdown_it() -> Any:
    from markdown_it import MarkdownIt
    from mdit_py_plugins.anchors import anchors_plugin
    from mdit_py_plugins.dollarmath import dollarmath_plugin

    def shown(latex: str, options: dict[str, Any]) -> str:
        if not options["display_mode"]:
            return mathml(latex)
        latex, _tag, number = latex.partition(r"\tag{")
        told = f'<span class="number">({number.strip().rstrip("}")})</span>' if number else ""
        return "".join(mathml(line, block=True) for line in lines(latex)) + told

    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    # Words of a model file may not make the page ask another machine for anything.
    parser.validateLink = lambda url: ":" not in url and "//" not in url  # type: ignore[method-assign]
    return parser.use(dollarmath_plugin, renderer=shown, allow_digits=True).use(anchors_plugin, max_level=3)
