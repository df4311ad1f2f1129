"""Log formats for people and for programs, on standard error.

Under journald each line begins with its priority in angle brackets, which journald removes (*sd-daemon(3)*),
so that ``journalctl -p warning`` works.
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
    """Format of log lines."""

    TEXT = "text"
    JSON = "json"


ExceptionInfo = tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]

_PRIORITIES = ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_KNOWN = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime"}


class PlainFormatter(logging.Formatter):
    """Formats the message on one line, and a trace below it, without unprintable characters."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Return the line."""
        return printable(record.getMessage())

    def formatException(self, ei: ExceptionInfo) -> str:
        """Return the lines of a trace, whose texts may come from other systems."""
        return "\n".join(map(printable, super().formatException(ei).splitlines()))


class JsonFormatter(PlainFormatter):
    """One JSON object per line: ``time``, ``level``, ``logger``, ``message``, ``trace``, and extra fields."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
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
    """Adds journald's priority to each line of another formatter."""

    def __init__(self, inner: logging.Formatter) -> None:
        super().__init__()
        self._inner = inner

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines."""
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in self._inner.format(record).splitlines())


def set_up(kind: LogKind) -> None:
    """Send the log to standard error."""
    formatter = JsonFormatter() if kind is LogKind.JSON else PlainFormatter()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(PriorityFormatter(formatter) if is_journal() else formatter)
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)


def is_journal() -> bool:
    """Return whether standard error is connected to journald, by device and inode in ``JOURNAL_STREAM``."""
    try:
        status = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
