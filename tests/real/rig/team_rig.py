"""Real autopilots of a team: each with its service, and a radio between them that loses and delays."""

import heapq
import itertools
import random
import select
import socket
import threading
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.team.simulated_radio import CARRIED
from tests.real.rig.autopilots import ARDUPLANE, PORT_SERVICE, Autopilot
from tests.real.rig.course import DESCENT_RADIUS_M, HOLD_RADIUS_M, Course, Item
from tests.real.rig.ground_station import GroundStation
from tests.real.rig.relay import Framer, Relay, Tlog
from tests.real.rig.service_process import ServiceProcess

# At one height, from both sides through a wall's gap: home, takeoff, the operator's circle, and the goal.
PLACES = (
    ((4750.0, 100.0, 0.0), (4750.0, 700.0, 150.0), (4650.0, 1000.0, 150.0), (4800.0, 4250.0, 150.0)),
    ((4880.0, 2400.0, 0.0), (4900.0, 3350.0, 150.0), (4650.0, 3550.0, 150.0), (3900.0, 500.0, 150.0)),
)
SHARED_GOALS = (
    (4800.0, 4250.0, 150.0), (3900.0, 500.0, 150.0), (3850.0, 2700.0, 150.0), (2800.0, 1650.0, 150.0)
)  # fmt: skip
# The first one's goal lies in the only gap that is left, the other's behind it.
BARRED_GOALS = ((3800.0, 2150.0, 150.0), (3900.0, 500.0, 150.0))
OTHER_GAP = [[1500.0, 2100.0], [1900.0, 2100.0], [1900.0, 2200.0], [1500.0, 2200.0]]
ACCEPTED_M = 60.0
LATE_S = (0.1, 0.5)


class MemberCourse(Course):
    """The map as one member flies it.

    Parameters
    ----------
    number : int
        Which of ``PLACES``.
    factor : float
        Size of the map.
    changes : dict
        Sections of the mission file with keys to set.
    scene : str
        ``barred``: the first one bars the way of the other, and circles there, because nobody lands;
        ``open``: without obstacles, so that both go on to their landings.
    """

    def __init__(self, number, factor, changes, *, scene=""):
        self._home, self._takeoff, self._circle, goal = PLACES[number]
        self._lands = scene != "barred"
        super().__init__(factor, "near", changes | ({"obstacles": []} if scene == "open" else {}))
        if scene == "barred":
            goal = BARRED_GOALS[number]
            wall = {"name": "plug", "base_m": 0.0, "top_m": 1000.0 * factor}
            corners = [[factor * east, factor * north] for east, north in OTHER_GAP]
            self.document["obstacles"].append({**wall, "polygon_enu_m": corners})
        shares_goals = changes.get("team", {}).get("share_goals", False)
        self.goals = [self.local(place) for place in (SHARED_GOALS if shares_goals else (goal,))]
        self.document["goals"] = [
            {"east_m": east, "north_m": north, "up_m": up, "acceptance_radius_m": ACCEPTED_M * factor}
            for east, north, up in self.goals
        ]

    @property
    def home(self):
        """Latitude, longitude [deg] and altitude [m] of the place it starts from."""
        return self.globally(self._home)

    @property
    def items(self):
        """The operator's mission: take off, circle, and land at home. Without a landing no PX4 arms."""
        circle = (0.0, 0.0, self.factor * HOLD_RADIUS_M, 0.0)
        down = (0.0, self.factor * DESCENT_RADIUS_M, 0.0, 1.0)
        up = [
            Item(mavlink.MAV_CMD_NAV_TAKEOFF, (12.0, 0.0, 0.0, 0.0), self._takeoff),
            Item(mavlink.MAV_CMD_NAV_LOITER_UNLIM, circle, self._circle),
        ]
        if not self._lands:
            return up
        return [
            *up,
            Item(mavlink.MAV_CMD_DO_LAND_START),
            Item(mavlink.MAV_CMD_NAV_LOITER_TO_ALT, down, (*self._circle[:2], 60.0)),
            Item(mavlink.MAV_CMD_NAV_LAND, place=self._home),
        ]


class Radio(threading.Thread):
    """Passes frames of each aircraft to all others, late, and loses a share of them.

    Parameters
    ----------
    ports : dict of int to int
        By system id, the port to which an autopilot sends.
    loss : float
        Share of the frames that is lost, for each receiver by itself.
    seed : int
        Which are lost, and how late the others are.
    """

    def __init__(self, ports, *, loss, seed):
        super().__init__(name="radio", daemon=True)
        self._sockets = {}
        for system_id, port in ports.items():
            self._sockets[system_id] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._sockets[system_id].bind(("127.0.0.1", port))
        self._framers = {system_id: Framer() for system_id in ports}
        self._autopilots = {}
        self._loss, self._chance = loss, random.Random(seed)
        self._under_way, self._order = [], itertools.count()
        self._is_ending = False
        self.num_bytes = dict.fromkeys(ports, 0)

    def run(self):
        while not self._is_ending:
            ready, _, _ = select.select(list(self._sockets.values()), [], [], 0.02)
            for system_id, link in self._sockets.items():
                if link in ready:
                    data, self._autopilots[system_id] = link.recvfrom(65_535)
                    for frame in self._framers[system_id].frames(data):
                        self._take(system_id, frame)
            while self._under_way and self._under_way[0][0] <= time.monotonic():
                _, _, receiver, frame = heapq.heappop(self._under_way)
                self._sockets[receiver].sendto(frame, self._autopilots[receiver])

    def _take(self, sender, frame):
        """Send a frame of the sender's own on its way to each receiver."""
        number = int.from_bytes(frame[7:10], "little")
        if frame[0] != mavlink.PROTOCOL_MARKER_V2 or frame[5] != sender or number not in CARRIED:
            return
        self.num_bytes[sender] += len(frame) if number == mavlink.MAVLINK_MSG_ID_TUNNEL else 0
        for receiver in self._autopilots:
            if receiver != sender and self._chance.random() >= self._loss:
                due_s = time.monotonic() + self._chance.uniform(*LATE_S)
                heapq.heappush(self._under_way, (due_s, next(self._order), receiver, frame))

    def end(self):
        """Close all links."""
        self._is_ending = True
        self.join(2.0)
        for link in self._sockets.values():
            link.close()


class Member:
    """One aircraft with its autopilot, its operator and its service.

    Parameters
    ----------
    kind : Kind
        Of autopilot.
    binaries : Binaries
        The user's own.
    folder : Path
        Of everything that the flight leaves behind.
    number : int
        Which of ``PLACES``.
    instance : int
        Number that ports follow from.
    team : dict
        The section ``team`` of the mission file; empty without one.
    scene : str
        As for :class:`MemberCourse`.
    """

    def __init__(self, kind, binaries, folder, number, instance, team, *, scene=""):
        folder.mkdir(parents=True)
        self.system_id = instance + 1
        changes = {
            "vehicle": kind.vehicle, "origin": {"altitude_amsl_m": kind.altitude_amsl_m},
            "link": {"vehicle_system_id": self.system_id}, **({"team": team} if team else {}),
            "dimension": 2, "start": {"up_m": 150.0 * kind.factor}, "dynamic_threats": [],
        }  # fmt: skip
        self.course = MemberCourse(number, kind.factor, changes, scene=scene)
        (folder / "mission.yaml").write_text(self.course.text, encoding="utf-8")
        self._tlogs = Tlog(folder / "operator.tlog"), Tlog(folder / "service.tlog")
        self.autopilot = Autopilot(
            kind, binaries.of(kind.name), binaries.parameters if kind is ARDUPLANE else "",
            folder / "autopilot", instance, self.course.home, self.system_id, has_radio=True,
        )  # fmt: skip
        self._relay = Relay(self.autopilot.companion_port, PORT_SERVICE + instance, self._tlogs[1])
        self.service = ServiceProcess(folder, PORT_SERVICE + instance)
        self.station = None

    def open(self):
        """Start the autopilot and the service, and have the operator's mission stored."""
        self._relay.start()
        self.autopilot.start()
        self.station = GroundStation(self.autopilot, self.course, self._tlogs[0])
        self.station.start()
        self.station.connect()
        assert self.station.system == self.system_id
        assert self.station.upload(self.course.items) == 0
        self.service.start()
        self.service.wait_ready()

    @property
    def path(self):
        """Time, east, north, up of each position so far [s], [m]."""
        return [] if self.station is None else self.station.path

    def has_arrived(self):
        """Whether the service has reached the goal."""
        return bool(self.service.decisions("arrived"))

    def close(self):
        """End everything."""
        self.service.stop()
        if self.station is not None:
            self.station.end()
        self.autopilot.stop()
        self._relay.end()
        for tlog in self._tlogs:
            tlog.close()
