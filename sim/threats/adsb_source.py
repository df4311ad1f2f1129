"""A surveillance source: noisy reports of threats and of passing aircraft at 1 Hz."""

from __future__ import annotations

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ..autopilot.base import Autopilot
from ..autopilot.channel import Message
from ..projection import FastProjection
from .passing_aircraft import PassingAircraft
from .pursuer import Pursuer
from .pursuers import Pursuers
from .reports import Measured

SOURCE_SYSTEM = 200
SOURCE_COMPONENT = mavlink.MAV_COMP_ID_ADSB
_PERIOD_US = 1_000_000


def send_heartbeat(autopilot: Autopilot) -> None:
    """Send the heartbeat of a surveillance source on all links of an autopilot."""
    beat = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ADSB, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )
    for channel in autopilot.channels:
        channel.send_as(beat, SOURCE_SYSTEM, SOURCE_COMPONENT)


class TrackSource:
    """Reports every pursuer once a second, under a system id of its own.

    Parameters
    ----------
    autopilot : Autopilot
        Autopilot on whose links the reports appear.
    pursuers : list of tuple
        Name and vehicle.
    projection : FastProjection
        Projection of local metres to degrees.
    generator : numpy.random.Generator
        Source of the noise.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        pursuers: Pursuers,
        projection: FastProjection,
        generator: np.random.Generator,
    ) -> None:
        self._autopilot = autopilot
        self._pursuers = pursuers
        self._projection = projection
        self._generator = generator
        self._next_us = 0

    def update(self, now_us: int) -> None:
        """Report if it is time."""
        if now_us < self._next_us or not self._pursuers:
            return
        self._next_us += _PERIOD_US
        reports = [
            self._report(index, name, vehicle)
            for index, (name, vehicle) in enumerate(self._pursuers)
            if vehicle.source.loss == 0.0 or self._generator.random() >= vehicle.source.loss
        ]
        send_heartbeat(self._autopilot)
        for report in reports:
            self._autopilot.relay_traffic(report, (SOURCE_SYSTEM, SOURCE_COMPONENT))

    def _report(self, number: int, name: str, vehicle: Pursuer | PassingAircraft) -> Message:
        noise, source = self._generator.standard_normal(5), vehicle.source
        latitude, longitude = self._projection.degrees(
            vehicle.position[0] + source.position_std_m * float(noise[0]),
            vehicle.position[1] + source.position_std_m * float(noise[1]),
        )
        east, north = vehicle.velocity_m_s
        east += source.velocity_std_m_s * float(noise[2])
        north += source.velocity_std_m_s * float(noise[3])
        altitude = (
            self._projection.frame.altitude_amsl_m + vehicle.up_m + source.height_std_m * float(noise[4])
        )
        return source.message(
            Measured(
                number, name, vehicle.emitter, latitude, longitude, altitude, (east, north, vehicle.climb_m_s)
            )
        )
