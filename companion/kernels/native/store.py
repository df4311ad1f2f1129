"""Compiled code on disk.

The name of a file contains the digest of everything that its code depends on. A file is therefore never
stale, and several checkouts, versions and processes can share the folder. Each file is written completely or
not at all. It begins with the digest of its content, so that a damaged file is noticed and its code compiled
again.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

__all__ = ["Store", "kernel_store"]

DAY_S = 86_400.0
UNUSED_DAYS_MAX = 30.0  # A file that nobody has read for longer is removed.
TOTAL_BYTES_MAX = 200_000_000  # The least recently read files are removed until the rest is smaller.
DIGEST_SIZE = hashlib.sha256().digest_size


class Store:
    """A folder of compiled code.

    Parameters
    ----------
    folder : Path
        An existing folder.
    packed : Path, optional
        A folder that came with the program. It is read where the first has nothing, and never written.
    """

    def __init__(self, folder: Path, packed: Path | None = None) -> None:
        self.folder = folder
        self.packed = packed

    def read(self, name: str) -> bytes | None:
        """Return the content of a file, or None if it is missing or damaged."""
        found = self._read(self.folder / name)
        return self._read(self.packed / name) if found is None and self.packed is not None else found

    @staticmethod
    def _read(path: Path) -> bytes | None:
        try:
            raw, stamp = path.read_bytes(), path.stat().st_mtime
        except OSError:
            return None
        if time.time() - stamp > DAY_S:
            with contextlib.suppress(OSError):
                path.touch()  # The time of the last reading decides what is removed.
        content = raw[DIGEST_SIZE:]
        return content if hashlib.sha256(content).digest() == raw[:DIGEST_SIZE] else None

    def write(self, name: str, content: bytes) -> None:
        """Store a file. Several processes may write the same file at once.

        A full disk or a missing folder is no error: the code is then compiled again the next time.
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
        """Remove files by :data:`UNUSED_DAYS_MAX` and :data:`TOTAL_BYTES_MAX`; return how many.

        Parameters
        ----------
        now_s : float
            The time as :func:`time.time` gives it.
        """
        total = removed = 0
        for stamp, size, path in sorted(self._files(), reverse=True):
            total += size
            if now_s - stamp > UNUSED_DAYS_MAX * DAY_S or total > TOTAL_BYTES_MAX:
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
    """Return the store of the program's kernels.

    It is the folder ``kernels`` in ``NUMBA_CACHE_DIR`` or in the user's cache: the first that can be written
    to, else the first that exists, else a temporary folder of this process. Kernels that an installed package
    brought are read beside it.
    """
    packed = Path(sys.prefix) / "share" / "companion" / "kernels"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    bases = filter(None, [os.environ.get("NUMBA_CACHE_DIR"), os.path.join(home, "safe-rrt-companion")])
    folders = [Path(base) / "kernels" for base in bases]
    for is_fit in (_is_writable, Path.is_dir):
        for folder in folders:
            if is_fit(folder):
                return Store(folder, packed)
    return Store(Path(tempfile.mkdtemp(prefix="safe-rrt-companion-")), packed)


def _is_writable(folder: Path) -> bool:
    """Tell whether the folder exists or can be made, and can be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)
