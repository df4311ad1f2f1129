"""Where the aircraft is, and where the moving threats are: estimates from what the link tells.

Pure calculation: no input or output, no clock of its own, no chance but from a seeded generator. Knows
``types`` and ``frames`` only.
"""

from companion.tracking.ownship import OwnshipEstimator, OwnshipSettings, predicted
from companion.tracking.particle_filter import FilterSettings, ParticleFilter
from companion.tracking.tracker import Tracker, TrackerSettings

__all__ = [
    "FilterSettings",
    "OwnshipEstimator",
    "OwnshipSettings",
    "ParticleFilter",
    "Tracker",
    "TrackerSettings",
    "predicted",
]
