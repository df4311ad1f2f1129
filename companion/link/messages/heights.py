"""Conversion of reported altitudes to altitudes above mean sea level.

The geoid height comes from the autopilot's GPS_RAW_INT. The offset of pressure altitudes comes from the
autopilot's static pressure and altitude. Until the autopilot reports them, altitudes are used unconverted.

References
----------
MAVLink common.xml: ADSB_ALTITUDE_TYPE, GPS_RAW_INT.alt_ellipsoid, OPEN_DRONE_ID_LOCATION.
ICAO Doc 7488: the standard atmosphere, below 11 km.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

GEOID_MAX_M = 120.0  # WGS 84 geoid heights range from -107 m to +86 m.
# At 3 km, 950 to 1080 hPa at sea level and 50 K too warm or too cold give offsets up to this.
OFFSET_MAX_M = 1_500.0
STANDARD_HPA, SCALE_M, EXPONENT = 1013.25, 44_330.8, 0.190263


class Datum(Enum):
    """Reference of an altitude."""

    SEA_LEVEL = "mean sea level"
    ELLIPSOID = "the WGS 84 ellipsoid"
    PRESSURE = "1013.25 hPa"


@dataclass(frozen=True, slots=True)
class Height:
    """A reported altitude [m] and its reference."""

    value_m: float
    datum: Datum


def pressure_altitude(static_hpa: float) -> float:
    """Return the altitude in the standard atmosphere at which a pressure occurs [m].

    Parameters
    ----------
    static_hpa : float
        Static pressure [hPa].
    """
    return SCALE_M * (1.0 - math.pow(static_hpa / STANDARD_HPA, EXPONENT))


class Heights:
    """Converts altitudes by the present geoid height and pressure offset.

    Attributes
    ----------
    geoid_m : float or None
        Height of mean sea level above the ellipsoid [m].
    pressure_offset_m : float or None
        Altitude above mean sea level minus pressure altitude [m].
    """

    def __init__(self) -> None:
        self.geoid_m: float | None = None
        self.pressure_offset_m: float | None = None
        self._own_m: float | None = None

    def note_fix(self, above_sea_m: float, above_ellipsoid_m: float) -> None:
        """Update the geoid height from a GPS fix; older receivers send 0 as the ellipsoidal altitude."""
        geoid = above_ellipsoid_m - above_sea_m
        if above_ellipsoid_m != 0.0 and abs(geoid) <= GEOID_MAX_M:
            self.geoid_m = geoid

    def note_altitude(self, above_sea_m: float) -> None:
        """Record the altitude of the aircraft."""
        self._own_m = above_sea_m

    def note_pressure(self, static_hpa: float) -> None:
        """Update the pressure offset from the aircraft's barometer; impossible values are ignored."""
        if self._own_m is None or not 100.0 <= static_hpa <= 1_200.0:
            return
        offset = self._own_m - pressure_altitude(static_hpa)
        if abs(offset) <= OFFSET_MAX_M:
            self.pressure_offset_m = offset

    def above_sea_m(self, height: Height) -> float:
        """Return the altitude above mean sea level [m]."""
        if height.datum is Datum.ELLIPSOID:
            return height.value_m - (self.geoid_m or 0.0)
        if height.datum is Datum.PRESSURE:
            return height.value_m + (self.pressure_offset_m or 0.0)
        return height.value_m
