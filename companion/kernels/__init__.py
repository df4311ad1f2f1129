"""Numba kernels: floats and C-contiguous float64 arrays in SI and radians, status codes out.

Compiled code is cached, and numba checks no more than the file a kernel stands in: after a change to
a kernel that others call, the callers would go on running the old one. The cache therefore lies in
a folder named by the digest of all kernels' sources, so that an upgrade never flies stale code.
"""

import hashlib
import os
import tempfile
from pathlib import Path

import numba

__all__: list[str] = []


def _cache_folder() -> Path:
    """Folder for these sources: under ``NUMBA_CACHE_DIR``, else the user's cache, else a temporary one."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    for base in (os.environ.get("NUMBA_CACHE_DIR"), os.path.join(home, "safe-rrt-companion")):
        folder = Path(base) / name if base else None
        if folder is not None and _is_writable(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="safe-rrt-companion-"))


def _is_writable(folder: Path) -> bool:
    """Whether the folder exists or can be made, and written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


numba.config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]
