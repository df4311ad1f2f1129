"""What is compiled, kept on disk under names that are made of its content's origin.

A file's name carries the digest of all that its code depends on, so that no file is ever stale and several
checkouts, versions and processes can share one folder. Files are written whole or not at all, and begin with the
digest of what follows: what a loss of power left behind is compiled again.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

__all__ = ["Store", "kernel_store"]

DAY_S = 86_400.0
UNUSED_DAYS, TOTAL_MAX = 30.0, 200_000_000  # what was not read for so long goes, and what is more than that
DIGEST = hashlib.sha256().digest_size


class Store:
    """A folder of such files.

    Parameters
    ----------
    folder : Path
        It is there and can be written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def has(self, name: str) -> bool:
        """Whether a file is there; what is in it was not looked at."""
        return (self.folder / name).exists()

    def read(self, name: str) -> bytes | None:
        """A file's content; None where it is missing or damaged."""
        path = self.folder / name
        try:
            raw = path.read_bytes()
            if time.time() - path.stat().st_mtime > DAY_S:
                path.touch()  # whoever prunes sees by that what is in use
        except OSError:
            return None
        content = raw[DIGEST:]
        return content if hashlib.sha256(content).digest() == raw[:DIGEST] else None

    def write(self, name: str, content: bytes) -> None:
        """Keep a file; several processes may write the same one at once.

        Where the disk is full or the folder gone, nothing is kept: it is compiled again the next time.
        """
        with contextlib.suppress(OSError):
            handle, temporary = tempfile.mkstemp(prefix=".", dir=self.folder)
            try:
                with open(handle, "wb") as file:
                    file.write(hashlib.sha256(content).digest() + content)
                os.replace(temporary, self.folder / name)
            except OSError:
                os.unlink(temporary)

    def prune(self, now_s: float) -> int:
        """Remove what was not read for :data:`UNUSED_DAYS`, and the oldest beyond :data:`TOTAL_MAX` bytes.

        Returns how many files went. ``now_s`` as of :func:`time.time`.
        """
        total = removed = 0
        for stamp, size, path in sorted(self._files(), reverse=True):
            total += size
            if now_s - stamp > UNUSED_DAYS * DAY_S or total > TOTAL_MAX:
                path.unlink(missing_ok=True)
                removed += 1
        return removed

    def _files(self) -> Iterator[tuple[float, int, Path]]:
        for path in self.folder.iterdir():
            with contextlib.suppress(OSError):
                about = path.stat()
                yield about.st_mtime, about.st_size, path


@cache
def kernel_store() -> Store:
    """Where kernels are kept: under ``NUMBA_CACHE_DIR``, else the user's cache, else a temporary folder."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    for base in (os.environ.get("NUMBA_CACHE_DIR"), os.path.join(home, "safe-rrt-companion")):
        folder = Path(base) / "kernels" if base else None
        if folder is not None and _is_writable(folder):
            return Store(folder)
    return Store(Path(tempfile.mkdtemp(prefix="safe-rrt-companion-")))


def _is_writable(folder: Path) -> bool:
    """Whether the folder exists or can be made, and written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)
