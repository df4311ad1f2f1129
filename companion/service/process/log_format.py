"""What the service says, for people or for programs; on standard error, as journald likes it.

Under journald each line begins with its priority in angle brackets, which journald takes off again
(*sd-daemon(3)*): ``journalctl -p warning`` then shows what matters.
"""

from __future__ import annotations

import json
import logging
import os
import sys
from datetime import UTC, datetime
from enum import Enum
from types import TracebackType

from companion.plain_text import printable


class LogKind(Enum):
    """How lines look."""

    TEXT = "text"
    JSON = "json"


ExceptionInfo = tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]

_PRIORITIES = ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_KNOWN = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime"}


class PlainFormatter(logging.Formatter):
    """The message on one line and what may follow it, without characters that are none to be read."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Make the line."""
        return printable(record.getMessage())

    def formatException(self, ei: ExceptionInfo) -> str:
        """Make the lines of a trace, which ends in words that may be anybody's."""
        return "\n".join(map(printable, super().formatException(ei).splitlines()))


class JsonFormatter(PlainFormatter):
    """One JSON object a line: ``time``, ``level``, ``logger``, ``message``, ``trace``, and what is added."""

    def format(self, record: logging.LogRecord) -> str:
        """Make the line."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": self.formatMessage(record),
        }
        line |= {key: value for key, value in vars(record).items() if key not in _KNOWN}
        if record.exc_info:
            line["trace"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class PriorityFormatter(logging.Formatter):
    """Puts journald's priority before each line of another formatter's."""

    def __init__(self, inner: logging.Formatter) -> None:
        super().__init__()
        self._inner = inner

    def format(self, record: logging.LogRecord) -> str:
        """Make the lines."""
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in self._inner.format(record).splitlines())


def set_up(kind: LogKind) -> None:
    """Send everything that is said to standard error."""
    formatter = JsonFormatter() if kind is LogKind.JSON else PlainFormatter()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(PriorityFormatter(formatter) if is_journal() else formatter)
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)


def is_journal() -> bool:
    """Whether standard error is journald's, as ``JOURNAL_STREAM`` tells by device and inode."""
    try:
        status = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
