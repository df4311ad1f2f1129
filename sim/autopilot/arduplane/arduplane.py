"""ArduPlane: its modes, and how it flies, replaces and ends missions.

Behaviour as measured on ArduPlane 4.7-dev in its own SITL; ``tests/sim/autopilot/test_ardupilot.py`` names
each peculiarity.
"""

from __future__ import annotations

import math
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.frames import wrapped_angle
from companion.types.mission import Command, MavFrame, MissionItem
from ...mission_types import MissionKind, Verdict, is_navigation
from ...projection import FastProjection
from ...vehicle.control import Circle, FirstClimb, Flight, Leg, Level
from ..autopilot_parameters import Parameters
from ..base import ACCEPTED, DENIED, FAILED, UNSUPPORTED, CommandRequest
from ..channel import Channel, Message
from ..mission_pilot import MissionPilot
from ..telemetry import Home, Target
from .arduplane_runner import MissionRunner, MissionState
from .arduplane_store import MissionStore
from .arduplane_transfer import MissionTransfer, item_from_message
from .return_leg import closest_leg, closest_start

MODES = {
    "MANUAL": 0,
    "CIRCLE": 1,
    "STABILIZE": 2,
    "FBWA": 5,
    "FBWB": 6,
    "CRUISE": 7,
    "AUTO": 10,
    "RTL": 11,
    "LOITER": 12,
    "GUIDED": 15,
}
_NAMES = {number: name for name, number in MODES.items()}
_LAND_AT_ONCE, _BY_RETURN_PATH = 2, 4  # RTL_AUTOLAND
_LABELS = {16: "WP", 17: "LoitUnlim", 18: "LoitTurns", 19: "LoitTime", 20: "RTL", 21: "Land", 22: "Takeoff"}
_LABELS |= {31: "LoitAltitude", 178: "SetSpeed", 189: "DoLandStart"}
_CLIMB_AT_ONCE, _CLIMB_BEFORE_TURN = 1 << 14, 1 << 4  # FLIGHT_OPTIONS
_FIRST_CLIMB_MORE_M = 10.0
_CIRCLE_BANK = math.radians(20.0)
_GUIDED_CURRENT = 2
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_VERSION_4_7_DEV = 0x04070000


def home_item(home: Home) -> MissionItem:
    """Slot 0 of every mission."""
    return MissionItem(
        0,
        Command.NAV_WAYPOINT,
        MavFrame.GLOBAL,
        (0.0, 0.0, 0.0, 0.0),
        home.latitude_e7,
        home.longitude_e7,
        home.altitude_amsl_m,
    )


class ArduPlane(MissionPilot):
    """The fixed-wing autopilot of ArduPilot.

    Parameters
    ----------
    flight, projection, parameters, home
        As of :class:`sim.autopilot.base.Autopilot`.
    """

    default_streams = (1, 2, 24, 30, 33, 42, 62, 74, 87, 168, 193)
    always_waits_for_course = True

    def __init__(
        self, flight: Flight, projection: FastProjection, parameters: Parameters, home: Home
    ) -> None:
        super().__init__(flight, projection, parameters, home)
        self.telemetry.builders[mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT] = self.telemetry.terrain_report
        self.store = MissionStore(home_item(home))
        self.runner = MissionRunner(self.store, self)
        self._transfer = self._fresh_transfer()
        self._mode = "LOITER"
        self._has_reported_guided = False
        self._shows_item_zero = False
        self._reported_total = 0
        self._pending_reached: int | None = None
        self._turn_rad = 0.0
        transfers = [
            *("MISSION_COUNT", "MISSION_WRITE_PARTIAL_LIST", "MISSION_ITEM", "MISSION_ITEM_INT"),
            *("MISSION_REQUEST_LIST", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_CLEAR_ALL"),
        ]
        self._handlers |= dict.fromkeys(transfers, self._mission_message)
        self._handlers |= {"MISSION_SET_CURRENT": self._set_current_message, "SET_MODE": self._mode_message}
        self._commands |= {
            mavlink.MAV_CMD_DO_SET_MODE: self._mode_command,
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_current_command,
            mavlink.MAV_CMD_MISSION_START: self._start_command,
            mavlink.MAV_CMD_DO_CHANGE_SPEED: self._speed_command,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition_command,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._switched("RTL"),
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda _: self._switched("LOITER"),
        }

    # --- interface of the base class

    @property
    def mode(self) -> str:
        """Flight mode by ArduPlane's name."""
        return self._mode

    @property
    def mission_items(self) -> tuple[MissionItem, ...]:
        """The stored mission, home first."""
        return tuple(self.store.mission)

    @property
    def is_uploading(self) -> bool:
        """Whether somebody is uploading a list."""
        return self._transfer.is_receiving

    @property
    def current_sequence(self) -> int:
        """Sequence of the item being flown, or to be resumed."""
        return self.runner.index

    @property
    def mission_revision(self) -> int:
        """Changes whenever a stored list does."""
        return self.store.revision

    @property
    def active_command(self) -> int | None:
        """Command of the item being flown; None while none is."""
        is_flown = self._mode == "AUTO" and self.runner.active is not None
        return self.runner.active.command if is_flown and self.runner.active is not None else None

    def disarmed(self) -> None:
        """The mission begins at its first item with the next flight."""
        self.runner.stop()
        self.runner.index = 1
        self._mode = "FBWA"

    def heartbeat(self) -> Message:
        """HEARTBEAT: armed, custom mode."""
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.is_armed else 0
        base |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if self._mode in ("AUTO", "RTL", "LOITER", "GUIDED", "CIRCLE"):
            base |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_FIXED_WING,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base,
            MODES[self._mode],
            self.system_status,
            3,
        )

    def mission_current(self) -> Message:
        """MISSION_CURRENT; set to item 0 it says so once, and 1 from then on."""
        sequence = 0 if self._shows_item_zero else self.runner.index
        self._shows_item_zero = False
        total = max(len(self.store.mission) - 1, 0)
        mode = int(self._mode == "AUTO")
        return mavlink.MAVLink_mission_current_message(sequence, total, int(self.runner.state), mode)

    def version(self) -> Message:
        """AUTOPILOT_VERSION."""
        nothing = (0,) * 8
        return mavlink.MAVLink_autopilot_version_message(
            _CAPABILITIES, _VERSION_4_7_DEV, 0, 0, 0, nothing, nothing, nothing, 0x1209, 0x5740, 0x5A5A
        )

    def set_mode(self, name: str) -> bool:
        """Switch; entering the mode one is in does nothing."""
        if name not in MODES:
            return False
        if name == self._mode:
            return True
        if self._mode == "AUTO":
            self.runner.stop()
        self._mode = name
        self._previous = None
        self._speed_m_s = None
        self._enter(name)
        self.broadcast(self.heartbeat())
        return True

    def navigate(self) -> None:
        """Transfers first, then the mission."""
        self._transfer.update(self.now_us)
        self._tell_total()
        if self._mode == "RTL":
            self._leave_return()
        if self._mode == "AUTO":
            is_landing = self.active_command == Command.NAV_LAND
            self.flight.goes_beyond = is_landing or not self.store.mission
            if not self.flight.is_standing:
                self.runner.update()
        elif self._mode == "GUIDED" and not self._has_reported_guided and self._is_on_circle():
            self._has_reported_guided = True
            self.reached(0)
        slope_min_m = self.parameters["ALT_SLOPE_MIN"] or math.inf
        climbs_at_once = int(self.parameters["FLIGHT_OPTIONS"]) & _CLIMB_AT_ONCE
        self.flight.descent_slope_min_m = slope_min_m
        self.flight.climb_slope_min_m = math.inf if climbs_at_once else slope_min_m
        speed = self._speed_m_s
        self.flight.airspeed_m_s = self.parameters["AIRSPEED_CRUISE"] if speed is None else speed
        if self._pending_reached is not None:
            self.broadcast(mavlink.MAVLink_mission_item_reached_message(self._pending_reached))
            self._pending_reached = None

    def reboot(self) -> None:
        """Restart in flight as after a watchdog reset: mode, missions and index survive."""
        super().reboot()
        self.say(mavlink.MAV_SEVERITY_INFO, "ArduPilot Ready")
        self._transfer = self._fresh_transfer()
        self._previous, self._speed_m_s = None, None
        if self._mode == "AUTO":
            self.runner.stop()
            self.runner.resume(restart=False)

    def relay_traffic(self, report: Message, source: tuple[int, int]) -> None:
        """Forward a report; with ADSB_TYPE 1 it is sent as the autopilot's own instead."""
        if self.parameters["ADSB_TYPE"] != 1.0:
            super().relay_traffic(report, source)
            return
        self.broadcast(report)

    def _fresh_transfer(self) -> MissionTransfer:
        return MissionTransfer(self.store, self.say, lambda: not self._flies_mission())

    # --- modes

    def start(self, items: list[MissionItem], mode: str) -> None:
        """Begin in flight, with the mission stored and the mode entered."""
        for item in items:
            self.store.put(MissionKind.MISSION, item)
        self._reported_total = len(items)
        self.parameters["MIS_TOTAL"] = len(items)
        self._mode = "FBWA"
        self.set_mode(mode)

    def _enter(self, name: str) -> None:
        flight = self.flight
        here, height = flight.position, flight.estimate.up_m
        flight.goes_beyond, flight.first_climb = False, None
        if name == "AUTO":
            self.runner.resume(restart=self.parameters["MIS_RESTART"] == 1.0)
        elif name == "RTL":
            east, north, up = self._return_end(height)
            radius = self.parameters["RTL_RADIUS"] or self.parameters["WP_LOITER_RAD"]
            self._steer_circle((east, north), radius, up)
            circle = self.flight.steering
            if isinstance(circle, Circle) and up < height:  # It climbs at once, and descends on the way.
                flight.steering = replace(circle, begins=(*here, height))
            flight.first_climb = self._first_climb(height, up)
        elif name in ("LOITER", "GUIDED"):
            self._steer_circle(here, self.parameters["WP_LOITER_RAD"], height)
            self._has_reported_guided = True
        else:
            flight.steering = Level(_CIRCLE_BANK if name == "CIRCLE" else 0.0, height)
            self.telemetry.target = None

    def _first_climb(self, height_m: float, end_m: float) -> FirstClimb | None:
        """Return the climb with which a return from a height to that of its end begins."""
        climb_m, until_m = self.parameters["RTL_CLIMB_MIN"], end_m
        if not int(self.parameters["FLIGHT_OPTIONS"]) & _CLIMB_BEFORE_TURN:
            if climb_m <= 0.0:
                return None
            until_m = height_m + climb_m
        target_m = max(height_m, end_m) + climb_m + _FIRST_CLIMB_MORE_M
        return FirstClimb(until_m, target_m, math.radians(self.parameters["LEVEL_ROLL_LIMIT"]))

    def _return_end(self, height_m: float) -> Target:
        """Return the end of a return to launch: the nearest rally point within RALLY_LIMIT_KM, else home."""
        home, altitude = self.home, self.parameters["RTL_ALTITUDE"]
        end = (home.east_m, home.north_m, height_m if altitude < 0 else home.up_m + altitude)
        rally = self._nearest_rally_point(self.store.items(MissionKind.RALLY))
        if rally is None:
            return end
        here, limit_m = self.flight.position, 1e3 * self.parameters["RALLY_LIMIT_KM"]
        away = math.dist(rally[:2], here)
        is_nearer = away < math.dist(end[:2], here)
        is_near = limit_m == 0.0 or away <= limit_m
        return rally if is_near and (is_nearer or not self.parameters["RALLY_INCL_HOME"]) else end

    def _leave_return(self) -> None:
        """Go on in AUTO: with RTL_AUTOLAND 2 to the landing sequence, with 4 by the closest return path."""
        choice, items = self.parameters["RTL_AUTOLAND"], self.store.mission
        here = (*self.flight.position, self.flight.estimate.up_m)
        target = closest_start(items, self._position, here) if choice == _LAND_AT_ONCE else None
        if choice == _BY_RETURN_PATH:
            target = closest_leg(items, self._position, here)
            if target is not None:
                self.say(mavlink.MAV_SEVERITY_INFO, "Return path started")
        if target is not None:
            self.runner.set_current(target)
            self.set_mode("AUTO")

    def _flies_mission(self) -> bool:
        return self._mode == "AUTO" and self.runner.state is MissionState.ACTIVE

    def _switched(self, name: str) -> int:
        return ACCEPTED if self.set_mode(name) else FAILED

    # --- flying the mission (the runner's Pilot)

    def begin(self, item: MissionItem) -> None:
        """Start a navigation item."""
        label = _LABELS.get(item.command, f"Cmd{item.command}")
        self.say(mavlink.MAV_SEVERITY_INFO, f"Mission: {item.sequence} {label}")
        if item.command == Command.NAV_RETURN_TO_LAUNCH:
            self.set_mode("RTL")
        else:
            self._steer_item(item)

    def reached(self, sequence: int) -> None:
        """MISSION_ITEM_REACHED: one slot a link, so that a later item's number replaces an earlier's."""
        self._pending_reached = sequence

    def mission_complete(self) -> None:
        """Go home: the list has ended."""
        self.say(mavlink.MAV_SEVERITY_NOTICE, "Mission complete, changing mode to RTL")
        self.set_mode("RTL")

    def _circled_radius(self, radius_m: float) -> float:
        """Radius of a circle: it grows with the square of true over equivalent airspeed (measured)."""
        state = self.flight.dynamics.state
        ratio = state.true_airspeed_m_s / max(state.equivalent_airspeed_m_s, 1.0)
        return radius_m * max(ratio, 1.0) ** 2

    def _has_passed(self, leg: Leg, item: MissionItem) -> bool:
        distance = self._distance_to_end(leg)
        radius = (item.parameters[1] or 0.0) or self._turn_distance_m()
        is_near = distance <= radius
        if is_near or self._is_abeam(leg):
            verb = "Reached" if is_near else "Passed"
            text = f"{verb} waypoint #{item.sequence} dist {round(distance)}m"
            self.say(mavlink.MAV_SEVERITY_INFO, text)
            return True
        return False

    def _steer_item(self, item: MissionItem) -> None:
        """Steer for a navigation item, and note the turn at it; one already abeam is turned back to."""
        super()._steer_item(item)
        leg, self._turn_rad = self.flight.steering, 0.5 * math.pi
        if not isinstance(leg, Leg):
            return
        if self._is_abeam(leg):
            leg = replace(leg, start=self.flight.position)
            self.flight.steering = leg
        following = self.store.mission[item.sequence + 1 :]
        after = next((other for other in following if is_navigation(other.command)), None)
        if after is not None and (after.latitude_e7 or after.longitude_e7):
            end = self._position(after)
            on = math.atan2(end[0] - leg.end[0], end[1] - leg.end[1])
            here = math.atan2(leg.end[0] - leg.start[0], leg.end[1] - leg.start[1])
            self._turn_rad = abs(wrapped_angle(on - here))

    def _turn_distance_m(self) -> float:
        """Distance before a waypoint at which it counts as reached: less where the turn is less."""
        ahead_m = self.flight.lateral.distance_m(self.flight.estimate.ground_speed_m_s)
        distance_m = min(self._circled_radius(self.parameters["WP_RADIUS"]), ahead_m)
        return distance_m * min(self._turn_rad / (0.5 * math.pi), 1.0)

    # --- messages and commands

    def _tell_total(self) -> None:
        """MIS_TOTAL and RALLY_TOTAL to everybody whenever a list's length has changed."""
        rally = len(self.store.items(MissionKind.RALLY))
        if rally != self.parameters["RALLY_TOTAL"]:
            self.parameters["RALLY_TOTAL"] = rally
            self.broadcast(self.parameters.message("RALLY_TOTAL", indexed=False))
        total = len(self.store.mission)
        if total != self._reported_total:
            self._reported_total = total
            self.parameters["MIS_TOTAL"] = total
            self.broadcast(self.parameters.message("MIS_TOTAL", indexed=False))

    def _mission_message(self, channel: Channel, message: Message) -> None:
        is_item = message.get_type() in ("MISSION_ITEM_INT", "MISSION_ITEM")
        if is_item and message.current == _GUIDED_CURRENT and getattr(message, "mission_type", 0) == 0:
            verdict = self._guided_item(item_from_message(message))
            channel.send(
                mavlink.MAVLink_mission_ack_message(
                    message.get_srcSystem(), message.get_srcComponent(), int(verdict), 0
                )
            )
            return
        self._transfer.handle(channel, message, self.now_us)

    def _guided_item(self, item: MissionItem) -> Verdict:
        """Fly to an item at once: GUIDED only."""
        if self._mode != "GUIDED":
            return Verdict.ERROR
        self._go_to(self._position(item), 0.0)
        return Verdict.ACCEPTED

    def _go_to(self, target: Target, radius_m: float) -> None:
        self._steer_circle(target[:2], radius_m or self.parameters["WP_LOITER_RAD"], target[2])
        self._has_reported_guided = False

    def _set_current(self, sequence: int, *, reset_jumps: bool = False) -> bool:
        previous, self._previous = self._previous, None  # Fly straight from here, not along the old leg.
        done = self.runner.set_current(sequence, reset_jumps=reset_jumps)
        if not done:
            self._previous = previous
        else:
            self._shows_item_zero = sequence == 0
        return done

    def _set_current_message(self, channel: Channel, message: Message) -> None:
        if self._set_current(message.seq):
            channel.send(self.mission_current())

    def _set_current_command(self, request: CommandRequest) -> int:
        is_reset = request.parameters[1] == 1.0
        return ACCEPTED if self._set_current(int(request.parameters[0]), reset_jumps=is_reset) else DENIED

    def _mode_message(self, _channel: Channel, message: Message) -> None:
        if message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.set_mode(_NAMES.get(message.custom_mode, ""))

    def _mode_command(self, request: CommandRequest) -> int:
        if not int(request.parameters[0]) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return UNSUPPORTED
        return self._switched(_NAMES.get(int(request.parameters[1]), ""))

    def _start_command(self, request: CommandRequest) -> int:
        if request.parameters[0] != 0.0 or request.parameters[1] != 0.0:
            return DENIED
        return self._switched("AUTO")

    def _speed_command(self, request: CommandRequest) -> int:
        return ACCEPTED if self._change_speed(request.parameters[0], request.parameters[1]) else FAILED

    def _reposition_command(self, request: CommandRequest) -> int:
        """Orbit a point; with flag 1 GUIDED is entered for it, without only if it is the mode already."""
        may_switch = int(request.parameters[1]) & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if (self._mode != "GUIDED" and not may_switch) or not math.isfinite(request.z):
            return DENIED
        east, north = self.projection.local(request.latitude_e7 * 1e-7, request.longitude_e7 * 1e-7)
        self.set_mode("GUIDED")
        self._go_to(
            (east, north, self._height(request.frame, request.z, (east, north))), request.parameters[2]
        )
        return ACCEPTED
