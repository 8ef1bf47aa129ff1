"""The commands of a course: ``ctlabs course new``, ``issue``, ``key``, ``test``."""

from __future__ import annotations

import click

from ctlabs.cli.common import Commands


@click.group(cls=Commands)
def course() -> None:
    """A course from one roster: personal variants, keys, grades; in plain files, with nothing sent anywhere."""
