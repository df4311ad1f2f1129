"""A mission file's world for the page: one document, and the radars' field at any height."""

from __future__ import annotations

import base64
import json
import math
import threading

import numpy as np

from companion.config import MissionConfig, mission_from_text
from companion.config.compose import bounds_of, world_of
from companion.config.sections.terrain_map import ground_heights_of
from companion.errors import ConfigError
from companion.recording.mcap_writer import plain
from companion.ui.page.ground import CELLS, Ground, height_grid
from companion.world.snapshot import Snapshot
from companion.world.threat_field import sight_floor, threat_field

WORLD = "/world"
HEIGHT_STEP_M = 10.0  # The field's height is rounded to this.
FIELDS_KEPT = 64
BELOW_M = 500.0  # Floors of radars are sent down to this far below the bounds.
FLOORS_MAX = 24  # Most radars whose floors are drawn; the mission file's come first.
_CELLS = 160  # Cells along the longer side.


class WorldDocument:
    """A mission's world for the page.

    Parameters
    ----------
    mission_text : str
        The mission file.
    name : str
        The file's name, for error messages.
    """

    def __init__(self, mission_text: str, name: str) -> None:
        self._fields: dict[float, bytes] = {}
        self._snapshot: Snapshot | None = None
        self._building: threading.Thread | None = None
        self._mission: MissionConfig | None = None
        self._ground: bytes | None = None
        self._floors: bytes | None = None
        try:
            mission = mission_from_text(mission_text, name)
        except ConfigError as error:  # The recording is of another version.
            self.document = _json({"error": str(error)})
            return
        self.document = _json(_document(mission))
        self._mission = mission
        if mission.radar_list:
            self._building = threading.Thread(
                target=self._build, args=(mission,), name="shadows", daemon=True
            )
            self._building.start()

    def _build(self, mission: MissionConfig) -> None:
        """Compute the radars' shadows, in a second or more, in compiled code and in a thread of their own."""
        self._snapshot = world_of(mission, none_known=False)

    def finish(self) -> None:
        """Wait until the fields are ready."""
        if self._building is not None:
            self._building.join()

    @property
    def knows_ground(self) -> bool:
        """Whether the mission file names a map of heights."""
        return self._mission is not None and self._mission.terrain is not None

    def ground(self, ground: Ground | None) -> bytes:
        """Return the tiles around the mission, and the ground's heights; empty if they cannot be read.

        The heights are the mission file's, where it has a map.
        """
        if self._ground is None:
            mission, found = self._mission, dict[str, object]()
            if mission is not None and ground is not None:
                found = ground.document(mission.frame, bounds_of(mission))
            if mission is not None and (heights := _heights(mission)) is not None:
                found = {"area_m": bounds_of(mission)[:4], **found, "heights": heights}
            self._ground = _json(found)
        return self._ground

    def field(self, height_m: float) -> bytes:
        """Return the radars' joint membership, masked, at a height that is rounded to 10 m.

        Levels are bytes, 255 for 1, in base64: rows from south to north, each from west to east. While
        the shadows are being computed, the answer says so instead.
        """
        if self._snapshot is None or not math.isfinite(height_m):
            return self._later()
        low, high = self._snapshot.bounds[4:]
        height = HEIGHT_STEP_M * round(min(max(height_m, low), high) / HEIGHT_STEP_M)
        if height not in self._fields:
            if len(self._fields) >= FIELDS_KEPT:
                self._fields.pop(next(iter(self._fields)))
            east, north, level = threat_field(self._snapshot, height, _CELLS)
            cells = np.round(255.0 * level).astype(np.uint8)
            self._fields[height] = _json(
                {
                    "height_m": height,
                    "west_m": east[0],
                    "south_m": north[0],
                    "spacing_m": float(east[1] - east[0]),
                    "columns": len(east),
                    "rows": len(north),
                    "levels": base64.b64encode(cells.tobytes()).decode("ascii"),
                }
            )
        return self._fields[height]

    def floors(self) -> bytes:
        """The height above which each radar sees, in the order of the mission file, or that it is computed.

        Heights are cut off above and below the bounds; beyond a radar's range there is none.
        """
        snapshot = self._snapshot
        if snapshot is None:
            return self._later()
        if self._floors is None:
            found = [_floor(snapshot, number) for number in range(len(snapshot.radar_list[:FLOORS_MAX]))]
            self._floors = _json({"radars": found})
        return self._floors

    def _later(self) -> bytes:
        return _json({"is_later": self._building is not None and self._building.is_alive()})


def _json(document: dict[str, object]) -> bytes:
    return json.dumps(plain(document), allow_nan=False, separators=(",", ":")).encode("ascii")


def _floor(snapshot: Snapshot, number: int) -> dict[str, object] | None:
    """Return the height above which a radar sees; None for a radar whose range is outside of the bounds."""
    floor, grid = sight_floor(snapshot, number)
    low, high = snapshot.bounds[4:]
    return None if np.isnan(floor).all() else height_grid(floor.clip(low - BELOW_M, high), grid)


def _heights(mission: MissionConfig) -> dict[str, object] | None:
    """Heights of the mission file's map over the bounds; None without a map."""
    ground, bounds = ground_heights_of(mission), bounds_of(mission)
    if ground is None:
        return None
    spacing = max(bounds[1] - bounds[0], bounds[3] - bounds[2]) / CELLS
    east, north = (np.arange(low, high + 0.5 * spacing, spacing) for low, high in (bounds[:2], bounds[2:4]))
    places = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    up = ground.up_m(places).reshape(len(north), len(east))
    return height_grid(up, (bounds[0], bounds[2], spacing))


def _document(mission: MissionConfig) -> dict[str, object]:
    """Return the answer to ``/world`` about a mission."""
    start, origin, planning, vehicle = mission.start, mission.origin, mission.planning, mission.vehicle
    goals = [] if mission.goals_from_autopilot else mission.goals
    return {
        "name": mission.name,
        "description": mission.description,
        "dimension": mission.dimension,
        "bounds_m": bounds_of(mission),
        "origin": {"latitude_deg": origin.latitude_deg, "longitude_deg": origin.longitude_deg},
        "start_enu_m": [start.east_m, start.north_m, start.up_m],
        "goals": [[goal.east_m, goal.north_m, goal.up_m, goal.acceptance_radius_m] for goal in goals],
        "obstacles": mission.obstacle_list,
        "radars": mission.radar_list,
        "dynamic_threats": mission.dynamic_threat_list,
        "sensing_horizon_m": planning.sensing_horizon_m,
        "threat_level_max": planning.threat_level_max,
        "clearance_min_m": planning.clearance_min_m,
        "airspeed_cruise_m_s": vehicle.airspeed_cruise_m_s,
        "airspeed_min_m_s": vehicle.airspeed_min_m_s,
        "airspeed_max_m_s": vehicle.airspeed_max_m_s,
        "resume": mission.authority.resume,
        "terrain": None if mission.terrain is None else mission.terrain.model_dump(exclude={"file"}),
    }
