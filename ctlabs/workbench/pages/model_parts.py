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
    from ctlabs.workbench.session import Session

#: So many earlier models are offered.
EARLIER = 8

LATEX = {"Phi": r"\Phi", "Qd": "Q_d", "Rc": "R_c", "x0": "x_0", "P0": "P_0", "offset": "c"}
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

STYLE = """
.ctl-model { width: 100%; display: flex; flex-direction: column; gap: .75rem; min-width: 0; }
.ctl-model .ctl-card { background: var(--card); border: 1px solid color-mix(in srgb, currentColor 16%, transparent); border-radius: 12px;
  padding: .75rem 1rem; display: flex; flex-direction: column; gap: .6rem; min-width: 0; }
.ctl-model h2 { font-size: 1rem; line-height: 1.4rem; font-weight: 600; margin: 0; }
.ctl-model h3 { font-size: .86rem; line-height: 1.3rem; font-weight: 400; margin: 0; }
.ctl-bar { display: flex; flex-wrap: wrap; gap: .25rem .4rem; align-items: center; }
.ctl-bar .ctl-gap { flex: 1; }
.ctl-titlefield { flex: 1 1 16rem; }
.ctl-model .ctl-titlefield input { font-weight: 600; font-size: 1.2rem; font-family: inherit; height: 2.3rem; border-color: transparent;
  background: transparent; width: 100%; }
.ctl-model .ctl-titlefield input:hover, .ctl-model .ctl-titlefield input:focus { border-color: var(--line); background: var(--field); }
.ctl-about { margin: 0; max-width: 62rem; font-size: .88rem; opacity: .85; white-space: pre-line; }
.ctl-columns { display: grid; grid-template-columns: minmax(0, 1fr) minmax(17rem, 24rem); gap: .75rem; align-items: start; }
.ctl-column { display: flex; flex-direction: column; gap: .75rem; min-width: 0; }
.ctl-sections { display: flex; flex-wrap: wrap; gap: 1rem 1.5rem; align-items: flex-start; }
.ctl-part { min-width: 0; max-width: 100%; }
.ctl-caption { display: flex; align-items: center; gap: .3rem; min-height: 1.7rem; }
.ctl-caption math { font-size: 1.1rem; }
.ctl-help.q-btn { min-height: 1.35rem; min-width: 1.35rem; width: 1.35rem; height: 1.35rem; font-size: .72rem; padding: 0; }
.ctl-helptext { max-width: 25rem; padding: .75rem 1rem; font-size: .88rem; }
.ctl-helptext p { margin: .3rem 0; }
.ctl-helptext dl { display: grid; grid-template-columns: auto 1fr; gap: .2rem .75rem; margin: .5rem 0 0; }
.ctl-helptext dt { font-weight: 600; } .ctl-helptext dd { margin: 0; overflow-wrap: anywhere; }
.ctl-problems { display: flex; flex-wrap: wrap; gap: .3rem .6rem; align-items: center; font-size: .86rem; min-height: 1.9rem; }
.ctl-link { border: 0; background: none; color: inherit; padding: .1rem .3rem; border-radius: 5px; cursor: pointer; text-align: left;
  text-decoration: underline; text-underline-offset: 2px; overflow-wrap: anywhere; }
.ctl-problems[data-count="0"] { color: #1b6e3c; } body.body--dark .ctl-problems[data-count="0"] { color: #8fd6a8; }
.ctl-problems:not([data-count="0"]) { color: #b00020; } body.body--dark .ctl-problems:not([data-count="0"]) { color: #ff8a80; }
.ctl-constant { border-top: 1px solid color-mix(in srgb, currentColor 12%, transparent); padding-top: .4rem; width: 100%; }
.ctl-constant > .ctl-line { display: grid; gap: .3rem; align-items: start;
  grid-template-columns: 5.5rem auto minmax(0, 1fr) auto auto auto; }
.ctl-constant .ctl-eq { padding-top: .3rem; }
.ctl-constant .ctl-unitof { padding-top: .3rem; font-size: .85rem; opacity: .75; max-width: 6rem; overflow: hidden; text-overflow: ellipsis;
  white-space: nowrap; }
.ctl-ends { display: flex; align-items: center; gap: .5rem; font-size: .75rem; opacity: .85; }
.ctl-ends > .ctl-cells { flex: 1; }
.ctl-meaning { font-size: .78rem; opacity: .75; }
.ctl-details { display: grid; grid-template-columns: 1fr 1fr; gap: .3rem .5rem; padding: .3rem 0 .4rem; }
.ctl-details > :last-child { grid-column: 1 / -1; }
.ctl-begin { display: grid; grid-template-columns: repeat(auto-fit, minmax(15rem, 1fr)); gap: .75rem; width: 100%; }
.ctl-begin > button, .ctl-ready {
  border: 1px solid color-mix(in srgb, currentColor 22%, transparent); border-radius: 12px; background: var(--card);
  color: inherit; text-align: left; padding: 1rem; cursor: pointer; display: flex; flex-direction: column; gap: .3rem; font: inherit; }
.ctl-begin > button:hover, .ctl-ready:hover { border-color: var(--q-primary); }
.ctl-begin b { font-size: 1.05rem; }
.ctl-earlier { display: flex; flex-direction: column; gap: .1rem; align-items: flex-start; }
.ctl-earlier a { color: inherit; padding: .25rem .3rem; border-radius: 5px; overflow-wrap: anywhere; }
.ctl-drop { position: fixed; inset: 0; z-index: 7000; display: none; align-items: center; justify-content: center; font-size: 1.4rem;
  background: color-mix(in srgb, var(--q-primary) 55%, transparent); color: #fff; pointer-events: none; text-shadow: 0 1px 4px #000; }
.ctl-dropping .ctl-drop { display: flex; }
.ctl-model .q-btn[aria-disabled=true] { opacity: .4; }
.ctl-details .ctl-cells input { width: 100%; }
.ctl-small .ctl-cells input { width: 8rem; }
.ctl-toggle.q-btn-group { border: 1px solid color-mix(in srgb, currentColor 25%, transparent); }
.ctl-toggle .q-btn { padding: 2px 10px; }
@media (min-width: 1100px) { .ctl-side { position: sticky; top: 56px; max-height: calc(100vh - 64px); overflow: auto; } }
@media (max-width: 1099px) { .ctl-columns { grid-template-columns: minmax(0, 1fr); } }
@media (max-width: 699px) { .ctl-model .ctl-word { display: none; } .ctl-model .ctl-card { padding: .6rem; } }
"""

# A file that is dropped anywhere on the page goes to the page's uploader; elsewhere the browser would leave the page for it.
DROP = """
if (!window.ctlabsDrop) {
  window.ctlabsDrop = true;
  let depth = 0;
  const files = (e) => e.dataTransfer?.types?.includes("Files");
  const over = (on) => document.querySelector(".ctl-model")?.classList.toggle("ctl-dropping", on);
  window.addEventListener("dragenter", (e) => { if (files(e)) { depth += 1; over(true); } });
  window.addEventListener("dragleave", (e) => { if (files(e) && --depth <= 0) { depth = 0; over(false); } });
  window.addEventListener("dragover", (e) => { if (files(e)) e.preventDefault(); });
  window.addEventListener("drop", (e) => {
    if (!files(e)) return;
    depth = 0;
    over(false);
    const page = document.querySelector(".ctl-model");
    if (!page) { if (!e.target.closest(".q-uploader")) e.preventDefault(); return; }
    e.preventDefault();
    getElement(Number(page.dataset.uploader)).$refs.qRef.addFiles([e.dataTransfer.files[0]]);
  });
}
"""


def help_button(key: str) -> None:
    """A question mark with the help on something, which opens beside it."""
    told = help_for(key)
    button = (
        ui.button("?")
        .classes("ctl-help")
        .props(f'outline round dense aria-label="Help: {escape(told.title)}" aria-haspopup=dialog')
    )
    button.props(f"data-test=help-{key.partition('.')[2]}")
    with button, ui.menu().props("no-parent-event max-width=420px") as menu:
        place = (
            ui.element("div")
            .classes("ctl-helptext")
            .props(f'role=dialog tabindex=-1 aria-label="{escape(told.title)}"')
        )

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
