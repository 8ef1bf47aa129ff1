"""The command ``ctlabs workbench``; nothing of the workbench is loaded before it runs."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import click


@click.command("workbench")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on.",
)
@click.option(
    "--port", type=click.IntRange(0, 65535), help="Port to listen on.  [default: the first free one from 8080 on]"
)
@click.option("--no-token", is_flag=True, help="Let every user of this machine in: no token on a loopback address.")
@click.option("--no-open", is_flag=True, help="Do not open the page in the browser.")
@click.option(
    "--data",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the drafts and experiments.  [default: CTLABS_DATA, or the user's data folder]",
)
def workbench(host: str, port: int | None, no_token: bool, no_open: bool, data: Path | None) -> None:
    """Open the laboratory in the browser.

    Models, experiments and the labs, without writing a program.

    It runs on this machine only and needs no network. The address that is printed and opened holds a token, which the
    browser keeps: other users of the machine are kept out. Every edit is saved as it is made; Ctrl-C ends it.
    """
    if importlib.util.find_spec("nicegui") is None or importlib.util.find_spec("sqlalchemy") is None:
        msg = "workbench: expected its packages to be installed, received none: pip install 'ctlabs[workbench]'"
        raise click.ClickException(msg)
    from ctlabs.workbench.serving.server import serve

    try:
        serve(host, port, show=not no_open, data=data, open_to_all=no_token)
    except ValueError as why:
        raise click.ClickException(str(why)) from None
