"""The dialogs of the page Model: ready models and files, a new model, coloured noise as a block of states."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any, Literal

from nicegui import ui

from ctlabs.files.modelfile import gallery
from ctlabs.files.modelfile.errors import ModelFileError
from ctlabs.files.modelfile.schema import LARGEST
from ctlabs.text import latex_matrix, latex_number
from ctlabs.workbench.desk import blocks, commands
from ctlabs.workbench.desk.plain import whole
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages.dialogs import buttons, dialog
from ctlabs.workbench.pages.math import Equations
from ctlabs.workbench.pages.model_parts import Earlier, earlier_list

if TYPE_CHECKING:
    from ctlabs.files.modelfile import Entry
    from ctlabs.workbench.desk.session import Session

EXAMPLES = {
    "transfer": ("1/(2*s + 1)", "s/(s^2 + 0.4*s + 4)", "1/(s*(s + 1))"),
    "psd": ("4/(w^2 + 1)", "(w^2 + 9)/(w^4 + 5*w^2 + 4)", "0.2/(w^2 + 0.01)"),
}
#: So many earlier models are listed before the ready ones.
FEW = 3
NAMES = {"transfer": "Transfer function of s", "psd": "Spectrum of w (ω)"}


def ready(opened: Callable[[str, str], bool], pick: str, models: list[Earlier]) -> None:
    """Choose a ready model or a file, or go to an earlier model. ``pick``: what the browser does to let a file be chosen."""
    with dialog("Open a model", 46) as made:
        with ui.row().classes("items-center w-full"):
            wanted = ui.input("Find").props("dense outlined clearable autofocus data-test=filter").classes("col")
            file = ui.button("From a file…", icon="upload_file").props("outline no-caps data-test=open-file")
            file.on("click", made.close, js_handler=f"(e) => {{ ({pick})(); emit(); }}")
        ui.label("What is open now stays a step of the history: Undo brings it back.").classes("ctl-meaning")
        found: list[tuple[Entry, ui.element]] = []
        groups: list[tuple[ui.label, bool]] = []
        with ui.element("div").style(
            "overflow: auto; max-height: 60vh; width: 100%; display: grid; gap: .4rem; padding: 3px"
        ):
            with ui.element("div") as before:
                ui.label("Earlier models, each with its own history").classes("text-subtitle2")
                earlier_list(models[:FEW])
            before.set_visibility(bool(models))
            for lab, title in ((False, "Usual models"), (True, "From the labs")):
                groups.append((ui.label(title).classes("text-subtitle2"), lab))
                found += [(entry, _entry(entry, made, opened)) for entry in gallery() if bool(entry.lab) == lab]

    def narrow() -> None:
        words = (wanted.value or "").lower().split()
        for entry, element in found:
            text = f"{entry.name} {entry.title} {entry.kind} {entry.description} {entry.lab}".lower()
            element.set_visibility(all(word in text for word in words))
        for label, lab in groups:
            label.set_visibility(any(element.visible for entry, element in found if bool(entry.lab) == lab))
        before.set_visibility(bool(models) and not words)

    def only() -> None:
        narrow()
        left = [entry for entry, element in found if element.visible]
        if len(left) == 1 and opened(left[0].text, f"{left[0].name}.toml"):
            made.close()

    wanted.on_value_change(narrow)
    wanted.on("keydown.enter", only)


def _entry(entry: Entry, made: ui.dialog, opened: Callable[[str, str], bool]) -> ui.element:
    def choose() -> None:
        if opened(entry.text, f"{entry.name}.toml"):
            made.close()

    first = entry.description.strip().split("\n")[0]
    with (
        ui.element("button")
        .classes("ctl-ready")
        .props(f"type=button data-test=ready-{entry.name}")
        .on("click", choose) as element
    ):
        ui.html(
            f"<b>{escape(entry.title)}</b> <small>· {entry.kind}</small><br><small>{escape(first)}</small>",
            sanitize=False,
        )
    return element


def new(begin: Callable[[commands.New], bool]) -> None:
    """Ask for the sizes of a new model."""
    with dialog("A new model") as made:
        kind = ui.toggle({"continuous": "Continuous", "discrete": "Discrete"}, value="continuous").props(
            'dense no-caps unelevated data-test=new-kind aria-label="Kind of model"'
        )
        kind.classes("ctl-toggle")
        ui.html("", sanitize=False).bind_content_from(
            kind,
            "value",
            lambda value: (
                "Differential equations: ẋ = F x + G w"
                if value == "continuous"
                else "From step to step: x(k+1) = Φ x(k) + w(k)"
            ),
        )
        sizes = {}
        with ui.row().classes("items-start no-wrap w-full"):
            for name, label, value in (("n", "States", 2), ("s", "Noises", 1), ("m", "Measurements", 1)):
                sizes[name] = ui.input(label, value=str(value), validation=_size).without_auto_validation()
                sizes[name].props(f"outlined dense inputmode=numeric autocomplete=off data-test=new-{name}").classes("col")
        sizes["n"].props("autofocus")
        sizes["s"].bind_visibility_from(kind, "value", lambda value: value == "continuous")

        def begun() -> None:
            wrong = [field for field in sizes.values() if field.visible and not field.validate()]
            if not wrong:
                n, s, m = (whole(sizes[name].value, 1, LARGEST) if sizes[name].visible else 1 for name in "nsm")
                if begin(commands.New(n, s, m, str(kind.value))):
                    made.close()

        for field in sizes.values():
            field.on("keydown.enter", begun)
        ui.link("Or in a new tab, beside the model that is open", "/model?draft=new", new_tab=True).props("data-test=new-tab")
        buttons(made, "Begin", "new-begin", begun)


def _size(text: str) -> str | None:
    try:
        whole(text, 1, LARGEST)
    except ValueError as why:
        return str(why)
    return None


def block(session: Session, do: Callable[[commands.Command], bool]) -> None:
    """Ask for a transfer function or spectrum, show the states that it becomes, and put them into the model."""
    sheet = session.sheet
    places = {f"noise {j}": f"instead of white noise w{j + 1}" for j in range(sheet.sizes["s"])}
    places |= {f"measurement {i}": f"added to measurement {name}" for i, name in enumerate(sheet.measurements)}
    with dialog("Coloured noise", 46) as made:
        kind = ui.toggle(NAMES, value="transfer").props(
            'dense no-caps unelevated data-test=block-kind aria-label="What is typed"'
        )
        kind.classes("ctl-toggle")
        told = ui.label("").classes("ctl-meaning")
        text = ui.input("Expression", value=EXAMPLES["transfer"][0]).props(
            "outlined dense debounce=150 autofocus data-test=block-text"
        )
        text.classes("w-full").style("font-family: ui-monospace, monospace")
        examples = ui.row().classes("items-center gap-1")
        with ui.row().classes("w-full items-start gap-2"):
            into = (
                ui.select(places, value=next(iter(places)), label="Where")
                .props("outlined dense data-test=block-into")
                .style("flex: 1 1 13rem")
            )
            name = (
                ui.input("Name of the first state", value="coloured")
                .props("outlined dense data-test=block-name")
                .style("flex: 1 1 9rem")
            )
            unit = ui.input("Unit").props("outlined dense data-test=block-unit").style("flex: 1 1 6rem")
        ui.label("It becomes").classes("text-subtitle2")
        problem = ui.label("").classes("ctl-error").props("role=status aria-live=polite data-test=block-problem")
        preview = Equations("The states of the block")
        preview.props("data-test=block-preview").style("min-height: 8rem; max-height: 32vh; overflow: auto")

        def look() -> None:
            try:
                lines, line = preview_lines(str(kind.value), str(text.value or ""), session), ""
            except ValueError as why:
                lines, line = [], str(why)
            preview.show(lines)
            problem.text = line

        def chosen() -> None:
            which = str(kind.value)
            told.text = help_for(f"model.{which}").what
            examples.clear()
            with examples:
                ui.label("For example").classes("ctl-meaning")
                for i, example in enumerate(EXAMPLES[which]):
                    ui.button(example, on_click=lambda example=example: text.set_value(example)).props(
                        f"flat dense no-caps size=sm data-test=block-example-{i}"
                    )
            text.set_value(EXAMPLES[which][0])
            look()

        def insert() -> None:
            place, _, index = str(into.value).partition(" ")
            if do(
                _insertion(
                    kind.value, str(text.value or ""), int(index), place, str(name.value or ""), str(unit.value or "")
                )
            ):
                made.close()

        kind.on_value_change(chosen)
        text.on_value_change(look)
        text.on("keydown.enter", insert)
        chosen()
        buttons(made, "Insert", "block-insert", insert)


def _insertion(kind: Any, text: str, into: int, place: Any, name: str, unit: str) -> blocks.InsertBlock:
    found: Literal["noise", "measurement"] = "noise" if place == "noise" else "measurement"
    return blocks.InsertBlock("psd" if kind == "psd" else "transfer", text, into, found, name, unit)


def preview_lines(kind: str, text: str, session: Session) -> list[str]:
    """The state equations of a block in LaTeX; ``ValueError`` in one line where the text is none."""
    try:
        constants = session.file.constants
    except ModelFileError as why:
        msg = f"put right first: {why}"
        raise ValueError(msg) from None
    made = blocks.block(kind, text, constants)
    direct = rf" + {latex_number(made.D)}\,w" if made.D else ""
    output = "" if made.H.tolist() == [1.0] else rf"{latex_matrix(made.H[None])}\,"
    return [
        rf"\dot y = {latex_matrix(made.F)}\,y + {latex_matrix(made.G[:, None])}\,w",
        rf"\text{{noise}} = {output}y{direct}",
        rf"P_0 = {latex_matrix(made.P0)}",
    ]
