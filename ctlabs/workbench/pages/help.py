"""Help: the guided first experiment, what every field and figure is, the algorithms side by side, the keys."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from nicegui import ui

from ctlabs.workbench import help as texts
from ctlabs.workbench.desk import tour
from ctlabs.workbench.pages import listed

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 10, "title": "Help", "icon": "help_outline"}

#: How often the tour looks at what has been done, in seconds.
LOOK = 0.7
#: The pages' titles, for buttons that lead there.
TITLES = {page.name: page.title for page in listed()}
#: What an algorithm may be able to do, as a heading of their table.
ABLE = {
    "perfect": "R = 0",
    "singular_start": "singular P0",
    "singular_motion": "singular Φ",
    "unknown": "nothing known at t0",
    "gaps": "gaps, varying",
}




def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    with ui.element("div").classes("ctl-help-page"):
        with ui.element("nav").classes("flex gap-x-4").props('aria-label="On this page"'):
            for anchor, title in (("tour", "First experiment"), ("fields", "Fields and figures"),
                                  ("algorithms", "Algorithms"), ("keys", "Keys")):  # fmt: skip
                ui.link(title, f"#{anchor}")
        _Steps(session, shell)
        _Topics(shell)
        _algorithms()
        _keys(shell)


# The tour ----------------------------------------------------------------------------------------------------------------


class _Steps:
    """The first experiment as a list of steps."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell, self.tour = session, shell, tour.Tour(session)
        self._shown: tuple[bool, ...] | None = None
        _title("tour", "Your first experiment")
        ui.html(
            "<p>Five steps from a ready model to a report of your own. They tick themselves off as you do them.</p>",
            sanitize=False,
        )
        with ui.row().classes("gap-2"):
            ui.button("Show the steps while I work", icon="assistant", on_click=self._show).props("no-caps")
            ui.button("Begin again", icon="restart_alt", on_click=self._restart).props("flat no-caps")
        self.list = ui.element("ol").classes("ctl-help-steps")
        ui.timer(LOOK, self.look)
        self.look()

    def look(self) -> None:
        """Tick off what has been done."""
        seen = self.tour.look()
        if self._shown == tuple(done for _, done in seen):
            return
        self._shown = tuple(done for _, done in seen)
        self.list.clear()
        upcoming = self.tour.next
        with self.list:
            for number, (step, done) in enumerate(seen, 1):
                state = "done" if done else "next" if step is upcoming else "later"
                with ui.element("li").classes("ctl-help-step").props(f"data-state={state} data-step={step.name}"):
                    _mark(number, done)
                    with ui.element("div"):
                        ui.html(f"<h3>{escape(step.title)}</h3>", sanitize=False)
                        ui.label(step.what)
                        ui.label(step.look).classes("ctl-help-look")
                    ui.button(f"To {TITLES[step.page]}", on_click=lambda _, page=step.page: self._go(page)).props(
                        'outline dense no-caps padding="xs sm"'
                    )

    def _go(self, page: str) -> None:
        self._show()
        self.shell.go(page)

    def _show(self) -> None:
        self.tour.want()
        show_tour(self.session, self.shell)

    def _restart(self) -> None:
        self.tour.restart()
        self._shown = None
        self.look()


def show_tour(session: Session, shell: Shell) -> None:
    """The steps as a small card that stays while the pages change, until it is closed; one in a tab."""
    card = getattr(shell, "tour_card", None)
    if card is not None and not card.is_deleted:
        return
    with shell.client.content:
        shell.tour_card = _Card(session, shell).card  # type: ignore[attr-defined]  # the tab's, as the shell is


def resume_tour(session: Session, shell: Shell) -> None:
    """Show the steps again after a reload, if they were shown before."""
    if tour.Tour(session).wanted:
        show_tour(session, shell)


class _Card:
    """The step that is next, over every page."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell, self.tour = session, shell, tour.Tour(session)
        self._shown: tuple[bool, ...] | None = None
        self.card = ui.element("aside").classes("ctl-tour-card").props('aria-label="Your first experiment"')
        with self.card:
            with ui.row().classes("items-center w-full no-wrap gap-2"):
                self.marks = ui.element("div").classes("ctl-tour-marks")
                ui.space()
                close = ui.button(icon="close", on_click=self.close)
                close.props('flat round dense size=sm aria-label="Close the first experiment"')
            with ui.element("div").props("role=status aria-live=polite"):
                self.title = ui.label().classes("text-weight-bold")
                self.what = ui.label()
            self.button = (
                ui.button(on_click=self._go).props('dense no-caps outline padding="xs sm"').classes("self-start")
            )
            ui.timer(LOOK, self.look)
        self.look()

    def look(self) -> None:
        """Show the next step."""
        seen = self.tour.look()
        upcoming = self.tour.next
        self.button.set_visibility(upcoming is not None and upcoming.page != self.shell.current)
        if self._shown == tuple(done for _, done in seen):
            return
        previous, self._shown = self._shown, tuple(done for _, done in seen)
        self.marks.clear()
        with self.marks:
            for number, (step, done) in enumerate(seen, 1):
                _mark(number, done).props(f"data-next={'true' if step is upcoming else 'false'}")
        if upcoming is None:
            self.title.text, self.what.text = "All done", "That was a whole experiment. The labs have more of them."
            self.tour.want(False)
            return
        done_now = [step for (step, done), was in zip(seen, previous or (), strict=False) if done and not was]
        self.title.text = upcoming.title
        self.what.text = " ".join([*(step.look for step in done_now[-1:]), upcoming.what])
        self.button.text = f"To {TITLES[upcoming.page]}"

    def _go(self) -> None:
        upcoming = self.tour.next
        if upcoming is not None:
            self.shell.go(upcoming.page)

    def close(self) -> None:
        """Show it no more."""
        self.tour.want(False)
        self.card.delete()


def _mark(number: int, done: bool) -> ui.element:
    with ui.element("span").classes("ctl-help-mark").props(f"data-done={'true' if done else 'false'}") as mark:
        mark.props(f'role=img aria-label="Step {number}{": done" if done else ""}"')
        ui.label("✓" if done else str(number)).props("aria-hidden=true")
    return mark


# Fields and figures --------------------------------------------------------------------------------------------------------


class _Topics:
    """The help on everything, to be searched."""

    def __init__(self, shell: Shell) -> None:
        _title("fields", "Fields and figures")
        self.search = ui.input("Search the help", placeholder="covariance, dt, NIS …", on_change=self._list)
        self.search.props("outlined dense clearable debounce=150 type=search").classes("w-full").style(
            "max-width: 30rem"
        )
        self.count = ui.label().props("role=status aria-live=polite").classes("ctl-help-look")
        self.list = ui.element("div").classes("w-full")
        shell.shortcut("/", "Search the help", lambda: self.search.run_method("focus"))
        self._list()

    def _list(self) -> None:
        words = self.search.value or ""
        found = texts.topics(words)
        self.list.clear()
        many = sum(map(len, found.values()))
        self.count.text = (f"{many} found" if many else "Nothing has all these words.") if words.strip() else ""
        with self.list:
            for group, entries in found.items():
                with ui.expansion(f"{texts.groups()[group].heading} ({len(entries)})", value=bool(words.strip())).classes("w-full"):
                    ui.html("".join(map(_entry, entries)), sanitize=False).classes("w-full")


def _entry(entry: texts.Help) -> str:
    return f'<div class="ctl-help-entry" data-key="{escape(entry.key)}"><h3>{escape(entry.title)}</h3>{entry.html}</div>'


def _algorithms() -> None:
    _title("algorithms", "Which algorithm?")
    ui.html(
        "<p>All are the same filter in exact arithmetic. Joseph's form is the one to begin with; a form with square roots or "
        "factors where numbers differ by many powers of ten; one of information where nothing is known at the beginning.</p>",
        sanitize=False,
    )
    heads, rows = ("form", *ABLE.values(), "operations per step"), []
    for each in texts.groups()["algorithm"].entries.values():
        cells = "".join(f"<td>{_yes(what in each.able)}</td>" for what in ABLE)
        form = f"{escape(each.title)}<br><code>{each.key.partition('.')[2]}</code>"
        rows.append(f"<tr><th scope=row>{form}</th>{cells}<td>{escape(each.cost)}</td></tr>")
    head = "".join(f"<th scope=col>{text}</th>" for text in heads)
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    ui.html(table, sanitize=False).classes("ctl-help-scroll").props('tabindex=0 role=region aria-label="Algorithms"')
    ui.html("<p>n states, m measurements, s = rank of Qd; leading terms.</p>", sanitize=False).classes("ctl-help-look")


def _yes(able: bool) -> str:
    return "yes" if able else '<span class="ctl-help-look">no</span>'


def _keys(shell: Shell) -> None:
    _title("keys", "Keys")
    ui.html(
        "<p>Everything can be reached with Tab and Enter. On a Mac, Ctrl is ⌘ and Alt is ⌥. Each page has keys of its own: "
        "<kbd>?</kbd> there shows them.</p>",
        sanitize=False,
    )
    with ui.element("div").classes("ctl-help-keys"):
        for keys, label in shell.shortcuts:
            ui.html(f"<kbd>{escape(keys)}</kbd>", sanitize=False)
            ui.label(label)


def _title(anchor: str, text: str) -> None:
    ui.html(f'<h2 id="{anchor}">{escape(text)}</h2>', sanitize=False)
