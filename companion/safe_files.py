"""File access of the service: no symlinks are followed for writing, and reads have a size limit.

Another user who may write to a folder of the service may place a symlink in it, and data would be written to
the link's target. Therefore files are not opened through symlinks and are replaced as a whole, and only the
owner may read keys and state. Only regular files of a limited size are read.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

PRIVATE = 0o600  # Keys, timestamps, parameters, and state for a restart.
SHARED = 0o640  # Recordings, logs and reports: the owner's group may read them.
FOLDER = 0o750
PART, DAMAGED = ".part", ".damaged"

_SAFE = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK  # Without O_NONBLOCK, opening a named pipe would block.


def make_folder(folder: Path) -> None:
    """Create a folder that other users cannot read, and its parents; an existing one is not changed.

    Raises
    ------
    OSError
        If it cannot be created.
    """
    for entry in reversed([entry for entry in (folder, *folder.parents) if not entry.exists()]):
        entry.mkdir(mode=FOLDER, exist_ok=True)
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))


def open_to_write(path: Path, mode: int = SHARED, *, append: bool = False) -> BinaryIO:
    """Open a file for writing, empty or at its end; refuses a symlink.

    Parameters
    ----------
    path : Path
        The file; created if missing.
    mode : int
        Permissions of a new file.
    append : bool
        True to keep the present content.

    Raises
    ------
    OSError
        If it cannot be opened, or is a symlink.
    """
    flags = os.O_WRONLY | os.O_CREAT | _SAFE | (os.O_APPEND if append else os.O_TRUNC)
    return os.fdopen(os.open(path, flags, mode), "ab" if append else "wb")


def replace_file(path: Path, data: bytes, mode: int = PRIVATE, *, is_synced: bool = True) -> None:
    """Write a file completely or not at all; replaces a symlink instead of following it.

    Parameters
    ----------
    path : Path
        The file; its folder is created if missing.
    data : bytes
        New content.
    mode : int
        Permissions of the file.
    is_synced : bool
        True to write the data to the disk before the old file is replaced. Without it, a power cut can leave
        a damaged file on some file systems.

    Raises
    ------
    OSError
        If it cannot be written; the old file is then kept.
    """
    make_folder(path.parent)
    part = path.with_name(path.name + PART)
    part.unlink(missing_ok=True)  # It was left by a killed process, or placed by another user.
    try:
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _SAFE, mode), "wb") as file:
            file.write(data)
            if is_synced:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise


class StateFile:
    """A file that a program replaces or deletes as it goes on.

    A disk that others write to may take seconds. In a service that would delay its heartbeats, so there each
    content is written in a thread; of several that wait only the newest. A program that ends waits for them.

    Parameters
    ----------
    path : Path
        The file.
    failed : callable
        Called with the error if the file cannot be written or deleted.
    is_threaded : bool
        Whether files are written in threads.
    """

    def __init__(self, path: Path, failed: Callable[[OSError], None], *, is_threaded: bool = False) -> None:
        self.path = path
        self._failed, self._is_threaded = failed, is_threaded
        self._lock, self._newest = threading.Lock(), b""
        self._thread: threading.Thread | None = None

    def replace(self, data: bytes) -> None:
        """Write the file completely or not at all; without ``data`` it is deleted."""
        self._newest = data
        if self._is_threaded:
            self._thread = threading.Thread(target=self._carry_out, args=(data,), name=self.path.name)
            self._thread.start()
        else:
            self._carry_out(data)

    def wait(self) -> None:
        """Wait until the newest content is written."""
        if self._thread is not None:
            self._thread.join()

    def _carry_out(self, data: bytes) -> None:
        with self._lock:
            if data is not self._newest:
                return
            try:
                if data:
                    replace_file(self.path, data)
                else:
                    self.path.unlink(missing_ok=True)
            except OSError as error:
                self._failed(error)


def open_to_read(path: Path, *, follow: bool = True) -> BinaryIO:
    """Open a regular file for reading.

    Parameters
    ----------
    path : Path
        The file.
    follow : bool
        True to follow a symlink: the operator's files may be symlinks, ours never are.

    Raises
    ------
    OSError
        If it cannot be opened, or is not a regular file: a pipe or a device may never end.
    """
    descriptor = os.open(path, os.O_RDONLY | (_SAFE & ~os.O_NOFOLLOW if follow else _SAFE))
    try:
        status = os.fstat(descriptor)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "Not a plain file", str(path))
    except OSError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


def read_file(path: Path, size_max: int, *, follow: bool = False) -> bytes:
    """Read a regular file completely.

    Parameters
    ----------
    path : Path
        The file.
    size_max : int
        Maximum number of bytes.
    follow : bool
        True to follow a symlink: the operator's files may be symlinks, ours never are.

    Raises
    ------
    OSError
        If it cannot be read, is not a regular file (a pipe or a device may never end), or is too large
        (``EFBIG``).
    """
    with open_to_read(path, follow=follow) as file:
        size = os.fstat(file.fileno()).st_size
        # The file may grow meanwhile, or report no size, like the files of /proc.
        data = b"" if size > size_max else file.read(size_max + 1)
    if size > size_max or len(data) > size_max:
        raise OSError(errno.EFBIG, f"More than {size_max} bytes", str(path))
    return data


def rename_damaged(path: Path) -> Path | None:
    """Rename a damaged file, so that it is kept but not read again; returns the new name if that succeeds."""
    renamed = path.with_name(path.name + DAMAGED)
    try:
        path.replace(renamed)
    except OSError:
        return None
    return renamed
