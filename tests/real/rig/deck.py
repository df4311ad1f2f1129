"""All that a flight consists of, and what a scenario can do with it."""

import math
import random
import time

from tests.real.rig.autopilots import PORT_SERVICE, Autopilot
from tests.real.rig.ground_station import GroundStation
from tests.real.rig.relay import Relay, Tlog
from tests.real.rig.service_process import ServiceProcess

AIRBORNE_M = 15.0
LIMIT_S = {"near": 600.0, "paper": 900.0, "city": 700.0}
CIRCLING_S = 90.0  # so long within one small place: it circles
TOUCHED_S = 4.0  # flown on after an obstacle was touched
STANDING_S, STANDING_M = 20.0, 3.0  # so long in one spot: it stands


def room_taken(path, seconds):
    """How far the last of ``path``, rows of time and place, reach in each direction [m]."""
    rows = [place for stamp, *place in path if path[-1][0] - stamp <= seconds]
    return [max(axis) - min(axis) for axis in zip(*rows, strict=True)]


def is_standing(path):
    """Whether the last of ``path`` were spent in one spot.

    A PX4 does not always notice that it has landed, and then stays armed.
    """
    if not path or path[-1][0] - path[0][0] <= STANDING_S:
        return False
    return max(room_taken(path, STANDING_S)) < STANDING_M


class Deck:
    """One flight.

    Parameters
    ----------
    kind : Kind
        Of autopilot.
    binary : Path
        The user's own.
    parameters : str
        ArduPlane's parameter files.
    folder : Path
        Of everything that the flight leaves behind.
    instance : int
        Number that ports follow from.
    course : Course
        Map and missions.
    seed : int
        Of what is random.
    """

    def __init__(
        self, kind, binary, parameters, folder, instance, course, seed, *, loss=0.0, wind=(0.0, 0.0),
        autoland=4,
    ):  # fmt: skip
        self.kind, self.course, self.folder = kind, course, folder
        self.chance = random.Random(seed)
        self.events = []
        (folder / "mission.yaml").write_text(course.text, encoding="utf-8")
        self.tlogs = Tlog(folder / "operator.tlog"), Tlog(folder / "service.tlog")
        self.autopilot = Autopilot(kind, binary, parameters, folder / "autopilot", instance, course.home)
        self.relay = Relay(
            self.autopilot.companion_port, PORT_SERVICE + instance, self.tlogs[1], loss=loss, seed=seed
        )
        self.service = ServiceProcess(folder, PORT_SERVICE + instance)
        self.wind, self.autoland = wind, autoland
        self.station = None
        self.items = []

    def open(self):
        """Start the autopilot, and wait until it can be armed."""
        self.relay.start()
        self.autopilot.start(self.wind)
        self.station = GroundStation(self.autopilot, self.course, self.tlogs[0])
        self.station.start()
        self.station.connect()
        self.note("armable")

    def close(self):
        """End everything."""
        self.service.stop()
        if self.station is not None:
            self.station.end()
        self.autopilot.stop()
        self.relay.end()
        for tlog in self.tlogs:
            tlog.close()

    def note(self, what, **facts):
        """Write down that something happened."""
        self.events.append({"stamp_s": time.time(), "what": what, **facts})

    def first(self, what):
        """When something happened first; None if never."""
        return next((event["stamp_s"] for event in self.events if event["what"] == what), None)

    # --- on the ground

    def upload(self, items):
        """Upload the operator's mission, whose way to the takeover is clear."""
        self.course.check_departure(items)
        self.items = items
        result = self.station.upload(items)
        self.note("uploaded", result=result)
        assert result == 0, f"upload: {result}"

    def start_service(self):
        """Start the service and wait until it can plan."""
        self.note("service started")
        self.service.start()
        self.service.wait_ready()
        self.note("service ready")

    def take_off(self):
        """Arm, fly the mission, and wait until the aircraft is in the air."""
        self.station.fly()
        self.note("armed")
        ground_m = self.station.here[2]
        self.station.wait(lambda: self.station.here[2] > ground_m + AIRBORNE_M, 90.0, "airborne")
        self.note("airborne")

    # --- in the air

    def wait(self, is_so, patience_s, what):
        """Wait until something is so, while the flight goes on."""
        self.station.wait(lambda: is_so() or not self.station.is_armed, patience_s, what)
        assert self.station.is_armed, f"disarmed before: {what}"

    def pause(self, seconds):
        """Let the flight go on."""
        time.sleep(seconds)

    def is_entered(self):
        """Whether a mission of the service's is flown."""
        return bool(self.service.decisions("swap"))

    def wait_entered(self, patience_s=120.0):
        """Wait until the service's first mission is flown."""
        self.wait(self.is_entered, patience_s, "first mission entered")
        self.note("entered")

    def clearance_m(self):
        """Of the aircraft, now."""
        return self.course.clearance_m(self.station.here)

    def wait_roomy(self, patience_s=60.0):
        """Wait for a place where a pilot can hold: clear all round, some time ahead, too."""
        room = 1.5 * self.kind.loiter_radius_m + 20.0

        def is_roomy():
            rows = self.station.path
            if len(rows) < 12:
                return False
            (then, *before), (now, *here) = rows[-11], rows[-1]
            speed = [(b - a) / max(now - then, 0.1) for a, b in zip(before, here, strict=True)]
            ahead = [h + 3.0 * v for h, v in zip(here, speed, strict=True)]
            return min(self.course.clearance_m(here), self.course.clearance_m(ahead)) >= room

        self.wait(is_roomy, patience_s, f"{room:.0f} m of room")

    def fly_to_end(self):
        """Fly on until the aircraft stands, circles for good, touches something or the time is over."""
        end_s = time.monotonic() + LIMIT_S[self.course.goal]
        touched_s = math.inf
        began = time.time()
        while time.monotonic() < min(end_s, touched_s + TOUCHED_S):
            time.sleep(0.5)
            if not self.station.is_armed:
                self.note("disarmed")
                self.pause(3.0)
                return
            if is_standing(self.station.path):
                self.note("standing")
                return
            if touched_s == math.inf and self.clearance_m() <= 0.0:
                self.note("touched")
                touched_s = time.monotonic()
            if time.time() - began > CIRCLING_S and self._is_circling():
                self.note("circling")
                return
        self.note("end", limit=touched_s == math.inf)

    def _is_circling(self):
        """Whether the last minutes were flown within one small place, in no landing."""
        east, north, up = room_taken(self.station.path, CIRCLING_S)
        return max(east, north) < 500.0 * self.course.factor + 100.0 and up < 10.0
