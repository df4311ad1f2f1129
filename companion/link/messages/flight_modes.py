"""Names of flight modes, and the mode of each autopilot that flies missions.

References
----------
ArduPlane ``mode.h`` (custom_mode is the number); PX4 ``px4_custom_mode.h`` (main mode in bits
16–23, sub mode of AUTO in bits 24–31).
"""

from __future__ import annotations

from companion.types.events import Dialect, Motion
from companion.types.mavlink_enums import Autopilot, ModeFlag, VehicleType

ARDUPLANE_MODES = {
    0: "MANUAL",
    1: "CIRCLE",
    2: "STABILIZE",
    3: "TRAINING",
    4: "ACRO",
    5: "FBWA",
    6: "FBWB",
    7: "CRUISE",
    8: "AUTOTUNE",
    10: "AUTO",
    11: "RTL",
    12: "LOITER",
    13: "TAKEOFF",
    14: "AVOID_ADSB",
    15: "GUIDED",
    16: "INITIALISING",
    17: "QSTABILIZE",
    18: "QHOVER",
    19: "QLOITER",
    20: "QLAND",
    21: "QRTL",
    22: "QAUTOTUNE",
    23: "QACRO",
    24: "THERMAL",
    25: "LOITER_ALT_QLAND",
    26: "AUTOLAND",
}
PX4_MAIN_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
PX4_AUTO_MODES = {
    1: "READY",
    2: "TAKEOFF",
    3: "LOITER",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    8: "FOLLOW_TARGET",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}
# Fixed wings, and the kinds of VTOL that ArduPlane flies. A copter numbers its modes differently.
_PLANE_TYPES = frozenset(
    {VehicleType.FIXED_WING, VehicleType.PARAFOIL}
    | {kind for kind in VehicleType if kind.name.startswith("VTOL_")}
)
DIALECTS = {Autopilot.ARDUPILOTMEGA: Dialect.ARDUPILOT, Autopilot.PX4: Dialect.PX4}
MISSION_MODES = {Dialect.ARDUPILOT: "AUTO", Dialect.PX4: "MISSION"}
# What each autopilot does by itself; in all other modes a pilot steers. A PX4 that lands flies to its target.
_MOTIONS = {
    Dialect.ARDUPILOT: {
        "AUTO": Motion.MISSION, "RTL": Motion.RETURN, "LOITER": Motion.CIRCLE, "GUIDED": Motion.CIRCLE,
        "AVOID_ADSB": Motion.CIRCLE,
    },
    Dialect.PX4: {
        "MISSION": Motion.MISSION, "RTL": Motion.RETURN, "LOITER": Motion.CIRCLE, "LAND": Motion.CIRCLE,
    },
}  # fmt: skip


def flight_mode(dialect: Dialect, vehicle_type: int, base_mode: int, custom_mode: int) -> tuple[str, bool]:
    """Return the name of the mode in a HEARTBEAT, and whether it flies missions.

    An unknown mode is named by its number and is never the mission mode.
    """
    name = None
    if base_mode & ModeFlag.CUSTOM_MODE_ENABLED:
        if dialect is Dialect.PX4:
            name = _px4_mode(custom_mode)
        elif vehicle_type in _PLANE_TYPES:
            name = ARDUPLANE_MODES.get(custom_mode)
    return (name or f"MODE_{custom_mode}"), name is not None and name == MISSION_MODES[dialect]


def motion_of(dialect: Dialect, mode: str) -> Motion:
    """Return what an autopilot does by itself in a mode of this name."""
    return _MOTIONS[dialect].get(mode, Motion.STEERED)


def custom_mode_of(dialect: Dialect, mode: str) -> int | None:
    """Return the custom_mode that selects a mode by its name, or None if there is none."""
    if dialect is Dialect.ARDUPILOT:
        return next((number for number, name in ARDUPLANE_MODES.items() if name == mode), None)
    for number, name in PX4_AUTO_MODES.items():
        if name == mode:
            return (number << 24) | (4 << 16)
    return next((number << 16 for number, name in PX4_MAIN_MODES.items() if name == mode), None)


def _px4_mode(custom_mode: int) -> str | None:
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    name = PX4_MAIN_MODES.get(main)
    return PX4_AUTO_MODES.get(sub) if name == "AUTO" else name
