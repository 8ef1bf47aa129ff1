"""Help: the guided first experiment, what every field and figure is, the algorithms side by side, the keys."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.workbench import help as texts
from ctlabs.workbench import tour
from ctlabs.workbench.help import GROUPS, Help
from ctlabs.workbench.help_texts import ABILITIES

if TYPE_CHECKING:
    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.session import Session

#: How often the tour looks at what has been done, in seconds.
LOOK = 0.7
#: The pages' titles, for buttons that lead there.
TITLES = {"model": "Model", "understand": "Understand", "experiment": "Experiment", "keep": "Keep", "labs": "Labs"}

_STYLE = """
.help-page { width: 100%; max-width: 64rem; display: flex; flex-direction: column; gap: 1rem; }
.help-page h2 { font-size: 1.35rem; line-height: 1.3; font-weight: 600; margin: .75rem 0 0; scroll-margin-top: 4rem; }
.help-page h3 { font-size: 1.05rem; line-height: 1.35; font-weight: 600; margin: 0; }
.help-page p { margin: 0 0 .4rem; max-width: 50rem; line-height: 1.5; }
.help-steps { list-style: none; margin: 0; padding: 0; display: flex; flex-direction: column; gap: .5rem; }
.help-step { display: grid; grid-template-columns: 2rem 1fr auto; gap: .6rem; align-items: start; padding: .6rem; border-radius: 8px;
  border: 1px solid color-mix(in srgb, currentColor 22%, transparent); }
.help-step[data-state=next] { border: 2px solid var(--q-primary); }
.help-mark { width: 1.8rem; height: 1.8rem; border-radius: 50%; display: grid; place-items: center; font-weight: 600;
  border: 2px solid currentColor; }
.help-step[data-state=done] .help-mark, .tour-card .help-mark[data-done=true] { background: #00664a; border-color: #00664a; color: #fff; }
.help-look { opacity: .8; font-size: .9rem; }
.help-page nav a { color: var(--q-primary) !important; }
.help-entry { padding: .6rem 0; border-top: 1px solid color-mix(in srgb, currentColor 18%, transparent); min-width: 0; }
.help-entry math[display=block] { overflow-x: auto; overflow-y: hidden; display: block; margin: .5rem 0; text-align: left; }
.help-entry dl { display: grid; grid-template-columns: 5.5rem minmax(0, 1fr); gap: .15rem .5rem; margin: .25rem 0 0; font-size: .92rem; }
.help-entry dt { opacity: .75; }
.help-entry dd { margin: 0; overflow-wrap: anywhere; }
.help-keys { display: grid; grid-template-columns: max-content 1fr; gap: .35rem 1rem; align-items: center; }
.help-scroll { overflow-x: auto; max-width: 100%; }
.help-scroll table { border-collapse: collapse; font-size: .9rem; }
.help-scroll th, .help-scroll td { padding: .3rem .8rem .3rem 0; text-align: left; white-space: nowrap; vertical-align: top; }
.help-scroll tbody th { font-weight: normal; }
.help-scroll tbody tr { border-top: 1px solid color-mix(in srgb, currentColor 18%, transparent); }
@media (max-width: 599px) { .help-step { grid-template-columns: 2rem 1fr; } .help-step > :nth-child(3) { grid-column: 2; } }
"""

_TOUR_STYLE = """
.tour-card { position: fixed; right: 1rem; bottom: 1rem; z-index: 1500; width: 21rem; max-width: calc(100vw - 1rem); padding: .8rem;
  border: 2px solid var(--q-primary); border-radius: 10px; background: #fff; color: #1c1e21;
  box-shadow: 0 6px 24px rgba(0, 0, 0, .3); display: flex; flex-direction: column; gap: .4rem; }
body.body--dark .tour-card { background: #24272b; color: #e6e7e9; }
.tour-marks { display: flex; gap: .35rem; }
.tour-card .help-mark { width: 1.5rem; height: 1.5rem; border-radius: 50%; display: grid; place-items: center; font-size: .8rem;
  font-weight: 600; border: 2px solid currentColor; }
.tour-card .help-mark[data-done=true] { background: #00664a; border-color: #00664a; color: #fff; }
.tour-card .help-mark[data-next=true] { outline: 3px solid color-mix(in srgb, var(--q-primary) 60%, transparent); }
html:has(.tour-card) { scroll-padding-bottom: 15rem; }
body:has(.tour-card) .ctl-main { padding-bottom: 14rem; }
@media (max-width: 899px) { .tour-card { right: .5rem; bottom: .5rem; left: .5rem; width: auto; padding: .55rem; } }
"""


def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    ui.html(f"<style>{_STYLE}</style>", sanitize=False).classes("hidden")
    with ui.element("div").classes("help-page"):
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
        self.list = ui.element("ol").classes("help-steps")
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
                with ui.element("li").classes("help-step").props(f"data-state={state} data-step={step.name}"):
                    _mark(number, done)
                    with ui.element("div"):
                        ui.html(f"<h3>{escape(step.title)}</h3>", sanitize=False)
                        ui.label(step.what)
                        ui.label(step.look).classes("help-look")
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
        self.card = ui.element("aside").classes("tour-card").props('aria-label="Your first experiment"')
        with self.card:
            ui.html(f"<style>{_TOUR_STYLE}</style>", sanitize=False).classes("hidden")
            with ui.row().classes("items-center w-full no-wrap gap-2"):
                self.marks = ui.element("div").classes("tour-marks")
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
            self.title.text, self.what.text = "All done", "That was a whole experiment. The labs have 26 more."
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
    with ui.element("span").classes("help-mark").props(f"data-done={'true' if done else 'false'}") as mark:
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
        self.count = ui.label().props("role=status aria-live=polite").classes("help-look")
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
                with ui.expansion(f"{GROUPS[group]} ({len(entries)})", value=bool(words.strip())).classes("w-full"):
                    ui.html("".join(map(_entry, entries)), sanitize=False).classes("w-full")


def _entry(entry: Help) -> str:
    return f'<div class="help-entry" data-key="{escape(entry.key)}"><h3>{escape(entry.title)}</h3>{entry.html}</div>'


def _algorithms() -> None:
    _title("algorithms", "Which algorithm?")
    ui.html(
        "<p>All are the same filter in exact arithmetic. Joseph's form is the one to begin with; a form with square roots or "
        "factors where numbers differ by many powers of ten; one of information where nothing is known at the beginning.</p>",
        sanitize=False,
    )
    heads = (
        "form",
        "R = 0",
        "singular P0",
        "singular Φ",
        "nothing known at t0",
        "gaps, varying",
        "operations per step",
    )
    rows = []
    for name, able in ABILITIES.items():
        cells = "".join(f"<td>{_yes(each)}</td>" for each in able[:5])
        title = escape(texts.help_for(f"algorithm.{name}").title)
        rows.append(f"<tr><th scope=row>{title}<br><code>{name}</code></th>{cells}<td>{escape(able.cost)}</td></tr>")
    head = "".join(f"<th scope=col>{text}</th>" for text in heads)
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    ui.html(table, sanitize=False).classes("help-scroll").props('tabindex=0 role=region aria-label="Algorithms"')
    ui.html("<p>n states, m measurements, s = rank of Qd; leading terms.</p>", sanitize=False).classes("help-look")


def _yes(able: Any) -> str:
    return "yes" if able else '<span class="help-look">no</span>'


def _keys(shell: Shell) -> None:
    _title("keys", "Keys")
    ui.html(
        "<p>Everything can be reached with Tab and Enter. On a Mac, Ctrl is ⌘ and Alt is ⌥. Each page has keys of its own: "
        "<kbd>?</kbd> there shows them.</p>",
        sanitize=False,
    )
    with ui.element("div").classes("help-keys"):
        for keys, label in shell.shortcuts:
            ui.html(f"<kbd>{escape(keys)}</kbd>", sanitize=False)
            ui.label(label)


def _title(anchor: str, text: str) -> None:
    ui.html(f'<h2 id="{anchor}">{escape(text)}</h2>', sanitize=False)
