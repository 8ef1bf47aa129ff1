"""What is kept: drafts with their history, and experiments, in one SQLite file under the user's data folder.

A draft is the model on the desk of one browser tab. Every edit is one transaction, so that a server which is killed
starts again with everything: the text, all revisions behind and ahead of it, and the notes of the pages. An experiment
is a model, its settings, its seed and its results, kept until it is deleted, which can be taken back.

The file is in SQLite's WAL mode: several tabs, threads and processes read while one writes. A commit survives the end of
the process; after a loss of power the file is whole, but the last edits may be missing (``synchronous = NORMAL``).
Nothing here depends on a page. How results become text: :mod:`ctlabs.workbench.desk.packing`.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from ctlabs.workbench.desk.folder import FILE, StoreError, Unwritable, data_folder, writable
from ctlabs.workbench.desk.packing import pack, unpack
from ctlabs.workbench.desk.salvage import salvage

#: Version of the tables; a file of another version is refused.
SCHEMA = 1
#: Marks the file as ours (SQLite's application_id): "ctlb".
APPLICATION = 0x63746C62
#: Revisions that a draft remembers; the oldest is forgotten first.
REVISIONS = 500
#: The longest text of a model, in characters.
LONGEST = 1_000_000
#: How long what was deleted can be taken back, and a draft that nobody edited is kept, in seconds.
REMEMBERED, UNTOUCHED = 30 * 86400.0, 86400.0

_tables = sa.MetaData()
_drafts = sa.Table(
    "draft",
    _tables,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("owner", sa.String, nullable=False),
    sa.Column("session", sa.String, nullable=False),
    sa.Column("number", sa.Integer, nullable=False),
    sa.Column("notes", sa.String, nullable=False),
    sa.Column("updated", sa.Float, nullable=False),
    sa.Column("deleted", sa.Float),
    sa.Index("draft_of", "owner", "updated"),
)
_revisions = sa.Table(
    "revision",
    _tables,
    sa.Column("draft", sa.ForeignKey("draft.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("text", sa.String, nullable=False),
)
_texts = sa.Table(
    "text",
    _tables,
    sa.Column("key", sa.String, primary_key=True),
    sa.Column("text", sa.String, nullable=False),
)
_experiments = sa.Table(
    "experiment",
    _tables,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("owner", sa.String, nullable=False),
    sa.Column("created", sa.Float, nullable=False),
    sa.Column("name", sa.String, nullable=False),
    sa.Column("model", sa.String, nullable=False),
    sa.Column("settings", sa.String, nullable=False),
    sa.Column("seed", sa.Integer, nullable=False),
    sa.Column("results", sa.String, nullable=False),
    sa.Column("deleted", sa.Float),
    sa.Index("experiment_of", "owner", "created"),
    sqlite_autoincrement=True,  # the number of a deleted experiment is not given to another
)


class Edited(ValueError):
    """The draft has another revision than was expected: another server on the same folder has it, too."""


@dataclass(frozen=True, slots=True)
class Draft:
    """A model being edited: its present text, and which revision of its history that is."""

    id: str
    owner: str
    session: str
    number: int
    text: str
    updated: float
    notes: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Revision:
    """One step of a draft's history; ``label`` says what was done ("set F[0][1]")."""

    number: int
    label: str
    text: str


@dataclass(frozen=True, slots=True)
class KeptExperiment:
    """A kept experiment without its results (:meth:`Store.results`); times in seconds since 1970."""

    id: int
    owner: str
    created: float
    name: str
    model: str
    settings: dict[str, Any]
    seed: int
    deleted: float | None = None

    @property
    def kind(self) -> str:
        """What it is: an "experiment", or as its settings say."""
        return str(self.settings.get("kind", "experiment"))


class Store:
    """The file, open. Safe to use from several threads; every method is one transaction.

    Parameters
    ----------
    folder : where the file is or is made; :func:`data_folder` if not given

    Raises
    ------
    Unwritable
        The folder cannot be made or written.
    StoreError
        The file is of another program or of another version of ctlabs.

    A damaged file is moved aside under a name of its own, and a new one begun with what can be read of it; :attr:`notice` then says so in
    one line.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        self.folder = data_folder() if folder is None else Path(folder).expanduser().resolve()
        self.path = self.folder / FILE
        self.notice = ""
        self._held = threading.local()  # the transaction of :meth:`together`
        self._turn = threading.Lock()  # writers of this process wait here rather than in SQLite, which polls
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as why:
            msg = f"{self.folder}: expected a folder for the workbench's data, received {why.strerror or why}"
            raise Unwritable(msg) from None
        writable(self.folder)
        self._engine = _engine(self.path)
        try:
            self._open()
        except BaseException:
            self._engine.dispose()
            raise

    def close(self) -> None:
        """Close all connections; the file is then a single one."""
        self._engine.dispose()

    # Drafts ----------------------------------------------------------------------------------------------------------

    def new_draft(
        self, owner: str, session: str, text: str = "", *, label: str = "", notes: Mapping[str, Any] | None = None
    ) -> Draft:
        """Begin a draft with its revision 0."""
        _short(text)
        draft = Draft(secrets.token_hex(8), owner, session, 0, text, time.time(), dict(notes or {}))
        with self._writing() as write:
            write.execute(
                _drafts.insert().values(
                    id=draft.id,
                    owner=owner,
                    session=session,
                    number=0,
                    notes=json.dumps(draft.notes),
                    updated=draft.updated,
                )
            )
            write.execute(_revisions.insert().values(draft=draft.id, number=0, label=label, text=text))
        return draft

    def draft(self, draft: str, owner: str | None = None) -> Draft | None:
        """The draft with this id, deleted or not; ``None`` if there is none, or if it is another owner's."""
        with self._reading() as read:
            row = read.execute(_WITH_TEXT.where(_drafts.c.id == draft)).first()
        found = None if row is None else _draft(row)
        return found if found is None or owner in {None, found.owner} else None

    def drafts(self, owner: str, session: str | None = None, *, limit: int = 50) -> list[Draft]:
        """The drafts of an owner, or of one of the owner's sessions, the latest first."""
        query = _WITH_TEXT.where(_drafts.c.owner == owner, _drafts.c.deleted.is_(None))
        if session is not None:
            query = query.where(_drafts.c.session == session)
        with self._reading() as read:
            return [_draft(row) for row in read.execute(query.order_by(_drafts.c.updated.desc()).limit(limit))]

    def edit(
        self,
        draft: str,
        text: str,
        label: str = "",
        *,
        after: int | None = None,
        notes: Mapping[str, Any] | None = None,
    ) -> int:
        """Add a revision after the present one and drop those ahead of it; its number. ``notes`` are merged.

        ``after`` : the revision that the caller believes to be the present one; ``ValueError`` if another one is.
        """
        _short(text)
        with self._writing() as write:
            now = self._now(write, draft)
            _expected(after, now.number)
            number = now.number + 1
            mine = _revisions.c.draft == draft
            write.execute(
                _revisions.delete().where(
                    mine, (_revisions.c.number > now.number) | (_revisions.c.number <= number - REVISIONS)
                )
            )
            write.execute(_revisions.insert().values(draft=draft, number=number, label=label, text=text))
            self._set(write, now, number, notes)
        return number

    def move(self, draft: str, number: int, *, after: int | None = None) -> str:
        """Make another revision the present one (undo, redo); its text. ``after`` as for :meth:`edit`."""
        with self._writing() as write:
            now = self._now(write, draft)
            _expected(after, now.number)
            wanted = _revisions.c.draft == draft, _revisions.c.number == number
            text: str | None = write.execute(sa.select(_revisions.c.text).where(*wanted)).scalar()
            if text is None:
                msg = f"draft {draft}: expected one of its revisions, received number {number}"
                raise LookupError(msg)
            self._set(write, now, number, None)
        return text

    def history(self, draft: str) -> list[Revision]:
        """All revisions in order, those ahead of the present one too."""
        query = sa.select(_revisions.c.number, _revisions.c.label, _revisions.c.text)
        query = query.where(_revisions.c.draft == draft).order_by(_revisions.c.number)
        with self._reading() as read:
            return [Revision(*row) for row in read.execute(query)]

    def note(self, draft: str, **notes: Any) -> None:
        """Merge something the pages remember about a draft (settings of its experiment, open panels, its name)."""
        with self._writing() as write:
            now = self._now(write, draft)
            self._set(write, now, now.number, notes)

    def delete_draft(self, draft: str, *, undo: bool = False) -> None:
        """Take a draft out of the list, or put it back (``undo``)."""
        self._mark(_drafts, draft, undo)

    # Experiments -----------------------------------------------------------------------------------------------------

    def keep(
        self,
        owner: str,
        name: str,
        model: str,
        settings: Mapping[str, Any],
        seed: int,
        results: Any,
    ) -> int:
        """Keep an experiment; its number. ``results`` may nest dicts, lists, numbers, strings and numeric arrays."""
        values = {
            "owner": owner,
            "created": time.time(),
            "name": name,
            "model": model,
            "settings": json.dumps(dict(settings)),
            "seed": seed,
            "results": pack(results),
        }
        with self._writing() as write:
            key = write.execute(_experiments.insert().values(values)).inserted_primary_key
        return int(key[0]) if key is not None else 0

    def experiments(self, owner: str, *, deleted: bool = False, limit: int = 1000) -> list[KeptExperiment]:
        """An owner's experiments, the latest first; ``deleted``: those that can still be put back."""
        mark = _experiments.c.deleted
        query = _SUMMARY.where(_experiments.c.owner == owner, mark.is_not(None) if deleted else mark.is_(None))
        with self._reading() as read:
            return [_experiment(row) for row in read.execute(query.order_by(_experiments.c.id.desc()).limit(limit))]

    def experiment(self, number: int, owner: str | None = None) -> KeptExperiment | None:
        """The experiment with this number, deleted or not; ``None`` if there is none, or if it is another owner's."""
        with self._reading() as read:
            row = read.execute(_SUMMARY.where(_experiments.c.id == number)).first()
        found = None if row is None else _experiment(row)
        return found if found is None or owner in {None, found.owner} else None

    def results(self, number: int) -> Any:
        """The results as they were given: arrays equal to the bit, tuples as lists."""
        with self._reading() as read:
            text = read.execute(sa.select(_experiments.c.results).where(_experiments.c.id == number)).scalar()
        if text is None:
            msg = f"experiment {number}: expected one that is kept, received an unknown number"
            raise LookupError(msg)
        return unpack(text)

    def rename(self, number: int, name: str) -> None:
        """Give an experiment another name."""
        with self._writing() as write:
            write.execute(_experiments.update().where(_experiments.c.id == number).values(name=name))

    def delete(self, number: int, *, undo: bool = False) -> None:
        """Take an experiment out of the list, or put it back (``undo``)."""
        self._mark(_experiments, number, undo)

    # Long texts ------------------------------------------------------------------------------------------------------

    def put(self, text: str) -> str:
        """Keep a long text once, however often notes and settings name it; its key."""
        key = hashlib.sha256(text.encode()).hexdigest()
        with self._writing() as write:
            if write.execute(sa.select(_texts.c.key).where(_texts.c.key == key)).first() is None:
                write.execute(_texts.insert().values(key=key, text=text))
        return key

    def text(self, key: str) -> str:
        """The text with this key."""
        with self._reading() as read:
            found: str | None = read.execute(sa.select(_texts.c.text).where(_texts.c.key == key)).scalar()
        if found is None:
            msg = f"text {key[:8]}: expected one that is kept, received an unknown key"
            raise LookupError(msg)
        return found

    # Within ----------------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        aside = None
        try:
            with self._reading() as read:
                found = _look(read)
        except _Damaged as why:
            aside = self._move_aside(str(why))
            found = (0, 0, 0)
        application, version, tables = found
        if tables and application != APPLICATION:
            msg = f"{self.path}: expected a file of the workbench, received another program's database"
            raise StoreError(msg)
        if tables and version != SCHEMA:
            newer = "a newer ctlabs wrote it: update ctlabs" if version > SCHEMA else "it is too old to be read"
            msg = f"{self.path}: expected tables of version {SCHEMA}, received {version} ({newer}, or choose another folder with --data)"
            raise StoreError(msg)
        with self._writing() as write:
            _tables.create_all(write)  # those that are not there
            if not tables:
                write.exec_driver_sql(f"PRAGMA application_id = {APPLICATION}")
                write.exec_driver_sql(f"PRAGMA user_version = {SCHEMA}")
        if aside is not None:
            self._salvage(aside)
        with self._writing() as write:
            self._forget(write, time.time())

    def _salvage(self, aside: Path) -> None:
        """Take over what can still be read of a file that was moved aside, and say how much that is."""
        with tempfile.TemporaryDirectory(prefix="ctlabs-") as folder:
            Store(folder).close()
            columns = {table.name: list(table.columns.keys()) for table in _tables.sorted_tables}
            saved = salvage(aside, Path(folder) / FILE, columns)
        with self._writing() as write:
            for table in _tables.sorted_tables:  # drafts before their steps
                for row in saved.rows[table.name]:
                    write.execute(table.insert().prefix_with("OR IGNORE"), row)
        self.notice += f"; {saved}"

    def _move_aside(self, why: str) -> Path:
        """Put a damaged file, with what SQLite keeps beside it, under another name."""
        self._engine.dispose()
        aside = self.path.with_name(f"{FILE}.damaged-{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(2)}")
        try:
            for suffix in ("", "-wal", "-shm"):
                if (part := Path(f"{self.path}{suffix}")).exists():
                    part.rename(f"{aside}{suffix}")
        except OSError as error:
            msg = (
                f"{self.path}: expected a whole database, received {why}; it could not be moved aside: {error.strerror}"
            )
            raise StoreError(msg) from None
        self.notice = (
            f"{self.path}: expected a whole database, received {why}; it was moved to {aside.name} and a new one begun"
        )
        self._engine = _engine(self.path)
        return aside

    def _forget(self, write: sa.Connection, now: float) -> None:
        """Remove for good what was deleted long ago, drafts that were opened but never edited, texts that none names."""
        for table in (_drafts, _experiments):
            write.execute(table.delete().where(table.c.deleted < now - REMEMBERED))
        edited = sa.select(_revisions.c.draft).where(_revisions.c.number > 0)
        untouched = _drafts.c.id.not_in(edited), _drafts.c.notes == "{}", _drafts.c.updated < now - UNTOUCHED
        write.execute(_drafts.delete().where(*untouched))
        named = [
            sa.exists().where(sa.func.instr(column, _texts.c.key) > 0)
            for column in (_drafts.c.notes, _experiments.c.settings)
        ]
        write.execute(_texts.delete().where(~sa.or_(*named)))

    def _now(self, write: sa.Connection, draft: str) -> Draft:
        row = write.execute(_WITH_TEXT.where(_drafts.c.id == draft)).first()
        if row is None:
            msg = f"draft {draft}: expected one that is kept, received an unknown id"
            raise LookupError(msg)
        return _draft(row)

    def _set(self, write: sa.Connection, now: Draft, number: int, notes: Mapping[str, Any] | None) -> None:
        values: dict[str, Any] = {"number": number, "updated": time.time()}
        if notes:
            values["notes"] = json.dumps({**now.notes, **notes})
        write.execute(_drafts.update().where(_drafts.c.id == now.id).values(values))

    def _mark(self, table: sa.Table, key: str | int, undo: bool) -> None:
        with self._writing() as write:
            done = write.execute(table.update().where(table.c.id == key).values(deleted=None if undo else time.time()))
            if not done.rowcount:
                msg = f"{table.name} {key}: expected one that is kept, received an unknown one"
                raise LookupError(msg)

    @contextmanager
    def together(self) -> Iterator[None]:
        """Make several changes of this thread one: whenever the process ends, all of them are in the file or none."""
        with self._writing() as connection:
            self._held.connection = connection
            try:
                yield
            finally:
                self._held.connection = None

    @contextmanager
    def _reading(self) -> Iterator[sa.Connection]:
        held: sa.Connection | None = getattr(self._held, "connection", None)
        with self._told("read"), self._engine.begin() if held is None else nullcontext(held) as connection:
            yield connection

    @contextmanager
    def _writing(self) -> Iterator[sa.Connection]:
        held: sa.Connection | None = getattr(self._held, "connection", None)
        if held is not None:
            with self._told("written"):
                yield held
            return
        # The lock of SQLite is taken at the beginning: a transaction that reads first could otherwise be refused later.
        with (
            self._told("written"),
            self._turn,
            self._engine.execution_options(begin="BEGIN IMMEDIATE").begin() as connection,
        ):
            yield connection

    @contextmanager
    def _told(self, verb: str) -> Iterator[None]:
        """SQLite's errors in one line, without the statement."""
        try:
            yield
        except sa.exc.DBAPIError as why:
            said = " ".join(str(why.orig).split())
            if _is_damage(said):
                raise _Damaged(said) from why
            msg = f"{self.path}: expected a database that can be {verb}, received: {said}"
            raise (Unwritable if "readonly" in said or "unable to open" in said else StoreError)(msg) from why


class _Damaged(StoreError):
    """What SQLite says of a file that is not whole."""


def _is_damage(said: str) -> bool:
    return "malformed" in said or "not a database" in said


def _look(read: sa.Connection) -> tuple[int, int, int]:
    """Whose file, which version, how many tables; everything in it is read once, so that damage is found now."""
    verdict = read.exec_driver_sql("PRAGMA quick_check(1)").scalar()
    if verdict != "ok":
        msg = " ".join(str(verdict).split())
        raise _Damaged(msg)
    application = read.exec_driver_sql("PRAGMA application_id").scalar()
    version = read.exec_driver_sql("PRAGMA user_version").scalar()
    tables = read.exec_driver_sql("SELECT count(*) FROM sqlite_master").scalar()
    return int(application or 0), int(version or 0), int(tables or 0)


def _engine(path: Path) -> sa.Engine:
    url = sa.URL.create("sqlite", database=str(path))
    # As many connections as are asked for: a reader never waits for another reader.
    engine = sa.create_engine(url, connect_args={"timeout": 2, "check_same_thread": False}, max_overflow=-1)

    @sa.event.listens_for(engine, "connect")
    def _(connection: Any, _record: object) -> None:
        connection.isolation_level = None  # transactions begin where we say, below
        for setting in ("journal_mode = WAL", "synchronous = NORMAL", "foreign_keys = ON"):
            connection.execute(f"PRAGMA {setting}").close()

    @sa.event.listens_for(engine, "begin")
    def _(connection: sa.Connection) -> None:
        connection.exec_driver_sql(connection.get_execution_options().get("begin", "BEGIN"))

    return engine


_WITH_TEXT = sa.select(
    _drafts.c.id,
    _drafts.c.owner,
    _drafts.c.session,
    _drafts.c.number,
    _revisions.c.text,
    _drafts.c.updated,
    _drafts.c.notes,
).join_from(_drafts, _revisions, (_revisions.c.draft == _drafts.c.id) & (_revisions.c.number == _drafts.c.number))
_SUMMARY = sa.select(*(column for column in _experiments.c if column.name != "results"))


def _draft(row: Any) -> Draft:
    values = row._asdict()
    return Draft(**{**values, "notes": json.loads(values["notes"])})


def _experiment(row: Any) -> KeptExperiment:
    values = row._asdict()
    return KeptExperiment(**{**values, "settings": json.loads(values["settings"])})


def _expected(after: int | None, number: int) -> None:
    """Another server on the same folder, or another program, may have this draft too."""
    if after not in {None, number}:
        msg = f"draft: expected revision {after}, received {number} (it was edited elsewhere and has been read again)"
        raise Edited(msg)


def _short(text: str) -> None:
    if len(text) > LONGEST:
        msg = f"model: expected a text of at most {LONGEST} characters, received {len(text)}"
        raise ValueError(msg)
