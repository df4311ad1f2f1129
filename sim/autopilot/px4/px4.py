"""PX4 for fixed wings: its modes, and how it flies, replaces and ends missions.

Behaviour as measured on PX4 1.17-dev in its own SITL; ``tests/sim/autopilot/test_px4_missions.py`` and its
neighbours name each peculiarity. Not measured, and so only plausible here: landing, of which the
approach alone is flown, and a reboot in flight, after which it holds.
"""

from __future__ import annotations

import math
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.mission import Command, MavFrame, MissionItem
from ...mission_types import MissionKind
from ...projection import FastProjection
from ...vehicle.control import Flight, Leg, Level
from ..arduplane.arduplane_runner import MissionState
from ..autopilot_parameters import Parameters
from ..base import ACCEPTED, DENIED, FAILED, CommandRequest
from ..channel import Channel, Extended, Message
from ..mission_pilot import MissionPilot
from ..telemetry import Home, Target
from .px4_runner import Px4Runner
from .px4_store import StoredList, stored, why_infeasible
from .px4_transfer import Px4Transfer

_AUTO = 4
_RALLY_FRAMES = (MavFrame.GLOBAL, MavFrame.GLOBAL_RELATIVE_ALT)
_MAIN = {"MANUAL": 1, "ALTCTL": 2, "POSCTL": 3, "ACRO": 5, "STABILIZED": 7}
_SUB = {"TAKEOFF": 2, "LOITER": 3, "MISSION": 4, "RTL": 5, "LAND": 6}
MODES = {name: main << 16 for name, main in _MAIN.items()}
MODES |= {name: (sub << 24) | (_AUTO << 16) for name, sub in _SUB.items()}
_NAMES = {number: name for name, number in MODES.items()}
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_VERSION_1_17_DEV, _NO_MISSION, _SECOND_US = 0x01110000, 65535, 1_000_000
_CHECK_US = 80_000  # Time from an upload to its check; a mode that is requested meanwhile is not entered.
_REACHED_REPEATS, _TRAFFIC_FLAGS = 10, 63  # Of the flags, bits 0 to 5 are kept.
_FINITE_LIMIT_M = 100_000.0
_BY_MISSION = 2  # RTL_TYPE
_LOITERS = (Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME)


class Px4(MissionPilot):
    """The fixed-wing autopilot of PX4.

    Parameters
    ----------
    flight, projection, parameters, home
        As of :class:`sim.autopilot.base.Autopilot`.
    """

    default_streams = (1, 2, 24, 30, 33, 74, 87, 230, 231, 242, 245)
    answers_at_once = True

    def __init__(
        self, flight: Flight, projection: FastProjection, parameters: Parameters, home: Home
    ) -> None:
        super().__init__(flight, projection, parameters, home)
        builders = self.telemetry.builders
        for absent in (
            mavlink.MAVLINK_MSG_ID_WIND,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
            mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4,
            mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,  # Sent once a second, whatever rate is requested.
        ):
            del builders[absent]
        builders[mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS] = self.telemetry.estimator_status
        builders[mavlink.MAVLINK_MSG_ID_WIND_COV] = self.telemetry.wind_covariance
        builders[mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE] = self._extended_state
        self._lists = {kind: StoredList() for kind in MissionKind}
        self._revision = 0
        self.runner = Px4Runner(self)
        self._transfer = Px4Transfer(self, self.say)
        self._mode = "LOITER"
        self._is_feasible = False
        self._return_end: Target | None = None  # Set when the height is reached.
        self._check_us: int | None = None
        self._tell_us = 0
        self._reached: tuple[int, int, int] | None = None  # Item, remaining repetitions, next time [µs].
        self._stations: set[Channel] = set()
        self._handlers |= dict.fromkeys(self._transfer.messages, self._mission_message)
        self._handlers |= {
            "SET_MODE": self._mode_message,
            "HEARTBEAT": self._note_station,
            "ADSB_VEHICLE": self._traffic_message,
        }
        self._commands |= {
            mavlink.MAV_CMD_DO_SET_MODE: self._mode_command,
            mavlink.MAV_CMD_MISSION_START: self._start_command,
            mavlink.MAV_CMD_DO_CHANGE_SPEED: self._speed_command,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition_command,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._switched("RTL"),
        }

    # --- interface of the base class

    @property
    def mode(self) -> str:
        """Flight mode by PX4's name, without ``AUTO.``."""
        return self._mode

    @property
    def mission_items(self) -> tuple[MissionItem, ...]:
        """The stored mission."""
        return self._lists[MissionKind.MISSION].items

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
        return self._revision

    def _extended_state(self) -> Message:
        """EXTENDED_SYS_STATE: a take-off until its item is done, a landing from the descent on (measured)."""
        landed = mavlink.MAV_LANDED_STATE_IN_AIR
        if self.flight.is_standing:
            landed = mavlink.MAV_LANDED_STATE_ON_GROUND
        elif self.active_command == Command.NAV_TAKEOFF:
            landed = mavlink.MAV_LANDED_STATE_TAKEOFF
        elif self.active_command == Command.NAV_LAND:
            landed = mavlink.MAV_LANDED_STATE_LANDING
        return mavlink.MAVLink_extended_sys_state_message(0, landed)

    @property
    def active_command(self) -> int | None:
        """Command of the item being flown; None while none is."""
        items = self.mission_items
        is_flown = self._flies_items and self.runner.index < len(items)
        return items[self.runner.index].command if is_flown else None

    def disarmed(self) -> None:
        """The mission begins at its first item with the next flight; the mode is hold."""
        self.runner.reset()
        self._mode = "LOITER"
        self._enter("LOITER")

    @property
    def state(self) -> MissionState:
        """The state of the mission in MISSION_CURRENT."""
        if not self.mission_items or (not self._is_feasible and self._check_us is None):
            return MissionState.NO_MISSION
        if self.runner.is_complete:
            return MissionState.COMPLETE
        return MissionState.ACTIVE if self._mode == "MISSION" else MissionState.NOT_STARTED

    def heartbeat(self) -> Message:
        """HEARTBEAT: armed, custom mode."""
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.is_armed else 0
        base |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        is_auto = self._mode in _SUB
        base |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED if is_auto else 0
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_FIXED_WING,
            mavlink.MAV_AUTOPILOT_PX4,
            base,
            MODES[self._mode],
            self.system_status,
            3,
        )

    def mission_current(self) -> Message:
        """MISSION_CURRENT, with the mission's id as an extension field."""
        kept = self._lists[MissionKind.MISSION]
        total = len(kept.items) or _NO_MISSION
        mode = 1 if self._mode == "MISSION" else 2
        message = mavlink.MAVLink_mission_current_message(self.runner.index, total, int(self.state), mode)
        fence, rally = self._lists[MissionKind.FENCE], self._lists[MissionKind.RALLY]
        names = (kept.identity, fence.identity, rally.identity)
        return Extended(message, b"".join(name.to_bytes(4, "little") for name in names))

    def version(self) -> Message:
        """AUTOPILOT_VERSION."""
        nothing = (0,) * 8
        return mavlink.MAVLink_autopilot_version_message(
            _CAPABILITIES, _VERSION_1_17_DEV, 0, 0, 0, nothing, nothing, nothing, 0x26AC, 0x0032, 0x5A5A
        )

    def set_mode(self, name: str) -> bool:
        """Switch; without a mission that passed the check, MISSION is not entered though it is taken."""
        if name not in MODES:
            return False
        if name == self._mode:
            return True
        if name == "MISSION" and (not self._is_feasible or self._check_us is not None):
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Switching to Mission is currently not available")
            return True
        self.runner.stop()
        self._mode = name
        self._previous = None
        self._speed_m_s = None
        self._enter(name)
        self.broadcast(self.heartbeat())
        return True

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT, only to links with a ground station."""
        message = mavlink.MAVLink_statustext_message(severity, text[:50].encode("ascii", "replace"))
        for channel in self.channels:
            if channel in self._stations:
                channel.send(message)

    def remove_channel(self, channel: Channel) -> None:
        """Close a client's link."""
        super().remove_channel(channel)
        self._stations.discard(channel)

    def navigate(self) -> None:
        """Transfers first, then the check of a new mission, then the mission."""
        self._transfer.update(self.now_us)
        if self._check_us is not None and self.now_us >= self._check_us:
            self._check()
        if self._flies_items and not self.flight.is_standing:
            self.flight.goes_beyond = self.active_command == Command.NAV_LAND
            self.runner.update()
        elif self._mode == "RTL":
            self._return()
        speed = self._speed_m_s
        self.flight.airspeed_m_s = self.parameters["AIRSPEED_CRUISE"] if speed is None else speed
        self._tell()

    def reboot(self) -> None:
        """Restart in flight: the mission is kept, the mode is HOLD."""
        super().reboot()
        self._transfer = Px4Transfer(self, self.say)
        self._reached = None
        self.set_mode("LOITER")

    def relay_traffic(self, report: Message, source: tuple[int, int]) -> None:
        """Forward a report, and send it again as its own, to every link."""
        super().relay_traffic(report, source)
        self._echo(report)

    # --- lists (the transfer's owner)

    @property
    def current_item(self) -> int:
        """Sequence marked as current in a download."""
        return self.runner.index

    def stored_list(self, kind: MissionKind) -> StoredList:
        """Return the list in use."""
        return self._lists[kind]

    def switch(self, kind: MissionKind, new: StoredList, current: int | None) -> None:
        """Use another list from now on.

        If no item is marked current, the old index stays, limited to the new length.
        """
        self._lists[kind] = new
        self._revision += 1
        if kind is not MissionKind.MISSION:
            return
        last = len(new.items) - 1
        self._check_us = self.now_us + _CHECK_US
        self.runner.jump(min(self.runner.index, last) if current is None else current)

    def clear(self, kind: MissionKind) -> None:
        """Forget a list; without a mission it holds."""
        self._lists[kind] = StoredList()
        self._revision += 1
        if kind is MissionKind.MISSION:
            self._is_feasible, self._check_us = False, None
            self.runner.reset()
            if self._mode == "MISSION":
                self._hold_for_want_of_mission()

    def forget_reached(self) -> None:
        """Stop repeating MISSION_ITEM_REACHED."""
        self._reached = None

    def go_to(self, sequence: int) -> bool:
        """Make an item current; reported with the next MISSION_CURRENT only."""
        if not 0 <= sequence < len(self.mission_items):
            return False
        self.runner.jump(sequence)
        return True

    def _check(self) -> None:
        """Check whether the new mission can be flown; the old one is gone in any case."""
        self._check_us = None
        requirement = int(self.parameters["MIS_TKO_LAND_REQ"])
        reason = why_infeasible(
            self.mission_items, requirement, self.parameters["FW_LND_ANG"], self.projection
        )
        self._is_feasible = not reason
        if reason and self._mode == "MISSION":
            self._hold_for_want_of_mission()

    def _hold_for_want_of_mission(self) -> None:
        self.say(mavlink.MAV_SEVERITY_CRITICAL, "No valid mission available, loitering")
        self.set_mode("LOITER")

    # --- modes

    def start(self, items: list[MissionItem], mode: str, current: int = 0) -> None:
        """Begin in flight, with the mission stored and checked and the mode entered."""
        self._lists[MissionKind.MISSION] = stored(items)
        self.runner.jump(current)
        self._check()
        self._mode = "STABILIZED"
        self.set_mode(mode)

    def _enter(self, name: str) -> None:
        flight = self.flight
        here, height = flight.position, flight.estimate.up_m
        flight.goes_beyond = False
        if name == "MISSION" or (name == "RTL" and self._returns_by_mission()):
            self.runner.resume()
        elif name in ("RTL", "LAND"):
            self._begin_return(here, height)
        elif name in _SUB:
            self._steer_circle(here, self.parameters["WP_LOITER_RAD"], height)
        else:
            flight.steering = Level(0.0, height)
            self.telemetry.target = None

    def _returns_by_mission(self) -> bool:
        """Return whether a return flies the mission on to its landing (RTL_TYPE 2)."""
        has_landing = any(item.command == Command.NAV_LAND for item in self.mission_items)
        return has_landing and self.parameters["RTL_TYPE"] == _BY_MISSION

    @property
    def _flies_items(self) -> bool:
        """Whether the mission's items are flown, in the mission mode or in a return by the mission."""
        return self._mode == "MISSION" or (self._mode == "RTL" and self._returns_by_mission())

    def _begin_return(self, here: tuple[float, float], height_m: float) -> None:
        """Climb in a circle first; with a rally point in an unknown frame it flies to a wrong place."""
        if self._has_unsupported_rally_frame():
            self.flight.steering = Level(0.0, height_m)
            return
        self._return_end = end = self._chosen_return_end(height_m)
        self._steer_circle(here, self.parameters["WP_LOITER_RAD"], end[2])

    def _has_unsupported_rally_frame(self) -> bool:
        """Return whether a rally point is in a frame that it took and cannot return by."""
        return any(item.frame not in _RALLY_FRAMES for item in self._lists[MissionKind.RALLY].items)

    def _chosen_return_end(self, height_m: float) -> Target:
        """Return the end of a return: home, or a nearer rally point; no lower than RTL_RETURN_ALT."""
        end, here = (self.home.east_m, self.home.north_m, self.home.up_m), self.flight.position
        rally = self._nearest_rally_point(self._lists[MissionKind.RALLY].items)
        if rally is not None and math.dist(rally[:2], here) < math.dist(end[:2], here):
            end = rally
        return (*end[:2], max(height_m, end[2] + self.parameters["RTL_RETURN_ALT"]))

    def _return(self) -> None:
        """Fly to the end of the return, after the climb in a circle."""
        end = self._return_end
        if end is not None and self.flight.estimate.up_m >= end[2] - self.parameters["NAV_FW_ALT_RAD"]:
            self._return_end = None
            self._steer_circle(end[:2], self.parameters["RTL_LOITER_RAD"], end[2])

    def _switched(self, name: str) -> int:
        return ACCEPTED if self.set_mode(name) else DENIED

    # --- flying the mission (the runner's Pilot)

    def begin(self, item: MissionItem) -> None:
        """Start a navigation item."""
        if item.command == Command.NAV_RETURN_TO_LAUNCH:
            self.set_mode("RTL")
        elif self._mode == "RTL" and item.command in _LOITERS:  # A return by the mission does not wait.
            self._steer_item(replace(item, command=Command.NAV_WAYPOINT, parameters=(0.0, 0.0, 0.0, None)))
        else:
            self._steer_item(item)

    def begin_afresh(self) -> None:
        """Fly to the next item directly from here, not along the old leg."""
        self._previous = None

    def is_airborne(self) -> bool:
        """Return whether a takeoff has nothing left to do."""
        return not self.flight.is_standing

    def reached(self, sequence: int) -> None:
        """MISSION_ITEM_REACHED now, and again once a second for a while."""
        self._reached = sequence, _REACHED_REPEATS, self.now_us

    def mission_complete(self) -> None:
        """Hold round the last waypoint: the mode changes by itself."""
        self.say(mavlink.MAV_SEVERITY_INFO, "Mission finished, loitering")
        target = self.telemetry.target
        self.set_mode("LOITER")
        if target is not None:
            self._steer_circle(target[:2], self.parameters["WP_LOITER_RAD"], target[2])

    def tell_current(self) -> None:
        """Send MISSION_CURRENT at once, because the navigator has moved on by itself."""
        self.broadcast(self.mission_current())

    def _has_passed(self, leg: Leg, item: MissionItem) -> bool:
        """Within NAV_ACC_RAD of it or abeam, and near its height; the item's own radius is for copters."""
        is_there = self._distance_to_end(leg) <= self.parameters["NAV_ACC_RAD"] or self._is_abeam(leg)
        if item.command == Command.NAV_LAND:
            return is_there
        off = abs(self.flight.estimate.up_m - leg.height_m)
        return is_there and off <= self.parameters["NAV_FW_ALT_RAD"]

    def _position(self, item: MissionItem) -> Target:
        """East, north, up of an item [m]; a height that is no number leaves the present one."""
        east, north, up = super()._position(item)
        is_number = math.isfinite(up) and abs(up) < _FINITE_LIMIT_M
        return east, north, up if is_number else self.flight.estimate.up_m

    # --- messages and commands

    def _tell(self) -> None:
        """MISSION_CURRENT once a second, and MISSION_ITEM_REACHED ten times."""
        if self.now_us >= self._tell_us:
            self._tell_us = self.now_us + _SECOND_US
            self.tell_current()
            if self._has_unsupported_rally_frame():
                self.say(mavlink.MAV_SEVERITY_CRITICAL, "RTL: unsupported MAV_FRAME")
        if self._reached is not None and self.now_us >= self._reached[2]:
            sequence, left, due_us = self._reached
            self.broadcast(mavlink.MAVLink_mission_item_reached_message(sequence))
            self._reached = (sequence, left - 1, due_us + _SECOND_US) if left > 0 else None

    def _mission_message(self, channel: Channel, message: Message) -> None:
        self._transfer.handle(channel, message, self.now_us)

    def _note_station(self, channel: Channel, message: Message) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            self._stations.add(channel)

    def _traffic_message(self, _channel: Channel, message: Message) -> None:
        """Send a client's report back to it; the router forwards it to the others."""
        self._echo(message)

    def _echo(self, report: Message) -> None:
        values = [getattr(report, name) for name in report.fieldnames]
        values[report.fieldnames.index("flags")] &= _TRAFFIC_FLAGS
        index = report.fieldnames.index("callsign")
        if isinstance(values[index], str):
            values[index] = values[index].encode("ascii", "replace")
        self.broadcast(mavlink.MAVLink_adsb_vehicle_message(*values))

    def _mode_message(self, _channel: Channel, message: Message) -> None:
        if message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.set_mode(_NAMES.get(message.custom_mode, ""))

    def _mode_command(self, request: CommandRequest) -> int:
        """DO_SET_MODE, acknowledged twice: main and sub mode are two parameters."""
        if not int(request.parameters[0]) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        main, sub = int(request.parameters[1]) & 0xFF, int(request.parameters[2]) & 0xFF
        result = self._switched(_NAMES.get((sub << 24) | (main << 16), ""))
        request.channel.send(
            mavlink.MAVLink_command_ack_message(request.command, result, 0, 0, *request.sender)
        )
        return result

    def _start_command(self, request: CommandRequest) -> int:
        """Fly the mission from an item."""
        sequence = int(request.parameters[0])
        if not 0 <= sequence < len(self.mission_items):
            return DENIED
        self.runner.jump(sequence)
        result = self._switched("MISSION")
        self.tell_current()
        return result

    def _speed_command(self, request: CommandRequest) -> int:
        return ACCEPTED if self._change_speed(request.parameters[0], request.parameters[1]) else FAILED

    def _reposition_command(self, request: CommandRequest) -> int:
        """Hold round a point."""
        if not math.isfinite(request.z):
            return DENIED
        east, north = self.projection.local(request.latitude_e7 * 1e-7, request.longitude_e7 * 1e-7)
        self.set_mode("LOITER")
        radius = request.parameters[2] or self.parameters["WP_LOITER_RAD"]
        self._steer_circle((east, north), radius, self._height(request.frame, request.z, (east, north)))
        return ACCEPTED

    def _set_interval(self, request: CommandRequest) -> int:
        """SET_MESSAGE_INTERVAL; FAILED for a message that it does not have, or sends at its own rate."""
        if int(request.parameters[0]) not in self.telemetry.builders:
            return FAILED
        return super()._set_interval(request)
