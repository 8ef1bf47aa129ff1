"""The gallery of ready models: ``ctlabs models``, ``ctlabs models show NAME``, ``ctlabs models copy NAME``."""

from __future__ import annotations

from pathlib import Path

import click

from ctlabs.cli.common import Commands, checked


@click.group(cls=Commands, invoke_without_command=True)
@click.pass_context
def models(ctx: click.Context) -> None:
    """Ready models to start from.

    Those of the labs, and the usual ones.

    \b
    ctlabs models                            what there is
    ctlabs models show local_level           the file on the screen (or into a pipe)
    ctlabs models copy local_level           as local_level.toml, to be edited
    ctlabs simulate local_level              the commands take a gallery's name for MODEL
    """
    if ctx.invoked_subcommand is not None:
        return
    from ctlabs.files import modelfile

    entries = modelfile.gallery()
    width = max(len(entry.name) for entry in entries)
    for entry in entries:
        click.echo(f"{entry.name:<{width}}  {entry.title}")


@models.command()
@click.argument("name")
def show(name: str) -> None:
    """Print a ready model's file."""
    from ctlabs.files import modelfile

    click.echo(checked(lambda: modelfile.ready(name)).dumps(), nl=False)


@models.command()
@click.argument("name")
@click.argument("folder", type=click.Path(path_type=Path), default=Path())
def copy(name: str, folder: Path) -> None:
    """Write a ready model to FOLDER/NAME.toml (default: here); a file that stands there is left alone."""
    from ctlabs.files import modelfile

    checked(lambda: modelfile.ready(name))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"{folder}: expected a folder that can be written, received: {error.strerror}"
        raise click.ClickException(msg) from None
    click.echo(checked(lambda: modelfile.copy(name, folder)))
