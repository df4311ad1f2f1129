"""Online safe path planning for fixed-wing aircraft, on a companion computer.

This package holds the command line and the basis of all other packages: time, frames and errors. It imports
nothing from the simulator.

Examples
--------
>>> from companion import fly, load_mission, plan
>>> plan(load_mission("mission_configs/first-flight.yaml"), seed=1).reaches_goal
True
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.offline import fly, load_mission, plan

__all__ = ["__version__", "fly", "load_mission", "plan"]
__version__ = "0.3.0"


def __getattr__(name: str) -> object:
    """Import planning and flying on first access: most programs that import this package need neither."""
    if name in __all__:
        return getattr(importlib.import_module("companion.offline"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
