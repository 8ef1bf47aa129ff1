"""Finished blocks on disk: they survive a kill at any moment, a full disk and a damaged file.

A folder holds one experiment: ``experiment.json`` says which, ``block-….sums`` are finished blocks, and
``merged-0.sums``, ``merged-1.sums`` the sums over the first blocks, written in turn, so that one of them is whole
whatever happens to the other. Every file is written under another name and renamed, carries the experiment's
identity and a digest of itself; one that is damaged counts as absent, and its blocks are computed again.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
import warnings
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path

import numpy as np

from ctlabs.montecarlo.sums import Sums

MAGIC = b"ctlabs sums 1\n"
#: Seconds between two writings of the merged sums: blocks finished in between have files of their own.
INTERVAL = 1.0


class Checkpoint:
    """The folder of one experiment's finished blocks."""

    def __init__(self, folder: str | os.PathLike[str], identity: Mapping[str, str]) -> None:
        self.folder, self.identity = Path(folder), dict(identity)
        self.digest = sha256(json.dumps(self.identity, sort_keys=True).encode()).hexdigest()
        self._older = self._newer = 0  # blocks in the two files of merged sums
        self._turn, self._written = 0, time.monotonic()
        self._frozen = self._warned = False
        self._open()

    def load(self, count: int, full: int, runs_of: Callable[[int], int]) -> tuple[Sums | None, int, dict[int, Sums]]:
        """What is on record for an experiment of ``count`` blocks, the first ``full`` of them of full size.

        Returns the merged sums, how many blocks they hold, and further blocks.
        """
        total, merged = self._merged(full)
        blocks = {}
        for block in range(merged, count):
            found = self._read(self._path(block, runs_of(block)))
            if found is not None:
                blocks[block] = found[1]
        return total, merged, blocks

    def put(self, block: int, runs: int, sums: Sums) -> None:
        """Record a finished block."""
        self._write(self._path(block, runs), block, sums)

    def compact(self, total: Sums, merged: int, *, force: bool = False) -> None:
        """Record the sums over the first ``merged`` blocks, now and then or at once, and drop files they make needless."""
        if merged <= self._newer or not (force or time.monotonic() - self._written > INTERVAL):
            return
        if not self._write(self.folder / f"merged-{self._turn}.sums", merged, total):
            return
        self._turn, self._written = 1 - self._turn, time.monotonic()
        self._older, self._newer = self._newer, merged
        for path in self.folder.glob("block-*.sums"):
            # Blocks since the older of the two files stay: it must be enough if the newer one is damaged.
            if int(path.name.split("-")[1]) < self._older:
                path.unlink(missing_ok=True)

    def _open(self) -> None:
        path = self.folder / "experiment.json"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._sweep()
            try:
                there = json.loads(path.read_text(encoding="utf-8"))
            except (FileNotFoundError, ValueError):
                there = None
            if not isinstance(there, dict):
                self._refuse_strangers()
                _replace(path, json.dumps(self.identity, indent=1, sort_keys=True).encode())
                return
        except OSError as why:
            msg = f"checkpoint: expected a folder that can be written, received {str(self.folder)!r} ({why.strerror or why})"
            raise ValueError(msg) from None
        different = sorted(k for k in {*there, *self.identity} if there.get(k) != self.identity.get(k))
        if different:
            pairs = "; ".join(f"{k} {there.get(k)} there, {self.identity.get(k)} here" for k in different)
            msg = f"checkpoint: expected the same experiment in {str(self.folder)!r}, received another one ({pairs})"
            raise ValueError(msg)

    def _sweep(self) -> None:
        """Remove what a killed process was writing (younger files may be another process's)."""
        for path in self.folder.glob(".*.sums.*"):
            with contextlib.suppress(OSError):
                if time.time() - path.stat().st_mtime > 60:
                    path.unlink()

    def _refuse_strangers(self) -> None:
        """Without a readable ``experiment.json`` the files themselves say what they belong to."""
        for path in sorted(self.folder.glob("*.sums")):
            owner = _owner(path)
            if owner is not None and owner != self.digest:
                msg = f"checkpoint: expected the same experiment in {str(self.folder)!r}, received another one ({path.name})"
                raise ValueError(msg)

    def _merged(self, full: int) -> tuple[Sums | None, int]:
        found = [(*pair, turn) for turn in (0, 1) if (pair := self._read(self.folder / f"merged-{turn}.sums"))]
        if not found:
            return None, 0
        blocks, total, turn = max(found, key=lambda entry: entry[0])
        self._newer, self._turn = blocks, 1 - turn
        self._older = min(entry[0] for entry in found) if len(found) > 1 else 0
        if blocks > full:
            # The record holds more runs than are asked for: sums cannot be taken apart, and the record is left as it is.
            self._frozen = True
            return None, 0
        return total, blocks

    def _path(self, block: int, runs: int) -> Path:
        return self.folder / f"block-{block:08d}-{runs}.sums"

    def _read(self, path: Path) -> tuple[int, Sums] | None:
        """Number and sums of an intact file of this experiment, None otherwise."""
        try:
            raw = path.read_bytes()
        except OSError:
            return None
        body, digest = raw[:-32], raw[-32:]
        if not body.startswith(MAGIC) or sha256(body).digest() != digest:
            return None
        head, _, data = body[len(MAGIC) :].partition(b"\n")
        about = json.loads(head)
        if about["experiment"] != self.digest:
            return None
        cut = 8 * int(np.prod(about["table"]))
        table = np.frombuffer(data[:cut], dtype="<f8").reshape(about["table"])
        return about["number"], Sums(table, np.frombuffer(data[cut:], dtype="<i8").reshape(about["counts"]))

    def _write(self, path: Path, number: int, sums: Sums) -> bool:
        if self._frozen:
            return False
        about = {"experiment": self.digest, "number": number, "table": sums.table.shape, "counts": sums.counts.shape}
        body = (
            MAGIC
            + json.dumps(about).encode()
            + b"\n"
            + sums.table.astype("<f8").tobytes()
            + sums.counts.astype("<i8").tobytes()
        )
        try:
            _replace(path, body + sha256(body).digest())
        except OSError as why:
            if not self._warned:
                self._warned = True
                text = (
                    f"checkpoint: {why.strerror or why} in {str(self.folder)!r}; the experiment goes on, and blocks "
                    "that cannot be saved are kept in memory only"
                )
                warnings.warn(text, RuntimeWarning, stacklevel=2)
            return False
        return True


def _owner(path: Path) -> str | None:
    """The experiment that a file claims to belong to."""
    try:
        with path.open("rb") as file:
            lines = file.read(4096).split(b"\n")
        return str(json.loads(lines[1])["experiment"]) if lines[0] + b"\n" == MAGIC else None
    except (OSError, ValueError, KeyError, IndexError):
        return None


def _replace(path: Path, content: bytes) -> None:
    """Write under another name and rename: the file is old or new, never half."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
