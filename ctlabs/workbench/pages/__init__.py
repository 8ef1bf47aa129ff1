"""The pages: thin views of a session. ``shell`` draws the frame; the others each have one function ``page(session, shell)``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.session import Session

#: Style sheets and scripts, which are in the head of every page.
STATIC = Path(__file__).parent.parent / "static"


def over(session: Session, shell: Shell) -> None:
    """What stays over every page: the guided first experiment, if it was shown before."""
    from ctlabs.workbench.pages.help import resume_tour  # not before a page is drawn: the frame comes first

    resume_tour(session, shell)
