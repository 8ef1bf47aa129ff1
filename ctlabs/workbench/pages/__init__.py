"""The pages: thin views of a session. ``shell`` draws the frame.

A page is a module of this folder with a literal ``PAGE = {"place": …, "title": …, "icon": …}`` (and the ``"letter"`` of its
shortcut, where that is not its first) and one function ``page(session, shell)``; it is found by listing the folder, and imported when
it is first shown. Its looks lie in ``static``, its help in ``ctlabs/workbench/help``.
"""

from __future__ import annotations

import ast
import importlib.util
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

#: Style sheets and scripts, which are in the head of every page.
STATIC = Path(__file__).parent.parent / "static"


class Page(NamedTuple):
    """A page's module and address, its title, its icon."""

    name: str
    title: str
    icon: str
    letter: str = ""

    @property
    def keys(self) -> str:
        """Its shortcut: Alt+Shift and its letter, the first of its name where it has none of its own."""
        return f"alt+shift+{self.letter or self.name[0]}"


@cache
def listed(package: str = __name__) -> tuple[Page, ...]:
    """The pages of a package in their order; none is imported, since they need numpy and the frame does not.

    >>> [page.name for page in listed()]
    ['model', 'understand', 'experiment', 'data', 'fit', 'control', 'keep', 'labs', 'course', 'help']
    """
    spec, found = importlib.util.find_spec(package), []
    for path in Path(spec.origin).parent.glob("*.py") if spec is not None and spec.origin else ():
        literal = re.search(r"^PAGE = (\{.*\})$", path.read_text(encoding="utf-8"), re.MULTILINE)
        if literal is not None:
            told = ast.literal_eval(literal[1])
            found.append((told["place"], Page(path.stem, told["title"], told["icon"], told.get("letter", ""))))
    return tuple(page for _, page in sorted(found))


def over(session: Session, shell: Shell) -> None:
    """What stays over every page: the guided first experiment, if it was shown before; where tables may be dropped."""
    from ctlabs.workbench.pages.dropping import accept_anywhere  # not before a page is drawn: the frame comes first
    from ctlabs.workbench.pages.help import resume_tour

    resume_tour(session, shell)
    accept_anywhere(session, shell)
