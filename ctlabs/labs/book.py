"""All labs as one document: a chapter for each topic, one bibliography, an index, the listings; the checks stay in the reports.

The reports are read as they were written. Each lab's places get its name before theirs, and its references the numbers of the book.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from ctlabs.labs import printing
from ctlabs.labs.catalogue import catalogue
from ctlabs.labs.course import course
from ctlabs.labs.sheets import bibliography
from ctlabs.labs.terms import index, marked
from ctlabs.text import _, translated

TITLE = "Optimal filtering: worked labs"
_CITED = re.compile(r"\[\\\[\d+((?:, [^\]\\]+)?)\\\]\]\(#ref-(\w+)\)")
_LINK = re.compile(r"\]\(#(?!ref-)([^)]+)\)")
_TO_TABLES = re.compile(r"\[([^\]]+)\]\(#(?:app-\w+|sec-appendix)\)")
_REFERENCES = re.compile(r'^## References<a id="sec-references"></a>\n.*?(?=^## )', re.MULTILINE | re.DOTALL)
_APPENDIX = re.compile(r'^## Appendix<a id="sec-appendix"></a>\n.*\Z', re.MULTILINE | re.DOTALL)
_LISTING = re.compile(r"^```python\n.*?^```$", re.MULTILINE | re.DOTALL)


def missing(out: Path) -> list[str]:
    """The labs without a report in ``out``."""
    return [name for name in catalogue() if not (out / name / "report.md").is_file()]


def text(out: Path) -> str:
    """The book in Markdown; its pictures lie below ``out``."""
    cited: list[str] = []
    chapters, bodies = [], {}
    for topic in course().topics:
        chapters += [f"# {translated(topic.name)}", translated(topic.about)]
        for name in topic.labs:
            report = (out / name / "report.md").read_text(encoding="utf-8")
            bodies[name] = marked(name, _chapter(name, report, cited))
            chapters.append(bodies[name])
    books = [f'{i}. <a id="ref-{key}"></a>{bibliography()[key]}' for i, key in enumerate(cited, 1)]
    about = _("Each term with the places where a lab first speaks of it.")
    parts = [*chapters, f"# {_('Bibliography')}", "\n".join(books), f"# {_('Index')}", about, index(bodies)]
    return "\n\n".join(parts) + "\n"


def _chapter(name: str, report: str, cited: list[str]) -> str:
    """A report as a section of the book."""
    title, body = printing.without_links(report).split("\n", 1)
    appendix = _APPENDIX.search(body)
    listing = _LISTING.search(appendix[0]) if appendix else None
    body = _REFERENCES.sub("", _APPENDIX.sub("", body))

    def number(match: re.Match[str]) -> str:
        if match[2] not in cited:
            cited.append(match[2])
        return rf"[\[{cited.index(match[2]) + 1}{match[1]}\]](#ref-{match[2]})"

    body = _CITED.sub(number, _TO_TABLES.sub(r"\1", body))
    body = _LINK.sub(rf"](#{name}-\1)", body)
    body = re.sub(r'<a id="([^"]+)"></a>', rf'<a id="{name}-\1"></a>', body)
    body = re.sub(r"\]\((figures/)", rf"]({name}/\1", body)
    body = re.sub(r"^(##+) ", r"#\1 ", body, flags=re.MULTILINE)
    short = catalogue()[name].short
    lines = [f"## {short + '. ' if short.isdigit() else ''}{title.removeprefix('# ')}", body.strip()]
    return "\n\n".join(lines + ([f"### {_('Listing')}", listing[0]] if listing else []))


def write(out: Path, kind: str, title: Mapping[str, str]) -> Path:
    """The book as a file ``book.pdf``, ``book.docx``, ``book.tex`` or ``book.md`` in ``out``."""
    path = out / f"book.{kind}"
    if kind == "md":
        path.write_text(f"# {_(TITLE)}\n\n{text(out)}", encoding="utf-8")
    else:
        printing.convert(text(out), kind, path, _(TITLE), title, contents=True)
    return path
