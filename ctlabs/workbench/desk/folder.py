"""Where the workbench keeps its data, and whether it can; no database is needed for it."""

from __future__ import annotations

import os
from pathlib import Path

#: The name of the file in the data folder.
FILE = "workbench.sqlite3"


class StoreError(RuntimeError):
    """The file cannot be read or written; the message is one line for the reader."""


class Unwritable(StoreError):
    """The folder cannot be written."""


def data_folder() -> Path:
    """Where the workbench keeps its data: ``CTLABS_DATA``, or the system's folder for the user's data."""
    given = os.environ.get("CTLABS_DATA")
    if given:
        return Path(given).expanduser().resolve()
    import platformdirs

    return Path(platformdirs.user_data_dir("ctlabs", appauthor=False))


def writable(folder: Path) -> None:
    """See that the file can be kept in a folder that is there.

    Raises
    ------
    Unwritable
        It cannot; one line.
    """
    file = folder / FILE
    if not os.access(folder, os.W_OK | os.X_OK) or (file.exists() and not os.access(file, os.W_OK)):
        msg = f"{folder}: expected a folder that can be written, received one that cannot"
        raise Unwritable(msg)
