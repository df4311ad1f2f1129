"""The operator: a ground station that uploads, arms and switches modes, and sees what the aircraft does."""

import collections
import queue
import struct
import threading
import time

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.real.rig.autopilots import ARDUPLANE, coordinate_frame, is_mission_mode

STREAMS = {  # by number of the message, the rate [Hz]
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 5.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 5.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 5.0,
}
ANSWER_S, TRIES = 2.0, 5
IN_PROGRESS = mavlink.MAV_RESULT_IN_PROGRESS


class GroundStation(threading.Thread):
    """One end of the operator's link.

    Parameters
    ----------
    autopilot : Autopilot
        Running.
    course : Course
        Where items lie.
    tlog : Tlog
        Gets every frame, both ways.
    """

    def __init__(self, autopilot, course, tlog):
        super().__init__(name="ground station", daemon=True)
        self.kind, self._course, self._tlog = autopilot.kind, course, tlog
        self._expected = autopilot.system_id
        self._link = mavutil.mavlink_connection(
            autopilot.operator_url, source_system=255, source_component=190, dialect="ardupilotmega"
        )
        self._link.mav.set_send_callback(self._note_sent)
        self._lock = threading.Lock()
        self._answers = queue.Queue()
        self._is_ending = False
        self.system = None
        self.latest = {}
        self.path = []  # time, east, north, up
        self.texts = collections.deque(maxlen=2000)  # time, component, text

    def _note_sent(self, message, *_):
        self._tlog.write(message.get_msgbuf())

    def send(self, message):
        """Send a message, from any thread."""
        with self._lock:
            self._link.mav.send(message)

    # --- what is heard

    def run(self):
        beat_s = 0.0
        while not self._is_ending:
            now = time.monotonic()
            if now - beat_s >= 0.5:
                beat_s = now
                self.send(mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                ))  # fmt: skip
            try:
                message = self._link.recv_match(blocking=True, timeout=0.2)
            except OSError:  # refused while the autopilot does not listen yet
                time.sleep(0.1)
                continue
            if message is not None:
                self._hear(message, time.time())

    def _hear(self, message, now):
        kind, component = message.get_type(), message.get_srcComponent()
        if kind == "BAD_DATA":
            return
        self._tlog.write(message.get_msgbuf(), now)
        if kind == "STATUSTEXT":
            self.texts.append((now, component, message.text))
        if (message.get_srcSystem(), component) != (self._expected, mavlink.MAV_COMP_ID_AUTOPILOT1):
            return
        if kind == "HEARTBEAT" and self.system is None:
            self.system = message.get_srcSystem()
        self.latest[kind] = message
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "COMMAND_ACK"):
            self._answers.put(message)
        elif kind == "GLOBAL_POSITION_INT" and message.lat:
            place = self._course.frame.local_from_global(
                1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt
            )
            self.path.append((now, *place))

    @property
    def is_armed(self):
        beat = self.latest.get("HEARTBEAT")
        return beat is not None and bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def is_in_mission(self):
        beat = self.latest.get("HEARTBEAT")
        return beat is not None and is_mission_mode(self.kind, beat.custom_mode)

    @property
    def here(self):
        """East, north, up [m]."""
        return self.path[-1][1:]

    @property
    def sequence(self):
        """Item being flown."""
        current = self.latest.get("MISSION_CURRENT")
        return None if current is None else current.seq

    # --- what is asked

    def wait(self, is_so, patience_s, what):
        """Wait until something is so."""
        end_s = time.monotonic() + patience_s
        while not is_so():
            assert time.monotonic() < end_s, f"{what}: not within {patience_s:g} s"
            time.sleep(0.05)

    def connect(self):
        """Wait for the autopilot, ask for what is watched, and wait until it can be armed."""
        self.wait(lambda: self.system is not None, 60.0, "heartbeat")
        for number, rate in STREAMS.items():
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / rate)
        self.wait(lambda: self.path and self._can_arm(), 120.0, "armable")

    def _can_arm(self):
        status = self.latest.get("SYS_STATUS")
        return status is not None and bool(
            status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
        )

    def _answer(self, kinds, is_it, within_s):
        """The next answer of some kinds."""
        end_s = time.monotonic() + within_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            try:
                message = self._answers.get(timeout=left_s)
            except queue.Empty:
                break
            if message.get_type() in kinds and is_it(message):
                return message
        return None

    def _forget_answers(self):
        while not self._answers.empty():
            self._answers.get_nowait()

    def command(self, number, *parameters):
        """Send a command until it is answered; its result."""
        values = [*parameters, *[0.0] * (7 - len(parameters))]
        self._forget_answers()
        for turn in range(TRIES):
            self.send(mavlink.MAVLink_command_long_message(self.system, 1, number, turn, *values))
            answer = self._answer(
                ("COMMAND_ACK",), lambda ack: ack.command == number and ack.result != IN_PROGRESS, ANSWER_S
            )
            if answer is not None:
                return answer.result
        return None

    def set_parameter(self, name, value):
        """Set one."""
        self.send(mavlink.MAVLink_param_set_message(
            self.system, 1, name.encode("ascii"), value, mavlink.MAV_PARAM_TYPE_REAL32
        ))  # fmt: skip

    def set_integer(self, name, value):
        """Set a PX4's integer parameter, which is sent as its bytes."""
        as_float = struct.unpack("<f", struct.pack("<i", value))[0]
        self.send(mavlink.MAVLink_param_set_message(
            self.system, 1, name.encode("ascii"), as_float, mavlink.MAV_PARAM_TYPE_INT32
        ))  # fmt: skip

    def set_mode(self, wanted):
        """Select a mode by what it is for."""
        main, sub = self.kind.modes[wanted]
        flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, flag, main, sub)

    def upload(self, items, mission_type=mavlink.MAV_MISSION_TYPE_MISSION):
        """Upload items; the result of the last answer."""
        is_mission = mission_type == mavlink.MAV_MISSION_TYPE_MISSION
        offset = self.kind.num_home_items if is_mission else 0
        count = len(items) + offset
        self._forget_answers()
        self.send(mavlink.MAVLink_mission_count_message(self.system, 1, count, mission_type))
        while True:
            request = self._answer(
                ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"),
                lambda message: message.mission_type == mission_type,
                10.0,
            )
            assert request is not None, "the upload was not answered"
            if request.get_type() == "MISSION_ACK":
                return request.type
            number = request.seq - offset
            item = items[number] if number >= 0 else None
            self.send(self._wire_item(request.seq, item, mission_type, number))

    def _wire_item(self, sequence, item, mission_type, number):
        frame, command, parameters = mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0,) * 4
        latitude = longitude = altitude = 0.0
        if item is not None:
            frame, command, parameters = coordinate_frame(item), item.command, item.parameters
            if item.place is not None:
                latitude, longitude, _ = self._course.globally(item.place)
                altitude = self._course.factor * item.place[2]
        return mavlink.MAVLink_mission_item_int_message(
            self.system, 1, sequence, frame, command, int(number == 0 and self.kind is not ARDUPLANE), 1,
            *parameters, round(1e7 * latitude), round(1e7 * longitude), altitude, mission_type,
        )  # fmt: skip

    def set_current(self, number):
        """Have another item flown, as a ground station's operator chooses it."""
        sequence = number + self.kind.num_home_items
        if self.kind is ARDUPLANE:
            return self.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, sequence)
        self.send(mavlink.MAVLink_mission_set_current_message(self.system, 1, sequence))
        return 0

    def fly(self):
        """Select the mission mode and arm, as often as it takes."""
        for _ in range(20):
            modes, arms = self.set_mode("mission"), self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            if modes == 0 and arms == 0:
                self.wait(lambda: self.is_armed, 10.0, "armed")
                return
            time.sleep(2.0)
        raise AssertionError(f"not armed: {[text for _, _, text in self.texts][-5:]}")

    def end(self):
        self._is_ending = True
        self.join(2.0)
        self._link.close()
