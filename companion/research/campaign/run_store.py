"""Rows of a campaign, one for each run, in a database that stays whole however the program ends.

Each row is written in one step. Whatever ends the program, written rows stay, and unfinished runs are made
again. On a full disk a row is not written at all.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import cast

from companion.errors import ConfigError, RecordError
from companion.research.campaign.campaign_spec import Campaign, Scalar
from companion.research.campaign.engines.finished import Finished
from companion.research.campaign.engines.runners import json_text
from companion.research.campaign.provenance import Provenance
from companion.safe_files import make_folder, open_to_write

DATABASE = "runs.sqlite"
LOCK = "lock"
_BUSY_S = 10.0
_COLUMNS = """
    number INTEGER PRIMARY KEY, mission TEXT, mission_sha256 TEXT, setting TEXT, method TEXT, seed TEXT,
    error TEXT, measures TEXT, paths BLOB,
    commit_id TEXT, version TEXT, machine TEXT, started_utc TEXT, duration_s REAL, attempts INTEGER,
    timings TEXT
"""


@dataclass(frozen=True, slots=True)
class Row:
    """A run as it is stored, without its paths.

    Parameters
    ----------
    number, mission, setting, method, seed
        The run.
    error : str or None
        The reason why it has no measures.
    measures : dict
        All measures, timings included, by name.
    commit, machine : str
        The commit that made it, and the computer.
    """

    number: int
    mission: str
    setting: str
    method: str
    seed: int
    error: str | None
    measures: dict[str, Scalar | None]
    commit: str
    machine: str


class RunStore:
    """The rows of one campaign in a folder.

    Parameters
    ----------
    folder : Path
        The folder.
    connection : sqlite3.Connection
        The open database.
    lock : BufferedWriter, optional
        The file that a writer keeps locked.
    """

    def __init__(
        self, folder: Path, connection: sqlite3.Connection, lock: BufferedWriter | None = None
    ) -> None:
        self._file, self._connection, self._lock = folder / DATABASE, connection, lock

    @classmethod
    def to_write(cls, folder: Path, campaign: Campaign, *, resumes: bool) -> RunStore:
        """Open the rows of a new campaign, or of one that continues.

        Raises
        ------
        ConfigError
            If there are rows and the campaign does not continue, if the rows are another campaign's, or if
            a program writes them now.
        RecordError
            If they cannot be stored there.
        """
        try:
            make_folder(folder)
            lock = cast("BufferedWriter", open_to_write(folder / LOCK))
        except OSError as error:
            raise ConfigError(
                str(folder), None, "--out", error.strerror or str(error), "a folder to write to"
            ) from None
        with contextlib.ExitStack() as undone:
            undone.callback(lock.close)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                found = "a campaign that is running"
                raise ConfigError(str(folder), None, "--out", found, "a folder nobody writes to") from None
            with _database_errors(folder / DATABASE):
                open_to_write(
                    folder / DATABASE, append=True
                ).close()  # Created with our permissions, and through no symlink.
                connection = sqlite3.connect(folder / DATABASE, timeout=_BUSY_S, isolation_level=None)
            store = cls(folder, connection, lock)
            undone.callback(connection.close)
            store._prepare(campaign, resumes=resumes)
            undone.pop_all()
        return store

    @classmethod
    def to_read(cls, folder: Path) -> RunStore:
        """Open existing rows for reading, also while a program writes them.

        Raises
        ------
        ConfigError
            If there are none.
        """
        file = folder / DATABASE
        if not file.is_file():
            raise ConfigError(
                str(folder), None, "FOLDER", "nothing of a campaign", f"a folder with {DATABASE}"
            )
        with _database_errors(file), contextlib.ExitStack() as undone:
            connection = sqlite3.connect(file, timeout=_BUSY_S)
            undone.callback(connection.close)
            store = cls(folder, connection)
            store.identity()
            undone.pop_all()
        return store

    def close(self) -> None:
        """Close the database and release the folder."""
        self._connection.close()
        if self._lock is not None:
            self._lock.close()

    def identity(self) -> dict[str, object]:
        """Return the campaign's identity, see :meth:`Campaign.identity`; empty if there are no rows yet."""
        with _database_errors(self._file):
            rows = self._connection.execute("SELECT value FROM campaign WHERE key = 'identity'").fetchall()
        return cast("dict[str, object]", json.loads(rows[0][0])) if rows else {}

    def texts(self) -> dict[str, str]:
        """Return the mission files' texts, by the missions' names."""
        with _database_errors(self._file):
            rows = self._connection.execute("SELECT value FROM campaign WHERE key = 'missions'").fetchall()
        return cast("dict[str, str]", json.loads(rows[0][0])) if rows else {}

    def numbers(self) -> set[int]:
        """Numbers of the runs that have a row."""
        with _database_errors(self._file):
            return {number for (number,) in self._connection.execute("SELECT number FROM runs")}

    def rows(self) -> Iterator[Row]:
        """All rows, by their numbers."""
        chosen = "number, mission, setting, method, seed, error, measures, timings, commit_id, machine"
        with _database_errors(self._file):
            for row in self._connection.execute(f"SELECT {chosen} FROM runs ORDER BY number"):
                number, mission, setting, method, seed, error, measures, timings, commit, machine = row
                measured = json.loads(measures) | json.loads(timings)
                yield Row(number, mission, setting, method, int(seed), error, measured, commit, machine)

    def add(self, over: Finished, digest: str, provenance: Provenance) -> None:
        """Write one row.

        Raises
        ------
        RecordError
            If the row cannot be written; then nothing is written.
        """
        run, outcome = over.run, over.outcome
        row = (
            run.number, run.mission, digest, run.setting, run.method, str(run.seed),
            outcome.error, outcome.measures, outcome.paths,
            provenance.commit, provenance.version, provenance.machine,
            over.started.isoformat(timespec="milliseconds"), round(over.duration_s, 6), over.attempts,
            outcome.timings,
        )  # fmt: skip
        with _database_errors(self._file):
            self._connection.execute(f"INSERT INTO runs VALUES ({', '.join('?' * len(row))})", row)

    def _prepare(self, campaign: Campaign, *, resumes: bool) -> None:
        """Create the tables, or check that they belong to this campaign."""
        with _database_errors(self._file):
            run = self._connection.execute
            run("PRAGMA journal_mode = WAL")
            run("PRAGMA synchronous = NORMAL")  # A power cut may lose the last rows, and nothing else.
            run("CREATE TABLE IF NOT EXISTS campaign (key TEXT PRIMARY KEY, value TEXT)")
            run(f"CREATE TABLE IF NOT EXISTS runs ({_COLUMNS})")
        there, wanted = self.identity(), json.loads(json_text(campaign.identity()))
        if self.numbers() and not resumes:
            found = f"{len(self.numbers())} rows of '{there.get('name')}'"
            raise ConfigError(str(self._file), None, "--out", found, "an empty folder, or --resume to go on")
        if self.numbers() and there != wanted:
            key = next(key for key in wanted | there if there.get(key) != wanted.get(key))
            found, expected = _short(wanted.get(key)), _short(there.get(key))
            raise ConfigError(
                campaign.file,
                None,
                key,
                found,
                f"{expected}, as the rows in {self._file} have, or another --out",
            )
        with _database_errors(self._file):
            written = (("identity", json_text(wanted)), ("missions", json_text(dict(campaign.texts))))
            self._connection.executemany("INSERT OR REPLACE INTO campaign VALUES (?, ?)", written)


@contextlib.contextmanager
def _database_errors(file: Path) -> Iterator[None]:
    """Raise an error that names what the database cannot do."""
    try:
        yield
    except sqlite3.OperationalError as error:
        advice = ""
        if getattr(error, "sqlite_errorcode", None) in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE):
            advice = "; what was written before is whole: make room, and go on with --resume"
        raise RecordError(f"{file}: {error}{advice}") from None
    except (sqlite3.DatabaseError, OSError) as error:
        raise RecordError(f"{file}: {error}") from None


def _short(value: object) -> str:
    text = json_text(value)
    return text if len(text) <= 60 else text[:59] + "…"
