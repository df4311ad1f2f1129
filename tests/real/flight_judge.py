"""What became of a flight: the way truly flown, and every mission held, by the project's own checker.

As the judge of ``tests.torture`` does: from where the aircraft is, the point that the autopilot tells it
steers for and the items that it would fly next, as its steering flies them, have to be clear, within the
bounds, and end in a circle; from the service's first mission on, and only while the mission is flown.
Landings are the operator's.
"""

import heapq
import json
import math
from dataclasses import replace

import numpy as np
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.assurance.checker import Checker
from companion.config import mission_from_text
from companion.config.compose import check_limits_of, vehicle_of
from companion.types.mission import Command
from companion.types.state import Ownship
from companion.types.threat import Obstacle
from companion.world.vehicle.guidance import default_guidance, track_of_legs
from tests.real.held_missions import HeldMission, messages_of
from tests.real.rig.autopilots import KINDS, is_mission_mode
from tests.real.rig.deck import is_standing
from tests.real.rig.service_process import entries_of
from tests.real.said_return import farthest_from, said_return
from tests.real.scenarios import BY_NUMBER

BEYOND_M = 30.0  # of the bounds, which are planned to and not walls: a turn may pass them by so much
CIRCLED_S = 20.0  # of the circle at the end
LOITERS = frozenset({17, 18, 19, 31})
SETTLED_S = 1.5  # after a change of the list, until the telemetry of before is over
JUDGED_EACH_S = 0.5
LAND = (Command.DO_LAND_START, Command.NAV_LAND, Command.DO_JUMP)
ENDS = (
    Command.NAV_LAND,
    Command.DO_JUMP,
)  # of a way; a landing's first item is passed, and one jump followed
SAME_M = 5.0
SERVICE, OPERATOR = 195, 190
CHANGING = {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_WRITE_PARTIAL_LIST", "MISSION_SET_CURRENT"}
YIELD_S = 4.0  # for the service to notice that somebody else uploads
JOINED_S = 3.0  # An ArduPlane that returns by a path flies its mission again from this time on.


class FlightJudge:
    """Reads a flight's folder.

    Parameters
    ----------
    folder : Path
        As a flight leaves it.
    """

    def __init__(self, folder):
        self.folder = folder
        self.flight = json.loads((folder / "flight.json").read_text(encoding="utf-8"))
        self.kind = KINDS[self.flight["kind"]]
        self.scenario = BY_NUMBER[self.flight["scenario"]]
        self.mission = mission_from_text(
            (folder / "mission.yaml").read_text(encoding="utf-8"), "mission.yaml"
        )
        self.frame = self.mission.frame
        self.log = [entry for path in sorted(folder.glob("service-*.log")) for entry in entries_of(path)]
        self.path = np.array(self.flight["path"]).reshape(-1, 4)
        self.fence_s, self.fence = self._fence()
        self.violations = []
        self.num_judged = 0
        flies_by = self.kind.num_home_items > 0
        self._guidance = default_guidance(flies_by=flies_by, vehicle=vehicle_of(self.mission))
        self.held = HeldMission(in_place=self.kind.num_home_items > 0)
        self._late_changes = 0
        self._returns_by_path = False

    # --- what is read off

    def event(self, what):
        """When something happened first; None if never."""
        stamps = [event["stamp_s"] for event in self.flight["events"] if event["what"] == what]
        return stamps[0] if stamps else None

    def decided(self, kind):
        """Decisions of a kind."""
        return [entry for entry in self.log if entry.get("decision") == kind]

    def _fence(self):
        found = [event for event in self.flight["events"] if event["what"] == "fence"]
        if not found or found[0]["result"] != 0:
            return math.inf, None
        return found[0]["stamp_s"], shapely.Polygon(found[0]["polygon"])

    @property
    def takeover_s(self):
        """When the service took over; None if never."""
        stamps = [
            entry["stamp_s"]
            for entry in self.log
            if entry.get("decision") == "mode" and "mode: planning" in entry["message"]
        ]
        return stamps[0] if stamps else None

    @property
    def entered_s(self):
        """When its first mission was entered; None if never."""
        swaps = self.decided("swap")
        return swaps[0]["stamp_s"] if swaps else None

    def up_at(self, stamp_s):
        """Height at an instant [m]."""
        if stamp_s is None or not len(self.path):
            return None
        return float(np.interp(stamp_s, self.path[:, 0], self.path[:, 3]))

    # --- the way flown

    def clearance(self):
        """Smallest distance to an obstacle from the takeover on, when, and to what."""
        begin_s = self.takeover_s or self.entered_s
        rows = self.path[self.path[:, 0] >= begin_s] if begin_s is not None else self.path[:0]
        smallest = (math.inf, 0.0, "")
        if not len(rows):
            return smallest
        points = shapely.points(rows[:, 1:3])
        prisms = [
            (
                obstacle.name,
                shapely.Polygon(obstacle.polygon_enu_m),
                float(obstacle.base_m),
                float(obstacle.top_m),
            )
            for obstacle in self.mission.obstacles
        ]
        for name, polygon, base, top in prisms:
            away = shapely.distance(points, polygon)
            beside = np.maximum(np.maximum(base - rows[:, 3], rows[:, 3] - top), 0.0)
            total = np.hypot(away, beside)
            smallest = min(smallest, (float(total.min()), float(rows[total.argmin(), 0]), name))
        if self.fence is not None:
            away = shapely.distance(points, self.fence)
            away[rows[:, 0] < self.fence_s] = math.inf
            smallest = min(smallest, (float(away.min()), float(rows[away.argmin(), 0]), "fence"))
        return smallest

    def goal_reached_s(self):
        """When the last goal's circle was entered; None if never."""
        goal = self.mission.goals[-1] if self.mission.goals else None
        place = np.array([goal.east_m, goal.north_m, goal.up_m]) if goal else self._operators_goal()
        radius = goal.acceptance_radius_m if goal else 60.0 * self.kind.factor
        away = np.linalg.norm(self.path[:, 1:4] - place, axis=1)
        inside = np.flatnonzero(away <= radius)
        return float(self.path[inside[0], 0]) if len(inside) else None

    def _operators_goal(self):
        from tests.real.rig.course import GOALS  # noqa: PLC0415  (only where the mission file has none)

        return self.kind.factor * np.array(GOALS[self.scenario.goal])

    # --- the missions held

    def judge_missions(self):
        """Go through everything that was said, and judge what the autopilot holds."""
        limits = check_limits_of(self.mission)
        east0, east1, north0, north1, low, high = limits.bounds
        wider = (east0 - BEYOND_M, east1 + BEYOND_M, north0 - BEYOND_M, north1 + BEYOND_M, low, high)
        limits = replace(limits, bounds=wider, margin_m=0.0, altitude_tolerance_m=40.0)
        checkers = (
            Checker(self.mission.obstacle_list, limits),
            Checker((*self.mission.obstacle_list, *self._fence_obstacle()), limits),
        )
        begin_s = self.entered_s or math.inf  # until then the list is the operator's, walls on its way
        other_s = self.event("other mission") or math.inf
        return_s = self.event("return") or math.inf
        self._here = self._target = self._current = self._from = None
        self._velocity, self._bank, self._yaw, self._airspeed = (0.0, 0.0), 0.0, 0.0, 0.0
        is_flown, next_s = False, 0.0
        for stamp_s, source, message in self._everything():
            if source == "service" or message.get_srcComponent() == OPERATOR:
                self.held.hear(stamp_s, message)
                if stamp_s > other_s + YIELD_S and _is_changing(message) and source == "service":
                    self._late_changes += 1
            if source == "operator" and message.get_srcComponent() == 1:
                if message.get_type() == "MISSION_ACK":
                    self.held.hear(stamp_s, message)
                is_flown = self._follow(stamp_s, message, is_flown)
                self._returns_by_path |= is_flown and stamp_s > return_s + JOINED_S
            is_known = None not in (self._here, self._target, self._current)
            if is_flown and is_known and max(begin_s, next_s) <= stamp_s < other_s:
                next_s = stamp_s + JUDGED_EACH_S
                self._look(stamp_s, checkers[stamp_s > self.fence_s + 30.0])

    def _everything(self):
        streams = [messages_of(self.folder / f"{name}.tlog", name) for name in ("operator", "service")]
        return heapq.merge(*streams, key=lambda entry: entry[0])

    def _fence_obstacle(self):
        if self.fence is None:
            return ()
        corners = np.array(self.fence.exterior.coords)[:-1]
        return (Obstacle("fence", corners, -1000.0, 10_000.0),)

    def _follow(self, _stamp_s, message, is_flown):
        """Follow the telemetry; whether the mission is flown."""
        kind = message.get_type()
        if kind == "HEARTBEAT":
            armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            return armed and is_mission_mode(self.kind, message.custom_mode)
        if kind == "GLOBAL_POSITION_INT":
            self._here = self.frame.local_from_global(
                1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt
            )
            self._velocity = (0.01 * message.vy, 0.01 * message.vx)
        elif kind == "ATTITUDE":
            self._bank, self._yaw = message.roll, message.yaw
        elif kind == "VFR_HUD":
            self._airspeed = message.airspeed
        elif kind == "MISSION_CURRENT":
            self._current = message.seq
        elif kind == "POSITION_TARGET_GLOBAL_INT":
            place = self.frame.local_from_global(1e-7 * message.lat_int, 1e-7 * message.lon_int, message.alt)
            if self._target is None or math.dist(place[:2], self._target[:2]) > SAME_M:
                self._from = self._here
            self._target = place
        return is_flown

    def _place(self, item):
        """East, north, up of an item [m]."""
        if item is None or item.command >= 100 or (item.x == 0 and item.y == 0):
            return None
        is_relative = item.frame in (3, 6)
        altitude = item.z + (float(self.mission.origin.altitude_amsl_m) if is_relative else 0.0)
        return self.frame.local_from_global(1e-7 * item.x, 1e-7 * item.y, altitude)

    def _look(self, stamp_s, checker):
        """Judge what is held now."""
        if stamp_s < self.held.changed_s + SETTLED_S:
            return
        items, current = self.held.items, self._current
        if current >= len(items):
            return
        steered = items[current]
        if steered is None or steered.command in LAND or steered.command == Command.NAV_TAKEOFF:
            return
        if any(item is not None and item.command == Command.DO_LAND_START for item in items[:current]) and (
            self._is_landing(items, current)
        ):
            return
        place = self._place(steered)
        is_there = place is None or math.dist(place[:2], self._target[:2]) <= SAME_M
        if not is_there and steered.command not in LOITERS:
            return  # the telemetry of two items
        self.num_judged += 1
        targets, circle = self._way(items, current, self._target if place is None else place)
        if circle is None:
            self.violations.append((stamp_s, "the mission does not end in a circle", current))
            return
        bad = checker.check_track(self._track(targets, circle), 0.0)
        if bad:
            self.violations.append((stamp_s, str(bad[0]), current))

    def _is_landing(self, items, current):
        """Whether an item is one of those that land: behind DO_LAND_START, and none of the service's."""
        start = next(
            number for number, item in enumerate(items)
            if item is not None and item.command == Command.DO_LAND_START
        )  # fmt: skip
        end = next(
            (
                number
                for number, item in enumerate(items)
                if item is not None and item.command == Command.NAV_LAND
            ),
            start,
        )
        return start <= current <= end

    def _way(self, items, current, target):
        """Places flown to from here on, and the circle at the end: centre and radius; landings end it."""
        if items[current].command in LOITERS:
            return [], (np.array(target), self._radius(items[current]))
        places, number, num_jumps = [target], current + 1, 0
        while number < len(items) and items[number] is not None:
            item, number = items[number], number + 1
            if item.command == Command.NAV_WAYPOINT:
                places.append(self._place(item))
            elif item.command in LOITERS:
                return places, (np.array(self._place(item)), self._radius(item))
            elif item.command == Command.DO_JUMP and num_jumps == 0:
                number, num_jumps = int(item.param1), 1
            elif item.command in ENDS:
                return places, (np.array(places[-1]), 0.0)
        return places, None

    def _track(self, targets, circle):
        """The track (K, 3) that the autopilot's steering flies over them from here [m]."""
        state = self._aircraft
        length = sum(map(math.dist, [self._here, *targets[:-1]], targets)) if targets else 0.0
        return track_of_legs(
            self._guidance, state, np.array(targets or np.empty((0, 3))),
            before_enu_m=np.array(self._from or self._here), loiter=circle,
            ends_s=length / max(state.ground_speed_m_s, 8.0) + CIRCLED_S, step_s=0.5,
        ).positions_enu_m  # fmt: skip

    @property
    def _aircraft(self):
        """Where it is and how it moves, as the autopilot tells."""
        speed = math.hypot(*self._velocity)
        course = math.atan2(*self._velocity) % (2.0 * math.pi)
        airspeed = max(self._airspeed, 8.0)
        wind = tuple(
            over - airspeed * part
            for over, part in zip(self._velocity, (math.sin(self._yaw), math.cos(self._yaw)), strict=True)
        )
        calm = math.hypot(*wind) < 2.0  # no wind is set but by --wind; the rest is how airspeeds are measured
        return Ownship(
            0.0, self._here, course, 0.0, speed if calm else airspeed, speed, (0.0, 0.0) if calm else wind,
            bank_rad=self._bank,
        )  # fmt: skip

    @staticmethod
    def _radius(item):
        return (item.param2 if item.command == Command.NAV_LOITER_TO_ALT else item.param3) or 0.0

    # --- the row

    def row(self):
        """The flight's row in the table."""
        self.judge_missions()
        clearance, when_s, what = self.clearance()
        goal_s, takeover_s, entered_s = self.goal_reached_s(), self.takeover_s, self.entered_s
        armed_s, end_s = (
            self.event("armed"),
            self.flight["events"][-1]["stamp_s"] if self.flight["events"] else None,
        )
        landed = self.event("disarmed") is not None or is_standing(self.flight["path"])
        texts = [text for _, component, text in self.flight["texts"] if component != 1]
        air_s = max((end_s or 0.0) - (armed_s or 0.0), 1.0)
        aloft = [
            text
            for stamp, component, text in self.flight["texts"]
            if component != 1 and stamp > (armed_s or 0)
        ]
        row = {
            "autopilot": self.kind.name, "scenario": self.scenario.number, "name": self.scenario.name,
            "seed": self.flight["seed"], "commit": self.flight["commit"],
            "takeover_s": _since(takeover_s, armed_s), "takeover_up_m": self.up_at(takeover_s),
            "entered_s": _since(entered_s, takeover_s),
            "refused": sum("refused" in entry["message"] or "not entered" in entry["message"]
                           for entry in self.decided("rejected")),
            "rejected": len(self.decided("rejected")), "no_plan": len(self.decided("no plan")),
            "emergency": len(self.decided("emergency")),
            "swaps": len(self.decided("swap")), "uploads": self.held.num_uploads.get(SERVICE, 0),
            "clearance_m": clearance if math.isfinite(clearance) else None, "nearest": what,
            "nearest_s": _since(when_s, armed_s) if math.isfinite(clearance) else None,
            "goal_reached": goal_s is not None, "landed": landed,
            "circling": self.event("circling") is not None,
            "texts": len(texts), "texts_per_min": 60.0 * len(aloft) / air_s, "flight_s": air_s,
            "judged": self.num_judged, "violations": len(self.violations),
            "beside_said_m": self._beside_said(),
            "first_violations": self._told_violations(armed_s), "late_changes": self._late_changes,
        }  # fmt: skip
        row["faults"] = self._faults(row)
        row["verdict"] = "ok" if not row["faults"] else "; ".join(row["faults"])
        return row

    def _beside_said(self):
        """How far a return was from the way that the service had said; None without one [m]."""
        begun_s, said = self.event("return"), said_return(self.folder)
        if begun_s is None or said is None:
            return None
        return farthest_from(said, self.path[self.path[:, 0] >= begun_s, 1:3])

    def _texts(self, kind):
        return [entry["message"].split(": ", 1)[-1] for entry in self.decided(kind)]

    def _told_violations(self, armed_s):
        return [
            [round(stamp - (armed_s or 0.0), 1), text, current]
            for stamp, text, current in self.violations[:5]
        ]

    def _faults(self, row):
        """What is wrong with the flight, the gravest first."""
        found = []
        if row["clearance_m"] is not None and row["clearance_m"] <= 0.0:
            found.append(f"touched {row['nearest']}")
        if self.flight["fault"]:
            found.append(self.flight["fault"])
        if row["entered_s"] is None:
            found.append("no mission entered")
        ways = {"landed": row["landed"], "circling": row["circling"]}
        if not any(ways[end] for end in self.scenario.ends):
            found.append("did not land")
        if not row["goal_reached"] and not self.scenario.number.startswith(("6", "9", "13", "14")):
            found.append("goal not reached")
        if row["violations"]:
            found.append(f"{row['violations']} of {row['judged']} moments held what does not pass")
        if self.kind.num_home_items and self.event("return") is not None and not self._returns_by_path:
            found.append("the return followed no path")
        if row["late_changes"]:
            found.append(f"{row['late_changes']} messages against the operator's other mission")
        if self.event("rally points") is not None and "2 rally points" not in self._texts("rally"):
            found.append("rally points not read")
        crashes = [entry for entry in self.log if entry["level"] == "error"]
        if crashes:
            found.append(f"{len(crashes)} errors in the log")
        return found


def _since(stamp_s, begin_s):
    return None if stamp_s is None or begin_s is None else round(stamp_s - begin_s, 2)


def _is_changing(message):
    kind = message.get_type()
    return message.get_srcComponent() == SERVICE and getattr(message, "mission_type", 0) == 0 and (
        kind in CHANGING
        or (kind in ("COMMAND_LONG", "COMMAND_INT")
            and message.command in (mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, mavlink.MAV_CMD_MISSION_START))
    )  # fmt: skip
