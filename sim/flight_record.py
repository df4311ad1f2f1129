"""The record of a simulated flight, for the report."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.types.record import FlightRecord
from .sitl import Flight


def record_of(flight: Flight) -> FlightRecord:
    """Return the record for the report, with the true paths in place of those known on board."""
    truth, measures = flight.simulator.truth, flight.measures()
    return replace(
        flight.recorder.record(flight.summary()),
        flown=np.array(truth.path),
        dt_paths=tuple(np.array(rows) for rows in truth.threat_paths.values()),
        encounters=measures.dynamic_threats + measures.radars,
    )
