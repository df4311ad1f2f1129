"""Files as the service writes and reads them: never through a symlink, never more than foreseen.

Whoever may write to a folder of the service's may plant a link in it: what is written would then go
wherever the link leads. So nothing is opened through one, what is replaced is replaced whole, and nobody
but the owner reads keys and state. What is read is a plain file of a size that is known before.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

PRIVATE = 0o600  # keys, times, parameters, what a restart needs
SHARED = 0o640  # recordings, logs, reports: the owner's group may read them
FOLDER = 0o750
PART, DAMAGED = ".part", ".damaged"

_SAFE = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK  # the last, lest a pipe in the way hold us up


def make_folder(folder: Path) -> None:
    """Make a folder that others do not look into, with those above it; one that exists stays as it is.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    for entry in reversed([entry for entry in (folder, *folder.parents) if not entry.exists()]):
        entry.mkdir(mode=FOLDER, exist_ok=True)
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))


def open_to_write(path: Path, mode: int = SHARED, *, append: bool = False) -> BinaryIO:
    """Open a file to write to, empty or at its end; a symlink in its place is refused.

    Parameters
    ----------
    path : Path
        The file; made where there is none.
    mode : int
        Permissions of a file that is made.
    append : bool
        Whether what it holds stays.

    Raises
    ------
    OSError
        If it cannot be opened, or is a symlink.
    """
    flags = os.O_WRONLY | os.O_CREAT | _SAFE | (os.O_APPEND if append else os.O_TRUNC)
    return os.fdopen(os.open(path, flags, mode), "ab" if append else "wb")


def replace_file(path: Path, data: bytes, mode: int = PRIVATE, *, is_synced: bool = True) -> None:
    """Write a file whole or not at all; a symlink in its place is replaced, not followed.

    Parameters
    ----------
    path : Path
        The file; its folder is made where there is none.
    data : bytes
        All that it is to hold.
    mode : int
        Permissions that it gets.
    is_synced : bool
        Whether it is on the disk before it replaces the old one. Where that may not be waited for, a power
        cut can leave a damaged file on some file systems.

    Raises
    ------
    OSError
        If it cannot be written; the old one stays then.
    """
    make_folder(path.parent)
    part = path.with_name(path.name + PART)
    part.unlink(missing_ok=True)  # of a process that was killed, or planted
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


def open_to_read(path: Path, *, follow: bool = True) -> BinaryIO:
    """Open a plain file to read from.

    Parameters
    ----------
    path : Path
        The file.
    follow : bool
        Whether a symlink is followed: the operator's own files may be one, ours never are.

    Raises
    ------
    OSError
        If it cannot be opened, or is no plain file: a pipe or a device may never end.
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
    """All that a plain file holds.

    Parameters
    ----------
    path : Path
        The file.
    size_max : int
        More than so many bytes are not read.
    follow : bool
        Whether a symlink is followed: the operator's own files may be one, ours never are.

    Raises
    ------
    OSError
        If it cannot be read, is no plain file (a pipe or a device may never end), or is too large
        (``EFBIG``).
    """
    with open_to_read(path, follow=follow) as file:
        size = os.fstat(file.fileno()).st_size
        # It may grow while it is read, or not have told its size, as those of /proc.
        data = b"" if size > size_max else file.read(size_max + 1)
    if size > size_max or len(data) > size_max:
        raise OSError(errno.EFBIG, f"More than {size_max} bytes", str(path))
    return data


def set_aside(path: Path) -> Path | None:
    """Rename a damaged file, so that it can be looked at and is not met again; its new name, if that went."""
    aside = path.with_name(path.name + DAMAGED)
    try:
        path.replace(aside)
    except OSError:
        return None
    return aside
