"""The frame of every page: header, the list of pages, a place for the content, the state of saving, keys, light and dark.

A page is a module of this package with one function ``page(session, shell)`` that draws into the place it is called in;
the package's own function ``over(session, shell)`` draws what stays over every page. A page may use

- ``shell.saving()``, ``shell.saved()``, ``shell.not_saved(line)``: what stands beside the title; ``saved`` also lets
  other tabs with the same draft show what has changed
- ``shell.tell(line)``, ``shell.complain(line)``: a message that goes away, a message that stays
- ``shell.shortcut("mod+z", "Undo", undo)``: a key while the page is shown (``mod`` is Ctrl, or Cmd on a Mac)
- ``shell.on_change(show)``: what to do when another tab has edited the draft; otherwise the page is drawn again, as soon as
  nobody types there
- ``shell.go("experiment")``, ``shell.refresh()``, ``shell.on_leave(stop)``, ``shell.name_draft("Tracking")``
- ``shell.desk.store``, ``shell.desk.runner``, ``shell.owner``, ``shell.browser``: where things are kept and run, for whom
- ``shell.query``: what the address asked for beside the draft

An exception that leaves a handler of the page is shown in one line and its traceback goes to the log.
"""

from __future__ import annotations

import asyncio
import importlib
import json
import logging
from collections.abc import Callable
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from nicegui import app, ui

from ctlabs.reporting import mathfont, mathml
from ctlabs.workbench.desk.links import packed
from ctlabs.workbench.pages import STATIC, Page, listed
from ctlabs.workbench.pages.dialogs import dialog

if TYPE_CHECKING:
    from nicegui import Client
    from starlette.requests import Request

    from ctlabs.workbench.desk.desk import Desk, Seat

log = logging.getLogger("ctlabs.workbench")


THEMES = {"auto": (None, "brightness_auto"), "light": (False, "light_mode"), "dark": (True, "dark_mode")}
#: Below this width, in pixels, the list of pages is behind a button.
NARROW = 900
#: How long another tab waits before it shows what has changed here, in seconds.
CALM = 0.4

FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="6" fill="#1f5fa8"/>'
    '<path d="M4 22 C9 4 12 26 17 14 S25 16 28 15" fill="none" stroke="#fff" stroke-width="2.6"/>'
    '<path d="M4 8 C10 14 16 15 28 15" fill="none" stroke="#ffd166" stroke-width="2"/></svg>'
)






#: Where the font of equations is: the one that reports have parts of.
MATH = "/math.ttf"


class _Shortcut(NamedTuple):
    label: str
    action: Callable[[], object]
    in_fields: bool
    lasting: bool


def prepare() -> None:
    """What all pages have in their head."""
    app.colors(primary="#1f5fa8")
    styles = [path.read_text(encoding="utf-8") for path in sorted(STATIC.glob("*.css"))]
    if not any(getattr(route, "path", "") == MATH for route in app.routes):
        app.add_static_file(local_file=mathfont.FONT, url_path=MATH)
    ui.add_css("\n".join([mathfont.style(MATH), mathml.STYLE, *styles]), shared=True)
    ui.add_head_html(f"<script>{(STATIC / 'shell.js').read_text(encoding='utf-8')}</script>", shared=True)


class Shell:
    """The frame in one tab."""

    def __init__(self, desk: Desk, client: Client, request: Request, pages: str) -> None:
        self.desk, self.client, self._package, self._pages = desk, client, pages, listed(pages)
        self.browser: str = request.scope["ctlabs.session"]
        #: What the address asked for beside the draft, until a page has taken it.
        self.query = {key: value for key, value in request.query_params.items() if key != "draft"}
        theme = request.cookies.get("ctlabs_theme", "auto")
        self.theme = theme if theme in THEMES else "auto"
        self.current = self._pages[0].name
        self._place: Seat | None = None
        self._keys: dict[str, _Shortcut] = {}
        self._leaving: list[Callable[[], object]] = []
        self._links: dict[str, ui.element] = {}
        self._take_up: Callable[[], object] | None = None
        self._asked = ""  # the page whose link was followed before the draft was open
        self._pending: asyncio.TimerHandle | None = None

    @property
    def owner(self) -> str:
        """Whose experiments are listed: this person's on a machine of one's own, this browser's elsewhere."""
        return self.desk.owner(self.browser)

    @property
    def place(self) -> Seat:
        """The draft and its session."""
        if self._place is None:
            msg = "shell: expected a draft that is open, received none"
            raise RuntimeError(msg)
        return self._place

    # Drawing -------------------------------------------------------------------------------------------------------------

    def draw(self, name: str) -> None:
        """The frame, with nothing in it yet: this is what the browser shows first."""
        self.current = name
        self._dark = ui.dark_mode(THEMES[self.theme][0])
        # The browser itself shows the drawer where there is room; asked for it, a busy one would answer too late.
        self._drawer = ui.left_drawer(value=False, bordered=True).props(f"show-if-above breakpoint={NARROW} width=190")
        with self._drawer, ui.element("nav").classes("ctl-nav").props('aria-label="Pages"'):
            self._links = {page.name: self._link(page) for page in self._pages}
        self._draw_header()
        self._main = ui.element("div").classes("ctl-main").props("tabindex=-1 aria-busy=true")
        with self._main, ui.row().classes("items-center q-pa-md"):
            ui.spinner(size="md")
            ui.label("Opening the workbench…")
        ui.skip_link("Skip to the page", target=self._main)
        self.client.on_exception(self._failed)
        ui.on("ctlabs_key", lambda event: self._pressed(event.args))
        ui.on("ctlabs_went", lambda event: self._went(str(event.args)))
        ui.on("ctlabs_rests", self._rests)
        self._mark()

    def _draw_header(self) -> None:
        with ui.header(elevated=True, wrap=False).classes("ctl-head"):
            menu = ui.button(icon="menu", on_click=self._drawer.toggle)
            menu.props('flat round dense color=white aria-label="List of pages"').classes("ctl-narrow")
            with ui.element("a").classes("ctl-title ctl-wide").props(f'href="/{self._pages[0].name}"') as self._title:
                ui.label("ctlabs workbench")
            self._follow(self._title, self._pages[0].name)
            self._name = ui.label("").classes("ctl-draft")
            ui.space()
            self._saved = ui.label("").classes("ctl-saved").props("role=status aria-live=polite data-state=none")
            link = ui.button(icon="link", on_click=self._copy_link)
            link.props('flat round dense color=white aria-label="Copy a link to this page with its model" data-test=link')
            with link:
                ui.tooltip("Copy a link to this page with its model")
            keys = ui.button(icon="keyboard", on_click=self.show_shortcuts)
            keys.props('flat round dense color=white aria-label="Keyboard shortcuts"').classes("ctl-wide")
            self._theme = ui.button(on_click=self._next_theme).props("flat round dense color=white")
            self._show_theme()

    def _link(self, page: Page) -> ui.element:
        link = ui.element("a").props(f'href="/{page.name}" title="{_shown(page.keys)}"')
        with link:
            ui.icon(page.icon).props("aria-hidden=true size=sm")
            ui.label(page.title)
        self._follow(link, page.name)
        return link

    def _follow(self, link: ui.element, name: str) -> None:
        # A plain click changes the page here; one with a key held opens another tab, as with any link.
        link.on(
            "click",
            lambda: self.go(name),
            js_handler=f"""(e) => {{
                if (e.ctrlKey || e.metaKey || e.shiftKey || e.altKey || e.button) return;
                e.preventDefault();
                if (window.innerWidth < {NARROW}) runMethod({self._drawer.id}, "hide", []);
                emit();
            }}""",
        )

    def _mark(self) -> None:
        """Say which page this is: in the list, in the title of the tab."""
        for page in self._pages:
            link = self._links[page.name]
            link.props(remove="aria-current")
            if page.name == self.current:
                link.props("aria-current=page")
            if self._place is not None:
                link.props(f'href="{self._url(page.name)}"')
        if self._place is not None:
            self._title.props(f'href="{self._url(self._pages[0].name)}"')
        title = next(page.title for page in self._pages if page.name == self.current)
        ui.page_title(" · ".join(part for part in (self._name.text, title, "ctlabs") if part))

    # Pages ---------------------------------------------------------------------------------------------------------------

    async def enter(self, name: str, wanted: str, model: str = "") -> None:
        """Open the draft, or the ``model`` of a link, and show a page; the library is loaded meanwhile, in a thread."""
        try:
            place = await asyncio.to_thread(self.desk.enter, self, wanted, model)
            if (prepare := getattr(place.session, "prepare", None)) is not None:
                await asyncio.to_thread(prepare)
        except Exception as why:
            log.exception("opening a draft")
            self._instead(why)
            return
        if self.client.is_deleted:
            self.desk.leave(self)
            return
        self._place, name = place, self._asked or name
        for page in self._pages:
            self.shortcut(page.keys, page.title, partial(self.go, page.name), lasting=True)
        self.shortcut("f1", "Help on what has the focus", self._no_help, lasting=True)
        self.shortcut("?", "Keyboard shortcuts", self.show_shortcuts, in_fields=False, lasting=True)
        ui.navigate.history.replace(self._url(name))
        self.show(name)
        asyncio.get_running_loop().call_later(CALM, self._prepare)  # not before the page is seen
        for notice in self.place.notices:
            self.complain(notice)

    def _prepare(self) -> None:
        """Load what the other pages will need: here, and in a process for runs."""
        self.desk.runner.warm()
        warm = getattr(self.place.session, "warm", None)
        if warm is not None:
            asyncio.get_running_loop().run_in_executor(None, warm)

    def go(self, name: str) -> None:
        """Show a page as if its link had been followed; before the draft is open, as soon as it is."""
        if self._place is None:
            self._asked = name
            return
        if name == self.current:
            self.show(name)
            return
        with self.client:
            ui.navigate.history.push(self._url(name))
            self.show(name)
            ui.run_javascript("ctlabs.top()")

    def show(self, name: str) -> None:
        """Draw a page, after the one before has been left."""
        if self._place is None or name not in self._links:
            return
        self.current = name
        self._left()
        with self.client:
            self._main.clear()
            try:
                module = importlib.import_module(f"{self._package}.{name}")
                with self._main:
                    title = next(page.title for page in self._pages if page.name == name)
                    ui.html(escape(title), sanitize=False, tag="h1").classes("ctl-sr")
                    module.page(self.place.session, self)
                importlib.import_module(self._package).over(self.place.session, self)
            except Exception as why:
                log.exception("page %s", name)
                self._instead(why)
            self._main.props("aria-busy=false")
            self._mark()
            self._tell_keys()

    def _went(self, path: str) -> None:
        """Show the page that the browser has gone back to; to go to a place within a page is no reason to draw it again."""
        name = path.strip("/") or self._pages[0].name
        if name != self.current:
            self.show(name)

    def refresh(self) -> None:
        """Draw the present page again."""
        self.show(self.current)

    def on_leave(self, action: Callable[[], object]) -> None:
        """Call this when the page is left, drawn again, or its tab closed."""
        self._leaving.append(action)

    def on_change(self, action: Callable[[], object]) -> None:
        """Call this, instead of drawing the page again, when another tab has edited the draft."""
        self._take_up = action

    def name_draft(self, name: str) -> None:
        """Put the model's name into the header and the title of the tab."""
        with self.client:
            self._name.text = name
            self._mark()

    def left(self) -> None:
        """The tab is gone."""
        self.desk.leave(self)
        if self._pending is not None:
            self._pending.cancel()
        self._left()

    def _left(self) -> None:
        leaving, self._leaving, self._take_up = self._leaving, [], None
        self._keys = {keys: shortcut for keys, shortcut in self._keys.items() if shortcut.lasting}
        for action in leaving:
            try:
                action()
            except Exception:
                log.exception("leaving page %s", self.current)

    def _instead(self, why: Exception) -> None:
        """What stands in the place of a page that cannot be shown."""
        with self.client:
            self._main.clear()
            with self._main, ui.card().props("role=alert"):
                ui.label("This page cannot be shown.").classes("text-h6")
                ui.label(_line(why))
                ui.button("Try again", on_click=lambda: ui.navigate.reload())

    def _url(self, name: str) -> str:
        return f"/{name}?draft={self.place.draft.id}"

    def _copy_link(self) -> None:
        """The address of this page with the model in it: it opens anywhere, whatever becomes of this draft."""
        if self._place is None:
            return
        try:
            address = f"/{self.current}?model={packed(self.place.session.shared)}"
        except ValueError as why:
            self.tell(str(why))
            return
        with self.client:
            ui.run_javascript(f"ctlabs.copy(location.origin + {json.dumps(address)})")
        self.tell("The link is copied: it opens this page with this model, also on another machine")

    # Messages ------------------------------------------------------------------------------------------------------------

    def saving(self) -> None:
        """An edit is on its way."""
        self._say("saving", "Saving…")

    def saved(self) -> None:
        """All edits are in the database; other tabs with this draft show them."""
        self._say("saved", "Saved")
        for other in self.desk.others(self):
            other.refresh_soon()

    def not_saved(self, line: str) -> None:
        """An edit could not be saved."""
        self._say("failed", f"Not saved: {line}")

    def tell(self, line: str) -> None:
        """A message that goes away by itself."""
        with self.client:
            ui.notify(line, position="bottom", timeout=4000)

    def complain(self, line: str) -> None:
        """A message that stays until it is closed."""
        with self.client:
            close = [{"label": "Close", "color": "white"}]
            ui.notify(line, type="negative", position="bottom", timeout=0, multi_line=True, actions=close)

    def _say(self, state: str, text: str) -> None:
        with self.client:
            self._saved.text = text
            self._saved.props(f"data-state={state}")

    def refresh_soon(self) -> None:
        """Show what another tab has changed, when there is time."""
        if (
            self._pending is None
            or self._pending.cancelled()
            or self._pending.when() < asyncio.get_running_loop().time()
        ):
            self._pending = asyncio.get_running_loop().call_later(CALM, self._changed_elsewhere)

    def _changed_elsewhere(self) -> None:
        """Show what another tab has changed: under typing hands only what a page can change without touching them."""
        with self.client:
            if self._take_up is not None:
                self._take_up()
            else:
                ui.run_javascript("ctlabs.rest()")

    def _rests(self) -> None:
        """Nobody types: the page may be drawn again."""
        if self._take_up is None:
            self.refresh()

    def _failed(self, why: Exception) -> None:
        if not isinstance(why, TimeoutError):  # a browser that answered late about its width; nothing has failed
            self.complain(_line(why))

    # Keys ----------------------------------------------------------------------------------------------------------------

    def shortcut(
        self,
        keys: str,
        label: str,
        action: Callable[[], object],
        *,
        in_fields: bool = True,
        lasting: bool = False,
    ) -> None:
        """Call ``action`` when ``keys`` are pressed while this page is shown.

        Parameters
        ----------
        keys : such as "mod+enter", "mod+shift+z", "alt+shift+m", "?", "f2"; mod, alt, shift in this order
        label : what it does, for the list of shortcuts
        in_fields : also while a field is being typed into (there, a single character is always typed)
        lasting : on all pages
        """
        alone = "+" not in keys and len(keys) == 1
        self._keys[keys.lower()] = _Shortcut(label, action, in_fields and not alone, lasting)
        if self.client.has_socket_connection:
            self._tell_keys()

    @property
    def shortcuts(self) -> list[tuple[str, str]]:
        """Keys as they are written on them, and what they do, on this page."""
        return [(_shown(keys), shortcut.label) for keys, shortcut in self._keys.items()]

    def show_shortcuts(self) -> None:
        """The list of shortcuts, over the page."""
        with self.client, dialog("Keyboard shortcuts") as made:
            with ui.grid(columns=2).classes("items-center"):
                for keys, label in self.shortcuts:
                    ui.html(f"<kbd>{escape(keys)}</kbd>", sanitize=False)
                    ui.label(label)
            ui.button("Close", on_click=made.close).props("flat autofocus")

    def _no_help(self) -> None:
        """The browser has found no help beside what has the focus: all of it is on a page of its own."""
        if any(page.name == "help" for page in self._pages):
            self.go("help")

    def _tell_keys(self) -> None:
        """The keys go to the browser with the page, as an attribute of it: there is no page without its keys."""
        known = {keys: shortcut.in_fields for keys, shortcut in self._keys.items()}
        self._main.props["data-keys"] = json.dumps(known)
        self._main.update()

    async def _pressed(self, keys: Any) -> None:
        shortcut = self._keys.get(str(keys))
        if shortcut is not None:
            with self._main:
                result = shortcut.action()
                if asyncio.iscoroutine(result):
                    await result

    # Light and dark ------------------------------------------------------------------------------------------------------

    def _next_theme(self) -> None:
        order = list(THEMES)
        self.theme = order[(order.index(self.theme) + 1) % len(order)]
        self._dark.value = THEMES[self.theme][0]
        self._show_theme()
        ui.run_javascript(f'document.cookie = "ctlabs_theme={self.theme}; path=/; max-age=63072000; samesite=strict"')

    def _show_theme(self) -> None:
        self._theme.props(f'icon={THEMES[self.theme][1]} aria-label="Theme: {self.theme}" title="Theme: {self.theme}"')


def _shown(keys: str) -> str:
    """Keys as they are written on them: "Ctrl+Shift+Z"."""
    names = {"mod": "Ctrl", "enter": "Enter", "escape": "Esc"}
    return "+".join(names.get(key, key.capitalize()) for key in keys.split("+"))


def _line(why: BaseException) -> str:
    """An exception in one line; an error of the user's input is said in its own words."""
    said = " ".join(str(why).split())
    return (
        said if said and isinstance(why, ValueError | RuntimeError | LookupError) else f"{type(why).__name__}: {said}"
    )
