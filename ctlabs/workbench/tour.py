"""The guided first experiment: steps that tick themselves off as they are done, wherever in the workbench.

What has been done is read from the session (its history, its plan, its result) and noted with the draft, so that it stays
done after a reload. Nothing here needs a page.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from ctlabs.workbench.commands import Open

if TYPE_CHECKING:
    from ctlabs.workbench.outcomes import Outcome
    from ctlabs.workbench.session import Session

#: The model of the tour, from the gallery.
MODEL = "constant_velocity"


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the tour: where it is done (the page's name), what is done, and what to look at then."""

    name: str
    title: str
    page: str
    what: str
    look: str


STEPS = (
    Step(
        "open",
        "Open a ready model",
        "model",
        "On the page Model choose Open, and of the ready models “Constant velocity” (any other will do).",
        "The equations beside the cells have the numbers in; the page Understand says what a filter can do with it.",
    ),
    Step(
        "change",
        "Change a number",
        "model",
        "Move the slider of a constant, or type into a cell: a number, or an expression such as 2*pi.",
        "A mistake is told at the cell. Ctrl+Z takes back whatever you did.",
    ),
    Step(
        "run",
        "Run an experiment",
        "experiment",
        "On the page Experiment press Run: a thousand noisy runs of your model, each filtered.",
        "The errors of all runs should lie on the line that theory draws.",
    ),
    Step(
        "compare",
        "Compare algorithms",
        "experiment",
        "Choose a second algorithm beside the first, say “conventional”, and run again.",
        "The table says how many digits each loses, and how long it takes.",
    ),
    Step(
        "export",
        "Export the report",
        "keep",
        "On the page Keep choose the experiment and export it as a report (HTML).",
        "One file with equations, figures and numbers, and the lines of Python that reproduce it.",
    ),
)


class Seen(NamedTuple):
    """A step, and whether it is done."""

    step: Step
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
        new = {step.name for step in STEPS if step.name not in self._done and _DONE[step.name](self)}
        if new:
            self._done |= new
            self._save()
        return tuple(Seen(step, step.name in self._done) for step in STEPS)

    @property
    def next(self) -> Step | None:
        """The first step that is not done; ``None`` when all are."""
        return next((step for step, done in self.look() if not done), None)

    def mark(self, name: str) -> None:
        """Say that a step is done that the session does not tell of (an export)."""
        if name not in _DONE:
            msg = f"tour: expected one of {', '.join(_DONE)}, received {name!r}"
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

    # What is looked at -------------------------------------------------------------------------------------------------

    def _labels(self) -> list[str]:
        """What was done to the model since the tour began, in order."""
        return [step.label for step in self.session.history if step.number > self._since]

    def _opened(self) -> bool:
        return any(label.startswith("open ") for label in self._labels())

    def _changed(self) -> bool:
        labels = self._labels()
        begun = next((i for i, label in enumerate(labels) if label.startswith("open ")), None)
        return begun is not None and any(not label.startswith(("open ", "new ")) for label in labels[begun + 1 :])

    def _ran(self) -> bool:
        return self._result() is not None

    def _compared(self) -> bool:
        found = self._result()
        return found is not None and len(found.algorithms) > 1

    def _result(self) -> Outcome | None:
        return None if self.session.result_id == self._before else self.session.result

    def _told(self) -> bool:
        return False  # only :meth:`mark` says so


_DONE: dict[str, Callable[[Tour], bool]] = {
    "open": Tour._opened,
    "change": Tour._changed,
    "run": Tour._ran,
    "compare": Tour._compared,
    "export": Tour._told,
}


def begin(session: Session) -> None:
    """Do the first step for somebody who wants to begin at once: the tour's model on the desk."""
    from ctlabs.files.modelfile import ready

    session.do(Open(ready(MODEL).dumps(), f"{MODEL}.toml"))


def mark(session: Session, name: str) -> None:
    """:meth:`Tour.mark` for a page that has no tour at hand."""
    Tour(session).mark(name)
