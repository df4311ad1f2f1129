"""Estimates of the aircraft's own state and of the states of other vehicles, from events of the link.

The code only computes: it does no I/O, has no clock, and draws random numbers from seeded generators only. It
imports only ``types`` and ``frames``.
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
