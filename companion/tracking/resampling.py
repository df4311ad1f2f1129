"""filterpy's systematic resampling, without importing the rest of filterpy.

filterpy's ``__init__`` imports all its filters, and with them ``scipy.stats``. That takes half a second and
71 MB at the start of a service that needs one function. An import with the first track would delay the event
loop in flight. This module therefore finds the installed filterpy and runs the one file with the function,
which needs only NumPy.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray

_FILE = "monte_carlo/resampling.py"


def _load_function() -> Callable[[FloatArray], NDArray[np.intp]]:
    """Return the function that draws N indices, shape (N,), by normalised weights, shape (N,)."""
    package = importlib.util.find_spec("filterpy")
    folders = [] if package is None else package.submodule_search_locations or []
    for folder in folders:
        spec = importlib.util.spec_from_file_location("filterpy_resampling", Path(folder) / _FILE)
        if spec is not None and spec.loader is not None:
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            return module.systematic_resample  # type: ignore[no-any-return]
    raise ModuleNotFoundError(f"filterpy, or its {_FILE}, is not installed", name="filterpy")


systematic_resample = _load_function()
