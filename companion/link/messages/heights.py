"""What a told altitude counts from, and what it comes to above mean sea level.

The geoid's height is the autopilot's own, of GPS_RAW_INT; how far pressure altitudes are off today follows
from its own static pressure and its own height. Until either was told, the altitude is taken as it stands.

References
----------
MAVLink common.xml: ADSB_ALTITUDE_TYPE, GPS_RAW_INT.alt_ellipsoid, OPEN_DRONE_ID_LOCATION.
ICAO Doc 7488: the standard atmosphere, below 11 km.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

GEOID_MAX_M = 120.0  # WGS 84: from -107 m to +86 m
OFFSET_MAX_M = 1_500.0  # of pressure altitudes: 950 to 1080 hPa, and 50 K, at 3 km
STANDARD_HPA, SCALE_M, EXPONENT = 1013.25, 44_330.8, 0.190263


class Datum(Enum):
    """What an altitude counts from."""

    SEA_LEVEL = "mean sea level"
    ELLIPSOID = "the WGS 84 ellipsoid"
    PRESSURE = "1013.25 hPa"


@dataclass(frozen=True, slots=True)
class Height:
    """An altitude as it was told [m], and what it counts from."""

    value_m: float
    datum: Datum


def pressure_altitude(static_hpa: float) -> float:
    """Altitude in the standard atmosphere at which there is such a pressure [m].

    Parameters
    ----------
    static_hpa : float
        Static pressure.
    """
    return SCALE_M * (1.0 - math.pow(static_hpa / STANDARD_HPA, EXPONENT))


class Heights:
    """Knows where mean sea level is to the ellipsoid and to the pressure of today, here.

    Attributes
    ----------
    geoid_m : float or None
        Height of mean sea level above the ellipsoid [m].
    pressure_offset_m : float or None
        What is added to a pressure altitude for that above mean sea level [m].
    """

    def __init__(self) -> None:
        self.geoid_m: float | None = None
        self.pressure_offset_m: float | None = None
        self._own_m: float | None = None

    def note_fix(self, above_sea_m: float, above_ellipsoid_m: float) -> None:
        """The receiver tells its altitude twice; 0 above the ellipsoid is what older ones send."""
        geoid = above_ellipsoid_m - above_sea_m
        if above_ellipsoid_m != 0.0 and abs(geoid) <= GEOID_MAX_M:
            self.geoid_m = geoid

    def note_own(self, above_sea_m: float) -> None:
        """Where the aircraft is."""
        self._own_m = above_sea_m

    def note_pressure(self, static_hpa: float) -> None:
        """What its barometer measures; what no flight meets is not believed."""
        if self._own_m is None or not 100.0 <= static_hpa <= 1_200.0:
            return
        offset = self._own_m - pressure_altitude(static_hpa)
        if abs(offset) <= OFFSET_MAX_M:
            self.pressure_offset_m = offset

    def above_sea_m(self, height: Height) -> float:
        """The altitude above mean sea level [m]."""
        if height.datum is Datum.ELLIPSOID:
            return height.value_m - (self.geoid_m or 0.0)
        if height.datum is Datum.PRESSURE:
            return height.value_m + (self.pressure_offset_m or 0.0)
        return height.value_m
