"""Coordinate frames, airspeeds, and their conversions, which exist only here.

- *Local*: east, north, up in metres from the mission file's origin (a WGS84 point); up is relative
  to the origin's altitude above mean sea level. All of the program uses this frame.
- *Global*: WGS84 latitude and longitude in degrees, altitude in metres above mean sea level.
- *Course*: radians clockwise from north, in [0, 2π), at every interface (files, messages, reports).
- *Direction*: radians counter-clockwise from east, the paper's θ; in planning and kernels only.
- *True airspeed* everywhere but in what autopilots command and report, which is the *equivalent airspeed*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pyproj import Transformer

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

TRANSFORMERS_MAX = 16
M_PER_E7 = 0.011131884502145034  # ArduPilot's length of 1e-7 degrees of latitude.
SCALE_MIN = 0.01  # ArduPilot's least ratio of a degree of longitude to one of latitude.


@dataclass(frozen=True)
class LocalFrame:
    """Tangent frame at a WGS84 origin.

    An azimuthal equidistant projection: distances from the origin are exact, and within 10 km of
    it lengths are true to better than 1 part in 10⁶ (Snyder, *Map Projections*, USGS PP 1395, p. 191).

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Origin, WGS84.
    altitude_amsl_m : float
        Altitude of the origin above mean sea level.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float

    @property
    def crs(self) -> str:
        """East and north as a coordinate system of PROJ."""
        origin = f"+lat_0={self.latitude_deg!r} +lon_0={self.longitude_deg!r}"
        return f"+proj=aeqd {origin} +datum=WGS84 +units=m +type=crs"

    @cached_property
    def _transformer(self) -> Transformer:
        from pyproj import CRS, Transformer  # Many commands never leave the local frame.  # noqa: PLC0415

        local = CRS.from_proj4(
            f"+proj=aeqd +lat_0={self.latitude_deg!r} +lon_0={self.longitude_deg!r} +ellps=WGS84 +units=m"
        )
        return Transformer.from_crs(CRS.from_epsg(4979), local, always_xy=True)

    def transformer_to(self, crs: str) -> Transformer:
        """Return the transformation of local east and north to ``crs``, in any form that PROJ reads."""
        return transformer_between(self.crs, crs)

    def local_from_global(
        self, latitude_deg: float, longitude_deg: float, altitude_amsl_m: float
    ) -> tuple[float, float, float]:
        """Return east, north and up [m] of a WGS84 point."""
        east, north = self._transformer.transform(longitude_deg, latitude_deg)
        return float(east), float(north), altitude_amsl_m - self.altitude_amsl_m

    def global_from_local(self, east_m: float, north_m: float, up_m: float) -> tuple[float, float, float]:
        """Return latitude [deg], longitude [deg] and altitude above mean sea level [m] of a local point."""
        longitude, latitude = self._transformer.transform(east_m, north_m, direction="INVERSE")
        return float(latitude), float(longitude), up_m + self.altitude_amsl_m

    def places_from_global(
        self, latitude_deg: FloatArray, longitude_deg: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return east and north of n WGS84 points [m], each of shape (n,).

        Parameters
        ----------
        latitude_deg, longitude_deg : ndarray, shape (n,)
            WGS84 coordinates of the points [deg].

        Returns
        -------
        east_m, north_m : ndarray, shape (n,)
            Local points [m].
        """
        east, north = self._transformer.transform(longitude_deg, latitude_deg)
        return np.asarray(east), np.asarray(north)

    def places_from_local(self, east_m: FloatArray, north_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return latitudes and longitudes of n local points [deg], each of shape (n,).

        Parameters
        ----------
        east_m, north_m : ndarray, shape (n,)
            Local points [m].

        Returns
        -------
        latitude_deg, longitude_deg : ndarray, shape (n,)
            WGS84 coordinates of the points [deg].
        """
        longitude, latitude = self._transformer.transform(east_m, north_m, direction="INVERSE")
        return np.asarray(latitude), np.asarray(longitude)


@lru_cache(maxsize=TRANSFORMERS_MAX)
def transformer_between(source: str, target: str) -> Transformer:
    """Return the transformation between coordinate systems in any form of PROJ; east comes before north."""
    from pyproj import Transformer  # Only a map needs it, and its import takes long.  # noqa: PLC0415

    return Transformer.from_crs(source, target, always_xy=True)


def longitude_scale(latitude_deg: FloatArray) -> FloatArray:
    """Return the ratio of a degree of longitude to one of latitude, as ArduPilot's ``Location`` does.

    Parameters
    ----------
    latitude_deg : ndarray, shape (N,)
        Latitudes [deg].

    Returns
    -------
    ndarray, shape (N,)
        Ratios.
    """
    return np.asarray(np.maximum(np.cos(np.radians(latitude_deg)), SCALE_MIN))


def offset_places(
    latitude_deg: float, longitude_deg: float, north_m: NDArray[Any], east_m: NDArray[Any]
) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes [deg], each of shape (N,), as ArduPilot's ``offset_latlng`` does.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        The place from which distances count [deg].
    north_m, east_m : ndarray, shape (N,)
        Distances to the north and east [m].

    Returns
    -------
    latitude_deg, longitude_deg : ndarray, shape (N,)
        WGS84 coordinates of the places [deg].
    """
    latitude = latitude_deg + 1e-7 * north_m / M_PER_E7
    scale = longitude_scale(0.5 * (latitude_deg + latitude))
    return latitude, longitude_deg + 1e-7 * east_m / (M_PER_E7 * scale)


def course_from_direction(direction_rad: float) -> float:
    """Return the course (clockwise from north) of a direction (counter-clockwise from east) [rad]."""
    course = (0.5 * math.pi - direction_rad) % (2.0 * math.pi)
    # The remainder of a tiny negative angle is rounded to 2π.
    return 0.0 if course >= 2.0 * math.pi else course


def direction_from_course(course_rad: float) -> float:
    """Return the direction in (-π, π] of a course [rad]."""
    return wrapped_angle(0.5 * math.pi - course_rad)


def speed_made_good(course_rad: float, airspeed_m_s: float, wind_enu_m_s: tuple[float, float]) -> float:
    """Return the speed over the ground on a course in wind, by the wind triangle; at least 1 m/s.

    Parameters
    ----------
    course_rad : float
        Course clockwise from north [rad].
    airspeed_m_s : float
        Horizontal part of the airspeed [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    east, north = math.sin(course_rad), math.cos(course_rad)
    along = wind_enu_m_s[0] * east + wind_enu_m_s[1] * north
    across = wind_enu_m_s[0] * north - wind_enu_m_s[1] * east
    return max(along + math.sqrt(max(airspeed_m_s**2 - across**2, 0.0)), 1.0)


def wrapped_angle(angle_rad: float) -> float:
    """Return the angle in (-π, π] [rad]."""
    wrapped = math.remainder(angle_rad, 2.0 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


def equivalent_airspeed(true_airspeed_m_s: float, altitude_amsl_m: float) -> float:
    """Return the equivalent airspeed, which autopilots command, of a true airspeed [m/s].

    The density is that of the International Standard Atmosphere.
    """
    return true_airspeed_m_s * math.sqrt(density_ratio(altitude_amsl_m))


def true_airspeed(equivalent_airspeed_m_s: float, altitude_amsl_m: float) -> float:
    """Return the true airspeed of an equivalent airspeed [m/s]; see :func:`equivalent_airspeed`."""
    return equivalent_airspeed_m_s / math.sqrt(density_ratio(altitude_amsl_m))


def density_ratio(altitude_amsl_m: float) -> float:
    """Return the air density divided by that at sea level, by the International Standard Atmosphere.

    ISO 2533, troposphere.
    """
    return float((1.0 - 2.25577e-5 * altitude_amsl_m) ** 4.25588)
