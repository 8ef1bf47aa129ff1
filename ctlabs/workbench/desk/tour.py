"""The guided first experiment: steps that tick themselves off as they are done, wherever in the workbench.

What has been done is read from the session (its history, its plan, its result) and noted with the draft, so that it stays
done after a reload. Nothing here needs a page.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from ctlabs.workbench.desk.commands import Open
from ctlabs.workbench.help import read

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session

@dataclass(frozen=True, slots=True)
class TourStep:
    """A step of the tour: where it is done (the page's name), what is done, and what to look at then."""

    name: str
    title: str
    page: str
    what: str
    look: str


_TEXTS = read("tour")
#: The model of the tour, from the gallery.
MODEL: str = _TEXTS["model"]
STEPS = tuple(TourStep(name, **told) for name, told in _TEXTS.items() if isinstance(told, dict))


class Seen(NamedTuple):
    """A step, and whether it is done."""

    step: TourStep
    done: bool


class Tour:
    """The tour of one session's draft.

    >>> [step.name for step in STEPS]
    ['open', 'change', 'run', 'compare', 'export']
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self._read()

    def _read(self) -> None:
        """What is noted with the draft; another tab, or a page that has no tour at hand, may have noted more."""
        found = self.session.store.draft(self.session.draft.id)
        told: Mapping[str, Any] = (found.notes if found else {}).get("tour", {})
        names = {step.name for step in STEPS}
        self._done = {str(name) for name in told.get("done", ())} & names
        self._since: int = told.get("since", 0)
        self._before: int | None = told.get("before")  # the result that was there when the tour began
        #: Whether the person wants to see it.
        self.wanted = bool(told.get("wanted", False))

    def look(self) -> tuple[Seen, ...]:
        """All steps, with what has been done by now."""
        self._read()
        if new := self._seen() - self._done:
            self._done |= new
            self._save()
        return tuple(Seen(step, step.name in self._done) for step in STEPS)

    @property
    def next(self) -> TourStep | None:
        """The first step that is not done; ``None`` when all are."""
        return next((step for step, done in self.look() if not done), None)

    def mark(self, name: str) -> None:
        """Say that a step is done that the session does not tell of (an export)."""
        names = [step.name for step in STEPS]
        if name not in names:
            msg = f"tour: expected one of {', '.join(names)}, received {name!r}"
            raise ValueError(msg)
        self._read()
        if name not in self._done:
            self._done.add(name)
            self._save()

    def want(self, wanted: bool = True) -> None:
        """Show the tour from now on, or no more."""
        self._read()
        self.wanted = wanted
        self._save()

    def restart(self) -> None:
        """Begin again: only what is done from now on counts."""
        self._done.clear()
        history = [step for step in self.session.history if step.done]
        self._since = history[-1].number if history else 0
        self.wanted = True
        self._before = self.session.result_id
        self._save()

    def _save(self) -> None:
        done = [step.name for step in STEPS if step.name in self._done]
        note = {"done": done, "since": self._since, "before": self._before, "wanted": self.wanted}
        self.session.store.note(self.session.draft.id, tour=note)

    def _seen(self) -> set[str]:
        """The steps that the session tells of: what was done to the model since the tour began, and what was run."""
        begins = [step.begins for step in self.session.history if step.number > self._since]
        found = {"open", *(("change",) if "" in begins[begins.index("open") :] else ())} if "open" in begins else set()
        result = None if self.session.result_id == self._before else self.session.result
        if result is not None:
            found |= {"run", "compare"} if len(result.algorithms) > 1 else {"run"}
        return found


def begin(session: Session) -> None:
    """Do the first step for somebody who wants to begin at once: the tour's model on the desk."""
    from ctlabs.files.modelfile import ready

    session.do(Open(ready(MODEL).dumps(), f"{MODEL}.toml"))


def mark(session: Session, name: str) -> None:
    """:meth:`Tour.mark` for a page that has no tour at hand."""
    Tour(session).mark(name)
