"""A report on paper: PDF by typst, LaTeX source, or Word, made by pandoc from its Markdown, with a title page.

The extra ``print`` brings both programs as wheels. Nothing here computes: a report's folder is read as it was written.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ctlabs import reporting
from ctlabs.reporting.symbols import GREEK
from ctlabs.text import LOWERED

TEMPLATES = Path(reporting.__file__).parent / "templates"
#: Further files of a report's folder, by what a person types; the others are always there.
FORMATS = {"pdf": "report.pdf", "docx": "report.docx", "tex": "report.tex", "html": "report.html", "md": "report.md"}
ON_PAPER = {"pdf", "docx", "tex"}
#: What a title page may hold, in its order.
KEYS = ("university", "faculty", "department", "course", "student", "group", "variant", "teacher", "city", "date")
LABELS = {"student": "Student", "group": "Group", "variant": "Variant", "teacher": "Teacher"}

_HEADING = re.compile(r'^(#+ .*?)<a id="([^"]+)"></a>$', re.MULTILINE)
_ANCHOR = re.compile(r'<a id="([^"]+)"></a>')
_PICTURE = re.compile(r"^!\[(.*)\]\((.+?)\)$", re.MULTILINE)
_COPY = re.compile(r"^\[!\[.*?\]\(.*?\)\]\(#.*?\)\n+.*?\n\n", re.MULTILINE)
_WAYS = re.compile(r"^(?:\[[^\]]*\]\(\.\./[^)]*\)(?: · )?)+\n\n", re.MULTILINE)
_FOLD = re.compile(r"^<details><summary>(.*)</summary>$", re.MULTILINE)
_TAG = re.compile(r"\\tag\{(\d+)\}")
#: Places of an index, whose links are the numbers of their pages on paper; Word has no words for that.
_PAGE = re.compile(r"\[[^\]]*\]\(#(index-[^)]+)\)")
_PAGES = {"pdf": r"`#link(<\1>)[#context str(counter(page).at(<\1>).first())]`{=typst}", "tex": r"`\\pageref{\1}`{=latex}"}
#: In words, what LaTeX's fonts have in equations only.
_SIGNS = {
    "✓": r"\checkmark", "∎": r"\blacksquare", "→": r"\to", "≤": r"\le", "≥": r"\ge", "∞": r"\infty", "√": r"\surd", "≈": r"\approx",
}  # fmt: skip


def title_page(path: Path) -> dict[str, str]:
    """What a title page says, from a TOML file.

    Raises
    ------
    ValueError
        The file is no TOML, or has a key that a title page has not.
    """
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        msg = f"--title-page {path}: expected a TOML file, received {error}"
        raise ValueError(msg) from None
    if unknown := [key for key in found if key not in KEYS]:
        msg = f"--title-page {path}: expected keys among {', '.join(KEYS)}, received {', '.join(unknown)}"
        raise ValueError(msg)
    return {key: str(found[key]) for key in KEYS if key in found}


def programs() -> tuple[Any, Any]:
    """Pandoc and typst.

    Raises
    ------
    ValueError
        One of them is missing; the message says how to get it.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import pypandoc
            import typst
    except ImportError as error:
        msg = f"--format: expected the programs of the extra print (pip install 'ctlabs[print]'), received none of {error.name}"
        raise ValueError(msg) from None
    return pypandoc, typst


def make(folder: Path, formats: tuple[str, ...], title: Mapping[str, str]) -> list[Path]:
    """Put further files beside a report that was written to ``folder``; returns all that were asked for."""
    text = without_links((folder / "report.md").read_text(encoding="utf-8"))
    head, body = text.split("\n", 1)
    for kind in formats:
        if kind in ON_PAPER:
            convert(body, kind, folder / FORMATS[kind], head.removeprefix("# "), title)
    return [folder / FORMATS[kind] for kind in formats]


def without_links(report: str) -> str:
    """A report without the ways to its neighbours, and without the small copy of a figure."""
    return _WAYS.sub("", _COPY.sub("", report))


def convert(body: str, kind: str, path: Path, heading: str, title: Mapping[str, str], *, contents: bool = False) -> None:
    """Markdown of a report as a file on paper; its pictures lie beside ``path``."""
    pandoc, typst = programs()
    source = _for_pandoc(body, kind)
    if kind == "pdf":
        made = pandoc.convert_text(source, "typst", format=_READ, extra_args=["--wrap=none", "--columns=9999"])
        lines = [(TEMPLATES / "paper.typ").read_text(encoding="utf-8"), _call(heading, title, contents), made]
        draft = path.with_suffix(".typ")
        draft.write_text("\n".join(lines), encoding="utf-8")
        try:
            typst.compile(str(draft), output=str(path), root=str(path.parent))
        finally:
            draft.unlink()
        return
    options = ["--standalone", "--wrap=none", f"--resource-path={path.parent}", *(["--toc", "--toc-depth=2"] if contents else [])]
    if kind == "tex":
        source = _latex_title(heading, title) + source
        options += [f"--include-in-header={TEMPLATES / 'paper.tex'}"]
        options += [f"--variable={each}" for each in ("papersize=a4", "geometry:margin=24mm", "colorlinks=true")]
    else:
        source = _word_title(heading, title) + source
    pandoc.convert_text(source, {"tex": "latex"}.get(kind, kind), format=_READ, outputfile=str(path), extra_args=options)


#: Markdown as pandoc reads it here.
_READ = "markdown-implicit_figures-yaml_metadata_block+raw_attribute+pipe_tables+link_attributes"
_BLOCK = re.compile(r"(```.*?```|\$\$.*?\$\$|\$[^$\n]+\$|`[^`\n]+`)", re.DOTALL)


def _for_pandoc(text: str, kind: str) -> str:
    """A repository's Markdown as pandoc reads it: places, folded parts, numbers of equations, widths of pictures."""
    text = _FOLD.sub(r"### \1", text).replace("</details>", "")
    text = _HEADING.sub(r"\1 {#\2}", text)
    text = _ANCHOR.sub(r"`#metadata(none) <\1>`{=typst}" if kind == "pdf" else r"[]{#\1}", text)
    text = _PICTURE.sub(r"![\1](\2){width=92%}", text)
    text = _PAGE.sub(_PAGES.get(kind, r"\g<0>"), text)
    if kind == "pdf":
        text = text.replace(r"\;", r"\ ")  # a thick space, which pandoc's typst has not
    if kind != "tex":
        return _TAG.sub(r"\\qquad (\1)", text)
    pieces = _BLOCK.split(text)
    return "".join(piece if i % 2 else _in_latex(piece) for i, piece in enumerate(pieces))


def _in_latex(words: str) -> str:
    """Words whose letters LaTeX's fonts have: Greek ones and signs as equations."""
    words = re.sub("([A-Za-zΦΨ])\u0304", r"$\\bar \1$", words)
    words = re.sub("([A-Za-z])\u0302|x̂", lambda m: rf"$\hat {m[1] or 'x'}$", words)
    words = re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻]+", lambda m: f"^{m[0].translate(LOWERED)}^", words)
    return "".join(f"${_SIGNS[c]}$" if c in _SIGNS else _greek(c) for c in words).replace("−", "-")


def _greek(letter: str) -> str:
    r"""A Greek letter as an equation; any other as it is.

    >>> _greek("λ"), _greek("Φ"), _greek("x")
    ('$\\lambda$', '$\\Phi$', 'x')
    """
    words = unicodedata.name(letter, "").replace("LAMDA", "LAMBDA").split()
    if len(words) != 4 or words[0] != "GREEK" or words[2] != "LETTER":
        return letter
    name = words[3].capitalize() if words[1] == "CAPITAL" else words[3].lower()
    return rf"$\{name}$" if name in GREEK else letter


def _call(heading: str, title: Mapping[str, str], contents: bool) -> str:
    """The line of typst that sets the title."""
    entries = ", ".join(f"{key}: {_quoted(value)}" for key, value in title.items())
    dictionary = f"({entries},)" if entries else "(:)"
    return f"#show: paper.with(title: {_quoted(heading)}, page_title: {dictionary}, contents: {str(contents).lower()})\n"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _latex_title(heading: str, title: Mapping[str, str]) -> str:
    """A title page as LaTeX that pandoc passes on."""
    lines = [_escaped(title[key]) for key in ("university", "faculty", "department") if key in title]
    facts = [rf"{LABELS[key]}: {_escaped(title[key])}" for key in LABELS if key in title]
    foot = ", ".join(_escaped(title[key]) for key in ("city", "date") if key in title)
    middle = [rf"{_escaped(title['course'])}\\[4ex]" if "course" in title else "", rf"{{\LARGE\bfseries {_escaped(heading)}\par}}"]
    page = "\n".join([
        r"\begin{titlepage}\centering", r"\\ ".join(lines) + r"\vspace*{\stretch{1}}\par" if lines else r"\vspace*{\stretch{1}}", *middle,
        r"\vspace*{\stretch{1}}\par\raggedleft " + r"\\ ".join(facts), r"\vspace*{\stretch{1}}\par\centering " + foot, r"\end{titlepage}",
    ])  # fmt: skip
    if not title:
        page = rf"\begin{{center}}{{\LARGE\bfseries {_escaped(heading)}\par}}\end{{center}}"
    return f"```{{=latex}}\n{page}\n```\n\n"


def _escaped(text: str) -> str:
    return re.sub(r"([#$%&_{}])", r"\\\1", text.replace("\\", r"\textbackslash "))


def _word_title(heading: str, title: Mapping[str, str]) -> str:
    """A title page in plain paragraphs, ended by a new page."""
    words = {key: re.sub(r"([^\w\s])", r"\\\1", value) for key, value in title.items()}
    named = [f"{LABELS[key]}: {words[key]}" if key in LABELS else words[key] for key in KEYS if key in words]
    if not named:
        return f"# {heading}\n\n"
    end = '```{=openxml}\n<w:p><w:r><w:br w:type="page"/></w:r></w:p>\n```\n\n'
    return "\n\n".join([f"# {heading}", *named, end])
