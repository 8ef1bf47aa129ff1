"""What all commands share: refusals in one line, whole numbers, settings, folders."""

from __future__ import annotations

import contextlib
import tempfile
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class Commands(click.Group):
    """A group that names its commands when it is given another."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The command that ``args`` begin with."""
        if self.get_command(ctx, args[0]) is None:
            msg = f"command {args[0]}: expected one of {', '.join(self.list_commands(ctx))}, received an unknown name"
            raise click.ClickException(msg)
        return super().resolve_command(ctx, args)


def whole(least: int) -> Callable[[click.Context, click.Parameter, str | int | None], int | None]:
    """A whole number of the command line, refused in the words of all checks."""

    def check(_context: click.Context, option: click.Parameter, value: str | int | None) -> int | None:
        if value is None:
            return None
        with contextlib.suppress(ValueError):
            if int(value) >= least:
                return int(value)
        msg = f"{option.opts[0]}: expected a whole number >= {least}, received {value or 'nothing'}"
        raise click.ClickException(msg)

    return check


def settings(pairs: tuple[str, ...]) -> dict[str, object]:
    """NAME=VALUE pairs of the command line."""
    from ctlabs.reporting.params import typed

    found = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name.strip():
            raise ValueError(f"--set {pair}: expected NAME=VALUE, received no name or no =")
        found[name.strip()] = typed(text.strip())
    return found


def checked(action: Any) -> Any:
    """What ``action`` returns; a ``ValueError`` becomes the command line's one line."""
    try:
        return action()
    except ValueError as error:
        raise click.ClickException(str(error)) from None


def can_write(out: Path) -> None:
    """Refuse a folder that cannot be written before anything is computed."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise click.ClickException(
            f"--out {out}: expected a folder that can be written, received: {error.strerror}"
        ) from None
