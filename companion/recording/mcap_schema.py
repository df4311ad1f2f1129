"""Channels of ``flight.mcap`` and the JSON schema of each.

Every message has ``stamp_s``, a reading of the service's clock; the timestamps of the MCAP file are UTC.
Names end in their unit. Positions are east, north, up from the mission file's origin. Unknown and infinite
values are null.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from companion.types.path import Path
from companion.types.record import PlanRecord

Schema = dict[str, object]

NUMBER: Schema = {"type": ["number", "null"]}
WHOLE: Schema = {"type": ["integer", "null"]}
TEXT: Schema = {"type": ["string", "null"]}
FLAG: Schema = {"type": ["boolean", "null"]}
NUMBERS: Schema = {"type": "array", "items": {"type": ["number", "null"]}}
ROWS: Schema = {"type": "array", "items": NUMBERS}
TEXTS: Schema = {"type": "array", "items": {"type": "string"}}
TABLE: Schema = {"type": "object", "additionalProperties": True}
TABLES: Schema = {"type": "array", "items": TABLE}


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic with the name, description and keys of its schema."""

    topic: str
    name: str
    says: str
    keys: dict[str, Schema]
    described: dict[str, str] = field(default_factory=dict)

    @property
    def schema(self) -> Schema:
        """The JSON schema that the file contains."""
        keys = self.keys if self.name.startswith("foxglove.") else {"stamp_s": NUMBER, **self.keys}
        properties = {
            key: {**kind, "description": self.described[key]} if key in self.described else kind
            for key, kind in keys.items()
        }
        return {"title": self.name, "description": self.says, "type": "object", "properties": properties}


MISSION, LINK = "/mission", "/link"
OWNSHIP, LOCATION, TRACKS, THREAT = "/ownship", "/location", "/tracks", "/threat"
SNAPSHOT, PLAN, DECISION, SWAP = "/snapshot", "/plan", "/decision", "/swap"
TREES, STANDING, ENERGY = "/trees", "/standing", "/energy"
TREE_NODES_MAX = 6_000  # Only the first nodes of a search are recorded; parents precede their children.
_TREE_DIGITS = 1  # Decimetres suffice for pictures.

CHANNELS = (
    Channel(
        MISSION, "companion.Mission", "What is flown, by which program: first, and when it is read again.",
        {
            "name": TEXT, "mission_file": TEXT, "seed": WHOLE, "epoch_s": NUMBER, "clock": TEXT,
            "step_s": NUMBER, "versions": TABLE, "remembered": TABLE,
        },
        {
            "mission_file": "text of the mission file",
            "epoch_s": "UTC at stamp 0",
            "clock": "simulated or wall",
            "step_s": "of simulated time; null by a wall clock",
            "remembered": "of before a restart: goals reached, parameters, the memory's files in base64",
        },
    ),
    Channel(
        OWNSHIP, "companion.Ownship", "Own state as estimated on board, 5 Hz.",
        {
            "position_enu_m": NUMBERS, "course_rad": NUMBER, "flight_path_angle_rad": NUMBER,
            "airspeed_m_s": NUMBER, "ground_speed_m_s": NUMBER, "wind_enu_m_s": NUMBERS,
            "position_std_m": NUMBERS, "bank_rad": NUMBER, "wind_std_m_s": NUMBER, "coordination": NUMBER,
        },
    ),
    Channel(
        LOCATION, "foxglove.LocationFix", "The same place for a map, 1 Hz.",
        {
            "timestamp": TABLE, "frame_id": TEXT, "latitude": NUMBER, "longitude": NUMBER,
            "altitude": NUMBER, "position_covariance": NUMBERS, "position_covariance_type": WHOLE,
        },
    ),
    Channel(
        TRACKS, "companion.Tracks", "Moving threats as tracked, 5 Hz.", {"tracks": TABLES},
    ),
    Channel(
        THREAT, "companion.Threat", "Threat level the aircraft is under, 5 Hz.", {"level": NUMBER},
    ),
    Channel(
        SNAPSHOT, "companion.Snapshot", "The world that a plan was made in.",
        {"number": WHOLE, "known_threats": TEXTS, "tracks": TABLES, "obstacles": TABLES},
        {"obstacles": "when others than at the plan before, the autopilot's fences among them"},
    ),
    Channel(
        PLAN, "companion.Plan", "A plan, why it was made, and what came of it.",
        {
            "number": WHOLE, "snapshot": WHOLE, "occasion": TEXT, "purpose": TEXT, "seed": WHOLE,
            "start": TABLE, "status": TEXT, "notes": TEXTS, "path": ROWS, "covariances_m2": ROWS,
            "threat_levels": NUMBERS,
            "measures": TABLE, "cost": NUMBER, "gap": NUMBER, "exposed_s": NUMBER,
            "flown_cost": NUMBER, "flown_threat": NUMBER, "pursuit": TABLE, "flown_pursuit": TABLE,
            "asked": WHOLE,
            "is_stopped": FLAG, "is_broken_off": FLAG, "due_s": NUMBER,
            "seen_s": NUMBER, "begun_s": NUMBER, "took_s": NUMBER, "plan_ms": NUMBER,
        },
        {
            "occasion": "why the plan was made now",
            "cost": "what plans are compared by: J [s] where the method goes by it, else the sum of (9)",
            "gap": "by what share of the least that a path can cost this one costs more at most",
            "exposed_s": "radars' membership along the path, integrated over time [s]",
            "pursuit": "what moving threats that knew the path could do: first_s is t_f, total_s how long",
            "path": "rows of time [s], east, north, up [m], course, climb [rad], speed [m/s]",
            "covariances_m2": "of each row's place: east², east·north, north², up²",
            "asked": "how often the search asked whether to stop, until it was told to or had finished",
            "due_s": "when it was found to be due; seen_s when the world was seen that it was made in",
            "took_s": "of the service's clock",
            "plan_ms": "of the computer's time",
        },
    ),
    Channel(
        TREES, "companion.Trees", "What a plan's search looked like; nothing is decided by it.",
        {
            "number": WHOLE, "tree_enu_m": ROWS, "tree_parents": NUMBERS, "threat_tree_enu_m": ROWS,
            "threat_tree_parents": NUMBERS, "sub_goals_enu_m": ROWS, "horizon_centres_enu_m": ROWS,
        },
        {
            "number": "of the plan",
            "tree_parents": "rows of tree_enu_m; -1 at the root",
            "threat_tree_enu_m": "of all moving threats, east and north",
        },
    ),
    Channel(
        DECISION, "companion.Decision", "What was decided, and the numbers that led to it.",
        {
            "kind": TEXT, "text": TEXT, "told": TEXT, "why": TABLE, "plan_ms": NUMBER,
            "track_to_mission_ms": NUMBER,
        },
    ),
    Channel(
        SWAP, "companion.Swap", "A mission handed to the autopilot, and how that ended.",
        {
            "outcome": TEXT, "reason": TEXT, "begun_s": NUMBER, "ended_s": NUMBER, "plan_number": WHOLE,
            "items": TABLES, "waypoints_enu_m": ROWS,
        },
    ),
    Channel(
        LINK, "companion.Link", "The link and the service's mode, 1 Hz.",
        {
            "mode": TEXT, "autopilot_mode": TEXT, "dialect": TEXT, "vehicle_system_id": WHOLE,
            "counters": TABLE, "missing_streams": NUMBERS,
        },
    ),
    Channel(
        ENERGY, "companion.Energy", "What is left on board, and what the way home costs, 1 Hz.",
        {
            "left_wh": NUMBER, "ratio": NUMBER, "home_wh": NUMBER, "margin_wh": NUMBER,
            "turn_back_in_s": NUMBER,
        },
        {
            "ratio": "how many times as fast as modelled it falls, at least 1",
            "margin_wh": "what is left beyond the way home and the reserve",
            "turn_back_in_s": "null if home can still be reached from the end of the flown path",
        },
    ),
    Channel(
        STANDING, "companion.PilotStatus", "How the service stands, and what the pilot can do, 1 Hz.",
        {
            "mode": TEXT, "autopilot_mode": TEXT, "is_heard": FLAG, "is_warm": FLAG, "is_armed": FLAG,
            "is_airborne": FLAG, "is_recording": FLAG, "is_in_trouble": FLAG, "emergency": TEXT,
            "goals": ROWS, "next_goal": WHOLE, "item": WHOLE, "num_items": WHOLE, "handback": TABLE,
            "operator_enu_m": ROWS, "returns": TABLE, "team": TABLE,
        },
        {
            "goals": "rows of east, north, up, acceptance radius [m]",
            "item": "of its list that the autopilot flies to",
            "handback": "is_safe and text of handing back here and now, and the way flown then",
            "operator_enu_m": "the operator's items that have a place",
            "returns": "is_safe and text of a return to launch from here, and the way flown then",
            "team": "members with what they told, and the flown goals of a team that shares its goals",
        },
    ),
)  # fmt: skip


def table_of(instance: Any, leave: Collection[str] = ()) -> dict[str, object]:  # noqa: ANN401
    """Convert a data class to a table, without some of its fields."""
    return {
        entry.name: getattr(instance, entry.name) for entry in fields(instance) if entry.name not in leave
    }


def plan_table(made: PlanRecord) -> dict[str, object]:
    """Return the ``/plan`` message of a plan."""
    plan, start = made.plan, made.start
    return {
        "number": made.number,
        "snapshot": plan.snapshot_number,
        "occasion": made.occasion,
        "purpose": made.purpose,
        "seed": plan.seed,
        "start": start,
        "status": plan.status.value,
        "notes": plan.notes,
        "path": [] if plan.path is None else plan.path.rows(),
        "covariances_m2": [] if plan.path is None else _covariances(plan.path),
        "threat_levels": [] if plan.path is None else plan.path.threat_levels,
        "measures": table_of(plan.measures),
        "cost": plan.cost,
        "gap": plan.gap,
        "exposed_s": plan.seen_s,
        "flown_cost": plan.flown_cost,
        "flown_threat": plan.flown_threat,
        "pursuit": table_of(plan.pursuit),
        "flown_pursuit": {} if plan.flown_pursuit is None else table_of(plan.flown_pursuit),
        "asked": made.asked,
        "is_stopped": made.is_stopped,
        "is_broken_off": made.is_broken_off,
        "due_s": made.due_s,
        "seen_s": made.seen_s,
        "begun_s": made.begun_s,
        "took_s": made.took_s,
        "plan_ms": made.plan_ms,
    }


def _covariances(path: Path) -> list[list[float]]:
    """Return rows of east², east·north, north², up² for the positions of a path [m²]."""
    parts = path.position_covariances_m2[:, (0, 0, 1, 2), (0, 1, 1, 2)]
    rows: list[list[float]] = np.round(parts, 2).tolist()
    return rows


def trees_table(made: PlanRecord) -> dict[str, object]:
    """Return the ``/trees`` message of a plan's search."""
    trace, most = made.plan.trace, TREE_NODES_MAX
    return {
        "number": made.number,
        "tree_enu_m": np.round(trace.tree_enu_m[:most], _TREE_DIGITS),
        "tree_parents": trace.tree_parents[:most],
        "threat_tree_enu_m": np.round(trace.threat_tree_enu_m[:most], _TREE_DIGITS),
        "threat_tree_parents": trace.threat_tree_parents[:most],
        "sub_goals_enu_m": np.round(trace.sub_goals_enu_m, _TREE_DIGITS),
        "horizon_centres_enu_m": np.round(trace.horizon_centres_enu_m, _TREE_DIGITS),
    }
