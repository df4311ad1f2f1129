"""Real ground for real autopilots: a map of the user's own, read by other code than the service's, and flown.

GROUND names the SRTM tile S36E149 (`S36E149.hgt`, or a zip of it), the ground about ArduPlane's own field.
"""

import collections
import json
import math
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.config.sections.terrain_map import served_heights_of
from companion.frames import LocalFrame
from companion.link.messages.codec import Codec
from companion.link.messages.terrain_server import TerrainServer
from companion.link.wire.decoded_frame import Request
from tests.real.rig.autopilots import ARDUPLANE, Autopilot
from tests.real.rig.course import Item
from tests.real.rig.ground_station import GroundStation
from tests.real.rig.relay import Tlog
from tests.real.rig.service_process import ServiceProcess

FIELD = LocalFrame(-35.363262, 149.165237, 584.0)
HOME = (0.0, 0.0, 0.9)
BEFORE_FIX_M = 20_000.0  # Positions from before the first fix lie farther away.
TILE, POSTS = "S36E149.hgt", 1201
MISSION = """
name: mapped-ground
dimension: 3
unit_m: 25
origin: {{latitude_deg: -35.363262, longitude_deg: 149.165237, altitude_amsl_m: 584.0}}
bounds: {{east_m: [-6500, 1500], north_m: [-4000, 2500], up_m: [0, 500]}}
start: {{east_m: 0, north_m: 500, up_m: 120, course_deg: 0}}
goals:
{goals}
vehicle:
  airspeed_min_m_s: 12
  airspeed_max_m_s: 30
  airspeed_cruise_m_s: 22
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: 110
  straight_length_min_m: 110
  climb_angle_max_deg: 10
  descent_angle_max_deg: 10
  penetration_speed_m_s: 25
planning: {{sensing_horizon_m: 825, time_horizon_s: 15, total_planning_time_s: 600}}
terrain: {{file: {file}, height_min_m: 50, height_max_m: 140, item_frame: terrain}}
"""


class OwnGround:
    """The tile by its definition: posts every 3 seconds of arc from the north-west, big-endian metres."""

    def __init__(self, place):
        data = place.read_bytes()
        if place.suffix == ".zip":
            with zipfile.ZipFile(place) as tiles:
                data = tiles.read(TILE)
        self._posts = np.frombuffer(data, ">i2").reshape(POSTS, POSTS).astype(float)
        self.data = data

    def up_m(self, east_m, north_m):
        """Height above the field's origin [m], bilinear."""
        latitude, longitude = FIELD.places_from_local(np.asarray(east_m), np.asarray(north_m))
        row, column = (-35.0 - latitude) * 1200.0, (longitude - 149.0) * 1200.0
        j, i = np.floor(row).astype(int), np.floor(column).astype(int)
        v, u, posts = row - j, column - i, self._posts
        north = (1.0 - u) * posts[j, i] + u * posts[j, i + 1]
        south = (1.0 - u) * posts[j + 1, i] + u * posts[j + 1, i + 1]
        return (1.0 - v) * north + v * south - FIELD.altitude_amsl_m

    def over(self, east_m, north_m, height_m):
        """A place at a height over ground [m]."""
        return east_m, north_m, float(self.up_m([east_m], [north_m])[0]) + height_m


class FieldCourse:
    """Places about the field, in metres east, north and up of it."""

    frame, factor = FIELD, 1.0

    def globally(self, place):
        return FIELD.global_from_local(*place)


@dataclass(frozen=True)
class OverGround(Item):
    """A waypoint at a height over ground; its place's third number is that height [m]."""

    frame: int = mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT


class SupplyingStation(GroundStation):
    """A ground station that may answer TERRAIN_REQUEST, as usual ones do, and hears TERRAIN_REPORT."""

    def __init__(self, autopilot, course, tlog, server=None):
        super().__init__(autopilot, course, tlog)
        self._server, self._codec = server, Codec(255)
        self.reports = []  # time, pending, loaded, spacing

    def _hear(self, message, now):
        super()._hear(message, now)
        if message.get_type() == "TERRAIN_REPORT":
            self.reports.append((now, message.pending, message.loaded, message.spacing))
        elif message.get_type() == "TERRAIN_REQUEST" and self._server is not None:
            asked = Request("terrain", 0, 0, message.mask, (message.lat, message.lon, message.grid_spacing))
            self._link.write(self._server.answer(asked, self._codec))


class GroundFlight:
    """A flight of a real ArduPlane over the tile, with the service or without.

    Parameters
    ----------
    binary : Path
        ArduPlane.
    parameters : str
        Its files of parameters, with commas between them.
    tile : Path
        The map.
    folder : Path
        Of everything that the flight leaves behind.
    goals : list of tuple
        East, north, up of the service's goals [m].
    instance : int
        Number that its ports follow from.
    """

    def __init__(self, binary, parameters, tile, folder, goals, instance):
        folder.mkdir(parents=True, exist_ok=True)
        self.ground, self.folder = OwnGround(tile), folder
        (folder / TILE).write_bytes(self.ground.data)
        listed = "".join(
            f"  - {{east_m: {east}, north_m: {north}, up_m: {up:.1f}, acceptance_radius_m: 80}}\n"
            for east, north, up in goals
        )
        self.text = MISSION.format(goals=listed, file=folder / TILE)
        (folder / "mission.yaml").write_text(self.text, encoding="utf-8")
        extra = folder / "terrain.parm"
        extra.write_text("TERRAIN_ENABLE 1\n", encoding="utf-8")
        home = FIELD.global_from_local(*HOME)
        files = ",".join(filter(None, (parameters, str(extra))))
        self.autopilot = Autopilot(ARDUPLANE, binary, files, folder / "autopilot", instance, home)
        self.service = ServiceProcess(folder, self.autopilot.companion_port)
        self._tlog = Tlog(folder / "operator.tlog")
        self.station = None

    def open(self, *, supplies=False, serves=False):
        """Start the autopilot, with a station that supplies heights or with the service."""
        server = None
        if supplies:
            server = TerrainServer(served_heights_of(mission_from_text(self.text, "mission.yaml")))
        if serves:
            self.service.start()
            self.service.wait_ready()
        self.autopilot.start()
        self.station = SupplyingStation(self.autopilot, FieldCourse(), self._tlog, server)
        self.station.start()
        self.station.connect()
        self.station.command(
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT, 500_000.0
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """End everything, and write down what was flown."""
        self.service.stop()
        if self.station is not None:
            self.station.end()
            document = {
                "least_m": float(self.heights_m(1000.0).min(initial=math.inf)),
                "path": self.station.path, "reports": self.station.reports, "texts": list(self.station.texts),
            }  # fmt: skip
            (self.folder / "flight.json").write_text(json.dumps(document), encoding="utf-8")
        self.autopilot.stop()
        self._tlog.close()

    def has_all(self):
        """Whether the autopilot has heights, and waits for none."""
        return any(loaded > 0 and pending == 0 for _, pending, loaded, _ in self.station.reports[-3:])

    def fly(self, items, until, limit_s):
        """Upload, take off, and fly until a function of the aircraft's place is true; whether it was."""
        station = self.station
        assert station.upload(items) == 0
        station.fly()
        end_s = time.monotonic() + limit_s
        while time.monotonic() < end_s and not until(station.here):
            time.sleep(0.1)
        return until(station.here)

    def heights_m(self, from_m=300.0):
        """Heights over ground of the flight, farther than ``from_m`` from home, (N,) [m]."""
        path = np.array(self.station.path)[:, 1:]
        away = np.hypot(path[:, 0], path[:, 1])
        path = path[(away > from_m) & (away < BEFORE_FIX_M)]
        return path[:, 2] - self.ground.up_m(path[:, 0], path[:, 1])

    def frames(self):
        """Frames of the waypoints that the service has uploaded."""
        found = collections.Counter()
        for file in self.folder.glob("recordings/**/*.tlog"):
            log = mavutil.mavlink_connection(str(file))
            while (message := log.recv_match(type="MISSION_ITEM_INT")) is not None:
                is_ours = message.get_srcComponent() == mavlink.MAV_COMP_ID_PATHPLANNER
                found[message.frame] += is_ours and message.command == mavlink.MAV_CMD_NAV_WAYPOINT
            log.close()
        return found


def near(place, within_m):
    """Whether the aircraft is near a place, on the map."""
    return lambda here: math.dist(here[:2], place[:2]) <= within_m


def tile_named(environment):
    """The map that the environment names; None where there is none."""
    return Path(environment["GROUND"]).resolve() if environment.get("GROUND") else None
