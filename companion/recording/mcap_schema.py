"""What ``flight.mcap`` holds: its channels, and the JSON schema of each.

Every message has ``stamp_s``, the service's clock; the file's own times are UTC. Names end in their unit,
positions are east, north, up from the mission file's origin. What is not known, or not finite, is null.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, fields
from typing import Any

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
    """A topic: the name of its schema, what it says, and its keys."""

    topic: str
    name: str
    says: str
    keys: dict[str, Schema]
    described: dict[str, str] = field(default_factory=dict)

    @property
    def schema(self) -> Schema:
        """JSON schema, as it stands in the file."""
        keys = self.keys if self.name.startswith("foxglove.") else {"stamp_s": NUMBER, **self.keys}
        properties = {
            key: {**kind, "description": self.described[key]} if key in self.described else kind
            for key, kind in keys.items()
        }
        return {"title": self.name, "description": self.says, "type": "object", "properties": properties}


MISSION, LINK = "/mission", "/link"
OWNSHIP, LOCATION, TRACKS, THREAT = "/ownship", "/location", "/tracks", "/threat"
SNAPSHOT, PLAN, DECISION, SWAP = "/snapshot", "/plan", "/decision", "/swap"

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
            "position_std_m": NUMBERS, "bank_rad": NUMBER, "wind_std_m_s": NUMBER,
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
            "start": TABLE, "status": TEXT, "notes": TEXTS, "path": ROWS, "threat_levels": NUMBERS,
            "measures": TABLE, "flown_cost": NUMBER, "flown_threat": NUMBER, "pursuit": TABLE,
            "flown_pursuit": TABLE, "asked": WHOLE,
            "is_stopped": FLAG, "is_broken_off": FLAG, "due_s": NUMBER,
            "seen_s": NUMBER, "begun_s": NUMBER, "took_s": NUMBER, "plan_ms": NUMBER,
        },
        {
            "occasion": "why the plan was made now",
            "pursuit": "what moving threats that knew the path could do: first_s is t_f, total_s how long",
            "path": "rows of time [s], east, north, up [m], course, climb [rad], speed [m/s]",
            "asked": "how often the search asked whether to stop, until it was told to or had finished",
            "due_s": "when it was found to be due; seen_s when the world was seen that it was made in",
            "took_s": "of the service's clock",
            "plan_ms": "of the computer's time",
        },
    ),
    Channel(
        DECISION, "companion.Decision", "What was decided, and the numbers that led to it.",
        {"kind": TEXT, "text": TEXT, "why": TABLE, "plan_ms": NUMBER, "track_to_mission_ms": NUMBER},
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
)  # fmt: skip


def table_of(instance: Any, leave: Collection[str] = ()) -> dict[str, object]:  # noqa: ANN401
    """A data class as a table, but for some of its fields."""
    return {
        entry.name: getattr(instance, entry.name) for entry in fields(instance) if entry.name not in leave
    }


def plan_table(made: PlanRecord) -> dict[str, object]:
    """What ``/plan`` says of a plan."""
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
        "threat_levels": [] if plan.path is None else plan.path.threat_levels,
        "measures": table_of(plan.measures),
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
