"""Parts of the page Model that are used in several places: its looks, help, buttons, texts."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, NamedTuple

from nicegui import ui

from ctlabs.workbench.help import help_for

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session

#: So many earlier models are offered.
EARLIER = 8

TITLES = {
    "F": "the system", "G": "how the noise enters", "Q": "strength of the noise w", "Phi": "from step to step",
    "Qd": "covariance of a step's noise", "B": "how the known input enters", "u": "the known input",
    "offset": "known displacement of a step", "H": "what is measured", "R": "covariance of the measurement noise v",
    "Rc": "strength of the measurement noise v", "N": "what w and v have in common", "x0": "estimate at the beginning",
    "P0": "its uncertainty",
}  # fmt: skip
PARTS = {
    "u": "Known input u",
    "N": "Common noise N",
    "offset": "Known displacement c",
    "Rc": "Rc (continuous measurement) instead of R",
    "R": "R (sampled measurement) instead of Rc",
}




def help_button(key: str) -> None:
    """A question mark with the help on something, which opens beside it."""
    told = help_for(key)
    button = (
        ui.button("?")
        .classes("ctl-help")
        .props(f'outline round dense tabindex=-1 aria-label="Help: {escape(told.title)}" aria-haspopup=dialog title="Help (F1)"')
    )
    button.props(f"data-test=help-{key.partition('.')[2]}")
    with button, ui.menu().props(f'no-parent-event max-width=420px role=dialog aria-label="{escape(told.title)}"') as menu:
        place = ui.element("div").classes("ctl-helptext")

    def opened() -> None:
        if not place.default_slot.children:
            with place:
                ui.html(f"<b>{escape(told.title)}</b>{told.html}", sanitize=False)
        menu.open()

    button.on("click", opened)


def text(tag: str, text: str) -> ui.html:
    """A text in an element of its own."""
    return ui.html(escape(text), sanitize=False, tag=tag)


def tool(word: str, icon: str, test: str, action: Callable[[], object], keys: str = "") -> ui.button:
    """A button of the toolbar: its icon, and its word where there is room."""
    with ui.button(icon=icon, on_click=action).props(
        f'flat dense no-caps data-test={test} aria-label="{word}"'
    ) as button:
        ui.label(word).classes("ctl-word q-ml-xs")
    return button.props(f'title="{word}{f" ({keys})" if keys else ""}"')


def word_of(button: ui.button) -> ui.label:
    """The word on a button of the toolbar."""
    return next(child for child in button.default_slot.children if isinstance(child, ui.label))


def tell(button: ui.button, word: str, able: bool, label: str) -> None:
    """Say what a button would do; it keeps the focus when there is nothing to do."""
    attributes(button, title=f"{word}: {label}" if label else word, aria_disabled=str(not able).lower())


def attributes(element: ui.element, **values: str) -> None:
    """Attributes with any text in them; what is the same is not sent again."""
    for name, value in values.items():
        key = name.replace("_", "-")
        if element.props.get(key) != value:
            element.props[key] = value


def add(word: str, test: str, action: Callable[[], object]) -> None:
    """A button that adds something."""
    ui.button(word, icon="add", on_click=lambda: action()).props(f"flat dense no-caps data-test={test}")


def write(label: ui.label, text: str) -> None:
    """Another text for a label, if it is another."""
    if label.text != text:
        label.text = text


class Earlier(NamedTuple):
    """Another draft of the same person: its address, its title, when it was changed last."""

    address: str
    title: str
    when: str


def earlier(session: Session) -> list[Earlier]:
    """The models that were worked on before this one, the latest first."""
    own = session.draft
    found = []
    for each in session.store.drafts(own.owner):
        if each.id != own.id and each.text:
            try:
                title = str(tomllib.loads(each.text).get("title") or "Untitled model")
            except tomllib.TOMLDecodeError:
                title = "Untitled model"
            when = time.strftime("%Y-%m-%d %H:%M", time.localtime(each.updated))
            found.append(Earlier(f"/model?draft={each.id}", title, when))
    return found[:EARLIER]


def earlier_list(models: list[Earlier]) -> None:
    """Links to earlier models."""
    with ui.element("div").classes("ctl-earlier").props("data-test=earlier"):
        for each in models:
            with ui.element("a").props(f'href="{each.address}"'):
                ui.html(f"{escape(each.title)} <small>· {each.when}</small>", sanitize=False)
