"""The aircraft's own state, composed from the autopilot's telemetry.

The autopilot's estimator has already filtered position and velocity. This module converts them to the local
frame, extrapolates them to the requested instant, and adds the contents of other messages.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import astuple, dataclass, replace
from typing import TypeVar

from companion.frames import LocalFrame, true_airspeed, wrapped_angle
from companion.tracking.position_integrity import PositionIntegrity
from companion.types.events import (
    AirData,
    Attitude,
    EstimatorAccuracy,
    EstimatorHealth,
    Event,
    GlobalPosition,
    WindEstimate,
)
from companion.types.state import Ownship

GRAVITY_M_S2 = 9.80665
BANK_MAX_RAD = math.radians(75.0)
TURN_RATE_MIN_RAD_S = 1e-6
TURN_AIRSPEED_MIN_M_S = 1.0  # Below this airspeed the wing does not fly, and g·tan(bank)/v is meaningless.

OWN_WIND_STD_M_S = 1.5  # Includes the errors of airspeed sensor and compass.
UNKNOWN_WIND_STD_M_S = 3.0  # Used while nothing is known of the wind.
WIND_TIME_S = 20.0  # Time constant of the filter of the wind that is estimated here.
TURN_COMPARED_S = 1.0  # A rate of turn is computed from two positions, or attitudes, at most this far apart.
COORDINATED_RAD = math.radians(15.0), math.radians(60.0)  # Turns with other banks say little of coordination.
# What is expected before the first turn counts as much as 10 s of a turn with 25° of bank.
EXPECTED_S = 10.0 * math.tan(math.radians(25.0)) ** 2
TURNS_KEPT_S = 120.0  # Older turns count less: by a factor of e for so much time in turns.
COORDINATION_MIN = 0.5  # A lower estimate is not believed.
FLYING_MIN_M_S = 8.0  # A slower aircraft may stand on a slope.

Observed = TypeVar("Observed", GlobalPosition, AirData, Attitude, WindEstimate)

_OBSERVED = (GlobalPosition, AirData, Attitude, WindEstimate, EstimatorAccuracy)


@dataclass(frozen=True, slots=True)
class OwnshipSettings:
    """Highest ages of telemetry, and default accuracies.

    Parameters
    ----------
    position_max_age_s : float
        Highest age of a position for any decision [s].
    attitude_max_age_s, airspeed_max_age_s, wind_max_age_s : float
        Highest ages of these values; older ones are estimated from other data [s].
    jump_confirm_s : float
        Time without another jump after which a position that jumped is accepted [s].
    course_speed_min_m_s : float
        Ground speed below which the yaw replaces the course: at rest a velocity has no direction [m/s].
    position_std_horizontal_m, position_std_vertical_m : float
        Standard deviations until the autopilot reports its own [m].
    coordination : float
        Rate of turn as a share of that of a coordinated turn, until the aircraft has turned.
    """

    position_max_age_s: float = 1.5
    attitude_max_age_s: float = 1.5
    airspeed_max_age_s: float = 1.5
    wind_max_age_s: float = 30.0
    jump_confirm_s: float = 30.0
    course_speed_min_m_s: float = 1.0
    position_std_horizontal_m: float = 2.0
    position_std_vertical_m: float = 3.0
    coordination: float = 1.0

    def __post_init__(self) -> None:
        if min(astuple(self)) < 0.0:
            raise ValueError("ages, speeds, accuracies and shares count from zero up")


def turned_between(
    before: Attitude, attitude: Attitude, true_airspeed_m_s: float
) -> tuple[float, float] | None:
    """Return what two attitudes say of coordination: two numbers whose ratio is the share; None for nothing.

    With the slope ``s = tan(bank)`` they are the turn times ``s·v/g``, and ``s²`` times the time between [s].
    They count between attitudes at most a second apart in flight, banked to one side by 15 to 60°.

    Parameters
    ----------
    before, attitude : Attitude
        Bank and yaw, one after the other.
    true_airspeed_m_s : float
        True airspeed at that time [m/s].
    """
    step_s = attitude.stamp_s - before.stamp_s
    if not 0.0 < step_s <= TURN_COMPARED_S or true_airspeed_m_s < FLYING_MIN_M_S:
        return None
    banks = before.bank_rad, attitude.bank_rad
    least, most = sorted(map(abs, banks))
    if banks[0] * banks[1] < 0.0 or least < COORDINATED_RAD[0] or most > COORDINATED_RAD[1]:
        return None
    slope = math.tan(0.5 * sum(banks))
    turned_rad = wrapped_angle(attitude.yaw_rad - before.yaw_rad)
    return turned_rad * slope * true_airspeed_m_s / GRAVITY_M_S2, step_s * slope**2


class CoordinationEstimate:
    """The rate of turn as a share of that of a coordinated turn, by least squares over what was flown.

    An aircraft that slips turns less than ``g·tan(bank)/v``: its fuselage pushes it outwards. The guidance of
    ArduPlane and PX4 commands the bank of a coordinated turn, so that such an aircraft leaves its legs in
    turns.

    Parameters
    ----------
    expected : float
        The share before the first turn.
    """

    def __init__(self, expected: float = 1.0) -> None:
        self._expected_s = EXPECTED_S * expected
        self._before: Attitude | None = None
        self._turned_s = self._square_s = 0.0

    def note(self, attitude: Attitude, true_airspeed_m_s: float) -> None:
        """Take an attitude; it counts if the aircraft has turned since the last one.

        Parameters
        ----------
        attitude : Attitude
            Bank and yaw.
        true_airspeed_m_s : float
            True airspeed at that time [m/s].
        """
        before, self._before = self._before, attitude
        turned = None if before is None else turned_between(before, attitude, true_airspeed_m_s)
        if before is None or turned is None:
            return
        kept = math.exp(-(attitude.stamp_s - before.stamp_s) / TURNS_KEPT_S)
        self._turned_s = kept * self._turned_s + turned[0]
        self._square_s = kept * self._square_s + turned[1]

    @property
    def share(self) -> float:
        """The estimate, between :data:`COORDINATION_MIN` and 1."""
        share = (self._expected_s + self._turned_s) / (EXPECTED_S + self._square_s)
        return min(max(share, COORDINATION_MIN), 1.0)


class OwnshipEstimator:
    """Keeps the latest message of each kind and estimates the state of the aircraft.

    Parameters
    ----------
    frame : LocalFrame
        Frame of the mission file.
    settings : OwnshipSettings, optional
        Highest ages of telemetry.

    Attributes
    ----------
    counters : Counter of str
        Unused events by reason: ``not_finite``, ``out_of_order``.
    """

    def __init__(self, frame: LocalFrame, settings: OwnshipSettings | None = None) -> None:
        self._frame = frame
        self._settings = settings or OwnshipSettings()
        self._position: GlobalPosition | None = None
        self._place_enu_m = (0.0, 0.0, 0.0)
        self._air: AirData | None = None
        self._attitude: Attitude | None = None
        self._wind: WindEstimate | None = None
        self._own_wind: WindEstimate | None = None
        self._turn_rad_s = 0.0
        self._coordination = CoordinationEstimate(self._settings.coordination)
        self._accuracy: EstimatorAccuracy | None = None
        self._integrity = PositionIntegrity()
        self.counters: Counter[str] = Counter()

    def observe(self, event: Event) -> None:
        """Take an event; events that do not concern the own state are ignored."""
        if isinstance(event, EstimatorHealth):
            self._integrity.note_health(event)
        if not isinstance(event, _OBSERVED):
            return
        if not _is_finite(event):
            self.counters["not_finite"] += 1
            return
        held = self._held(event)
        if held is not None and event.stamp_s < held.stamp_s:
            self.counters["out_of_order"] += 1
            return
        match event:
            case GlobalPosition():
                self._note_position(event)
            case AirData():
                self._air = event
            case Attitude():
                self._attitude = event
                if (airspeed_m_s := self._reported_airspeed(event.stamp_s)) is not None:
                    self._coordination.note(event, airspeed_m_s)
            case WindEstimate():
                self._wind = event
            case EstimatorAccuracy():
                self._accuracy = event

    def _note_position(self, event: GlobalPosition) -> None:
        before, self._position = self._position, event
        self._place_enu_m = self._frame.local_from_global(
            event.latitude_deg, event.longitude_deg, event.altitude_amsl_m
        )
        self._integrity.note_position(event, self._place_enu_m, self._settings.jump_confirm_s)
        self._note_turn(before, event)
        self._note_own_wind(event)

    def _note_turn(self, before: GlobalPosition | None, event: GlobalPosition) -> None:
        """Compute the rate of turn from two positions, for use without a bank angle."""
        self._turn_rad_s = 0.0
        step_s = 0.0 if before is None else event.stamp_s - before.stamp_s
        if before is None or not 0.0 < step_s <= TURN_COMPARED_S:
            return
        (east, north, _), (east_before, north_before, _) = event.velocity_enu_m_s, before.velocity_enu_m_s
        turned = math.atan2(east, north) - math.atan2(east_before, north_before)
        self._turn_rad_s = wrapped_angle(turned) / step_s

    def _note_own_wind(self, event: GlobalPosition) -> None:
        """Estimate the wind as smoothed difference of ground and air velocity, assuming no sideslip."""
        now_s, settings = event.stamp_s, self._settings
        airspeed_m_s = self._reported_airspeed(now_s)
        attitude = _fresh(self._attitude, now_s, settings.attitude_max_age_s)
        if airspeed_m_s is None or attitude is None or airspeed_m_s < TURN_AIRSPEED_MIN_M_S:
            return
        speed = airspeed_m_s * math.cos(attitude.pitch_rad)
        east = event.velocity_enu_m_s[0] - speed * math.sin(attitude.yaw_rad)
        north = event.velocity_enu_m_s[1] - speed * math.cos(attitude.yaw_rad)
        held = self._own_wind
        if held is None:
            self._own_wind = WindEstimate(now_s, east, north, OWN_WIND_STD_M_S)
            return
        step_s = max(now_s - held.stamp_s, 0.0)
        share = step_s / (WIND_TIME_S + step_s)
        self._own_wind = WindEstimate(
            now_s,
            held.wind_east_m_s + share * (east - held.wind_east_m_s),
            held.wind_north_m_s + share * (north - held.wind_north_m_s),
            OWN_WIND_STD_M_S,
        )

    def set_settings(self, settings: OwnshipSettings) -> None:
        """Use other settings from now on."""
        self._settings = settings

    def received_s(self) -> dict[str, float]:
        """Return the time of the last message of each input [s]; minus infinity before the first."""
        kept = {
            "position": self._position, "attitude": self._attitude,
            "airspeed": self._air, "wind": self._wind,
        }  # fmt: skip
        return {name: -math.inf if event is None else event.stamp_s for name, event in kept.items()}

    def doubt(self, now_s: float) -> str:
        """Return why received positions are not trusted now; '' if they are."""
        return self._integrity.doubt(now_s, self._settings.jump_confirm_s)

    def state(self, now_s: float) -> Ownship | None:
        """Return the state extrapolated to ``now_s``; None without a fresh and trusted position.

        ``stamp_s`` of the result is the instant of extrapolation. Values that are not fresh are estimated:
        the airspeed as the length of ground velocity minus wind, the bank from the turn over ground, and the
        wind from airspeed, yaw and ground velocity.
        """
        newest = _fresh(self._position, now_s, self._settings.position_max_age_s)
        if newest is None or self.doubt(now_s):
            return None
        ahead = max(now_s - newest.stamp_s, 0.0)
        east, north, up = newest.velocity_enu_m_s
        wind, wind_std_m_s = self._wind_now(now_s)
        ground_speed = math.hypot(east, north)
        place = self._place_enu_m
        return Ownship(
            stamp_s=newest.stamp_s + ahead,
            position_enu_m=(place[0] + ahead * east, place[1] + ahead * north, place[2] + ahead * up),
            course_rad=self._course(east, north),
            flight_path_angle_rad=math.atan2(up, ground_speed) if ground_speed > 0.0 else 0.0,
            airspeed_m_s=self._airspeed(now_s, east - wind[0], north - wind[1], up),
            ground_speed_m_s=ground_speed,
            wind_enu_m_s=wind,
            wind_std_m_s=wind_std_m_s,
            position_std_m=self._position_std(),
            bank_rad=self._bank(now_s),
            coordination=self._coordination.share,
        )

    def _held(self, event: Event) -> Event | None:
        kept = (self._position, self._air, self._attitude, self._wind, self._accuracy)
        return next((held for held in kept if type(held) is type(event)), None)

    def _course(self, east_m_s: float, north_m_s: float) -> float:
        slow = math.hypot(east_m_s, north_m_s) < self._settings.course_speed_min_m_s
        if slow and self._attitude is not None:
            return self._attitude.yaw_rad % (2.0 * math.pi)
        return math.atan2(east_m_s, north_m_s) % (2.0 * math.pi)

    def _wind_now(self, now_s: float) -> tuple[tuple[float, float], float]:
        """Return the autopilot's fresh wind, else our own, else the latest, with its deviation."""
        reported, own, max_age_s = self._wind, self._own_wind, self._settings.wind_max_age_s
        wind = _fresh(reported, now_s, max_age_s) or _fresh(own, now_s, max_age_s) or reported or own
        if wind is None:
            return (0.0, 0.0), UNKNOWN_WIND_STD_M_S
        return (wind.wind_east_m_s, wind.wind_north_m_s), wind.std_m_s

    def _airspeed(self, now_s: float, east_m_s: float, north_m_s: float, up_m_s: float) -> float:
        reported = self._reported_airspeed(now_s)
        return math.hypot(east_m_s, north_m_s, up_m_s) if reported is None else reported

    def _reported_airspeed(self, now_s: float) -> float | None:
        """Return the true airspeed by a fresh report, which has the equivalent one; None without [m/s]."""
        air = _fresh(self._air, now_s, self._settings.airspeed_max_age_s)
        if air is None or self._position is None:
            return None
        return true_airspeed(air.airspeed_m_s, self._position.altitude_amsl_m)

    def _bank(self, now_s: float) -> float:
        attitude = _fresh(self._attitude, now_s, self._settings.attitude_max_age_s)
        if attitude is not None:
            return attitude.bank_rad
        if self._position is None:
            return 0.0
        # The circle is flown through the air, but the rate of turn over the ground is about the same.
        speed = math.hypot(*self._position.velocity_enu_m_s[:2])
        return math.atan(self._turn_rad_s * speed / GRAVITY_M_S2)

    def _position_std(self) -> tuple[float, float]:
        if self._accuracy is None:
            return self._settings.position_std_horizontal_m, self._settings.position_std_vertical_m
        return self._accuracy.position_horizontal_std_m, self._accuracy.position_vertical_std_m


def predicted(state: Ownship, ahead_s: float) -> Ownship:
    """Return the state after a turn with the present bank, coordination, speed and wind.

    The velocity through the air turns at that share of ``g·tan(bank)/v`` (v is its horizontal part), the wind
    moves the circle, and the climb rate stays constant. Below an airspeed of 1 m/s there is no turn. The
    prediction is valid for a few seconds, since no bank lasts longer.

    Parameters
    ----------
    state : Ownship
        State at the start of the turn.
    ahead_s : float
        Duration of the turn, at least 0 [s].

    References
    ----------
    Beard and McLain, *Small Unmanned Aircraft*, 2012, eq. (9.14): the coordinated turn.
    """
    wind_east, wind_north = state.wind_enu_m_s
    air_east = state.ground_speed_m_s * math.sin(state.course_rad) - wind_east
    air_north = state.ground_speed_m_s * math.cos(state.course_rad) - wind_north
    speed = math.hypot(air_east, air_north)
    bank = min(max(state.bank_rad, -BANK_MAX_RAD), BANK_MAX_RAD)
    rate = (
        state.coordination * GRAVITY_M_S2 * math.tan(bank) / speed if speed > TURN_AIRSPEED_MIN_M_S else 0.0
    )
    heading = math.atan2(air_east, air_north)
    turned = heading + rate * ahead_s
    if abs(rate) < TURN_RATE_MIN_RAD_S:
        moved_east, moved_north = air_east * ahead_s, air_north * ahead_s
    else:
        radius = speed / rate
        moved_east = radius * (math.cos(heading) - math.cos(turned))
        moved_north = radius * (math.sin(turned) - math.sin(heading))
    ground_east = speed * math.sin(turned) + wind_east
    ground_north = speed * math.cos(turned) + wind_north
    ground_speed = math.hypot(ground_east, ground_north)
    climb_rate = state.climb_m_s
    east, north, up = state.position_enu_m
    return replace(
        state,
        stamp_s=state.stamp_s + ahead_s,
        position_enu_m=(
            east + moved_east + wind_east * ahead_s,
            north + moved_north + wind_north * ahead_s,
            up + climb_rate * ahead_s,
        ),
        course_rad=math.atan2(ground_east, ground_north) % (2.0 * math.pi)
        if ground_speed
        else state.course_rad,
        flight_path_angle_rad=math.atan2(climb_rate, ground_speed) if ground_speed else 0.0,
        ground_speed_m_s=ground_speed,
    )


def _fresh(newest: Observed | None, now_s: float, max_age_s: float) -> Observed | None:
    """Return the message if it is not too old [s], else None."""
    return newest if newest is not None and now_s - newest.stamp_s <= max_age_s else None


def _is_finite(event: Event) -> bool:
    """Return whether all numbers of an event, also those in tuples, are finite."""
    numbers = [
        number
        for value in astuple(event)
        for number in (value if isinstance(value, tuple) else (value,))
        if isinstance(number, float)
    ]
    return all(map(math.isfinite, numbers))
