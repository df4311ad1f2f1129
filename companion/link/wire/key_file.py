"""Reads the secret key from a file that no other user can have read or replaced."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from companion.errors import ConfigError
from companion.safe_files import read_file

KEY_BYTES = 32
_SIZE_MAX = 1_000  # A larger file is no key. Smaller wrong files are read, to report their size.
_LINKS_MAX = 40  # The kernel follows the same number of symlinks.
_PLACE = "link.signing.key_file"


def read_key(path: Path) -> bytes:
    """Read a key of 32 bytes, or of 64 hexadecimal digits.

    A symlink is followed if every folder and link on its path is as safe as the folders of the file.

    Raises
    ------
    ConfigError
        If the file cannot be read, if another user may read, write or replace it, or if it holds no key.
    """
    try:
        safe = _resolved(path)
        status = safe.stat()
        if not _is_owned_by_us(status):
            raise _refusal(path, f"a file of user {status.st_uid}'s", "one of the service's user or of root")
        if stat.S_IMODE(status.st_mode) & 0o077:
            found = f"mode {stat.S_IMODE(status.st_mode):04o}"
            raise _refusal(path, found, "mode 0600: the owner's alone")
        data = read_file(safe, _SIZE_MAX)
    except OSError as error:
        raise _refusal(path, (error.strerror or str(error)).lower(), "a key file") from None
    key = data if len(data) == KEY_BYTES else _key_of_digits(data)
    if len(key) != KEY_BYTES:
        raise _refusal(path, f"{len(data)} bytes", "32 bytes, or 64 hexadecimal digits")
    return key


def _key_of_digits(data: bytes) -> bytes:
    try:
        return bytes.fromhex(data.decode("ascii").strip())
    except ValueError:
        return b""


def _resolved(path: Path) -> Path:
    """Resolve symlinks, and check that nobody else can change any of them."""
    place = Path(os.path.abspath(path))
    for _ in range(_LINKS_MAX):
        link = next((part for part in [*reversed(place.parents), place] if part.is_symlink()), None)
        _check_folders(path, (link or place).parent)
        if link is None:
            return place
        place = Path(os.path.normpath(link.parent / link.readlink() / place.relative_to(link)))
    raise _refusal(path, "too many symlinks", "a key file")


def _check_folders(path: Path, folder: Path) -> None:
    """Check that nobody else can replace an entry of the folder or of a folder above it."""
    for entry in (folder, *folder.parents):
        status = entry.stat()
        # In a folder with the sticky bit, such as /tmp, other users can replace only their own files.
        is_open = status.st_mode & 0o022 and not status.st_mode & stat.S_ISVTX
        if is_open or not _is_owned_by_us(status):
            found = f"{entry}, mode {stat.S_IMODE(status.st_mode):04o} of user {status.st_uid}'s, on the way"
            raise _refusal(path, found, "folders that nobody else may write to")


def _is_owned_by_us(status: os.stat_result) -> bool:
    return status.st_uid in (os.geteuid(), 0)


def _refusal(path: Path, found: str, expected: str) -> ConfigError:
    return ConfigError(str(path), None, _PLACE, found, expected)
