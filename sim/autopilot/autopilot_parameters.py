"""The autopilots' parameters that have an effect in the simulator."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from .channel import Message

_INT8 = mavlink.MAV_PARAM_TYPE_INT8
_INT16 = mavlink.MAV_PARAM_TYPE_INT16
_INT32 = mavlink.MAV_PARAM_TYPE_INT32
_REAL = mavlink.MAV_PARAM_TYPE_REAL32

# Name: default, type. Defaults are ArduPlane's unless the scenario sets others.
_ARDUPLANE: dict[str, tuple[float, int]] = {
    "ADSB_TYPE": (0, _INT8),
    "AIRSPEED_CRUISE": (22, _REAL),
    "AIRSPEED_MAX": (38, _INT16),
    "AIRSPEED_MIN": (12, _INT16),
    "ALT_OFFSET": (0, _INT16),
    "ALT_SLOPE_MIN": (15, _INT16),
    "AVD_ENABLE": (0, _INT8),
    "AVD_F_ACTION": (1, _INT8),
    "AVD_W_ACTION": (1, _INT8),
    "FENCE_ACTION": (1, _INT8),
    "FENCE_ALT_MAX": (100, _REAL),
    "FENCE_ENABLE": (0, _INT8),
    "FENCE_RADIUS": (300, _REAL),
    "FENCE_TYPE": (7, _INT8),
    "FLIGHT_OPTIONS": (0, _REAL),  # An INT32 of ArduPlane, whose integers are sent as floats.
    "FS_GCS_ENABL": (0, _INT8),
    "FS_LONG_ACTN": (0, _INT8),
    "FS_SHORT_ACTN": (0, _INT8),
    "LEVEL_ROLL_LIMIT": (5, _REAL),
    "MIS_OPTIONS": (0, _INT16),
    "MIS_RESTART": (0, _INT8),
    "MIS_TOTAL": (0, _INT16),
    "NAVL1_DAMPING": (0.75, _REAL),
    "NAVL1_PERIOD": (17, _REAL),
    "PTCH_LIM_MAX_DEG": (20, _REAL),
    "PTCH_LIM_MIN_DEG": (-20, _REAL),
    "ROLL_LIMIT_DEG": (50, _REAL),
    "RALLY_INCL_HOME": (0, _INT8),
    "RALLY_LIMIT_KM": (5, _REAL),
    "RALLY_TOTAL": (0, _INT8),
    "RTL_ALTITUDE": (100, _REAL),
    "RTL_AUTOLAND": (0, _INT8),
    "RTL_CLIMB_MIN": (0, _INT16),
    "RTL_RADIUS": (100, _INT16),
    "SERIAL1_BAUD": (57, _INT16),
    "SERIAL1_PROTOCOL": (2, _INT8),
    "SERIAL2_BAUD": (921, _INT16),
    "SERIAL2_PROTOCOL": (2, _INT8),
    "STALL_PREVENTION": (1, _INT8),
    "SYSID_THISMAV": (1, _INT16),
    "TECS_CLMB_MAX": (7, _REAL),
    "TECS_SINK_MAX": (7, _REAL),
    "TERRAIN_ENABLE": (1, _INT8),
    "TERRAIN_FOLLOW": (0, _REAL),  # An INT32, too.
    "TERRAIN_LOOKAHD": (2000, _INT16),
    "TERRAIN_SPACING": (100, _INT16),
    "THR_MAX": (100, _INT8),
    "WP_LOITER_RAD": (80, _INT16),
    "WP_MAX_RADIUS": (0, _INT16),
    "WP_RADIUS": (50, _INT16),
}
# PX4's, with its defaults; with the ArduPlane name that the simulator's own loops read, if there is one.
_PX4: dict[str, tuple[float, int]] = {
    "FW_AIRSPD_MAX": (38, _REAL),
    "FW_AIRSPD_MIN": (12, _REAL),
    "FW_AIRSPD_TRIM": (22, _REAL),
    "FW_LND_ANG": (5, _REAL),
    "FW_P_LIM_MAX": (20, _REAL),
    "FW_P_LIM_MIN": (-20, _REAL),
    "FW_R_LIM": (50, _REAL),
    "FW_T_CLMB_MAX": (7, _REAL),
    "FW_T_CLMB_R_SP": (7, _REAL),
    "FW_THR_MAX": (1, _REAL),
    "FW_T_SINK_MAX": (7, _REAL),
    "FW_T_SINK_R_SP": (7, _REAL),
    "GF_ACTION": (2, _INT32),
    "GF_MAX_HOR_DIST": (0, _REAL),
    "GF_MAX_VER_DIST": (0, _REAL),
    "MIS_TKO_LAND_REQ": (2, _INT32),
    "NAV_ACC_RAD": (10, _REAL),
    "NAV_DLL_ACT": (0, _INT32),
    "NAV_FW_ALT_RAD": (10, _REAL),
    "NAV_LOITER_RAD": (80, _REAL),
    "NAV_RCL_ACT": (2, _INT32),
    "NAV_TRAFF_AVOID": (1, _INT32),
    "NPFG_DAMPING": (0.7, _REAL),
    "NPFG_PERIOD": (10, _REAL),
    "RTL_LOITER_RAD": (80, _REAL),
    "RTL_RETURN_ALT": (100, _REAL),
    "RTL_TYPE": (0, _INT32),
}
_PX4_NAMES = {
    "AIRSPEED_CRUISE": "FW_AIRSPD_TRIM",
    "AIRSPEED_MAX": "FW_AIRSPD_MAX",
    "AIRSPEED_MIN": "FW_AIRSPD_MIN",
    "NAVL1_DAMPING": "NPFG_DAMPING",
    "NAVL1_PERIOD": "NPFG_PERIOD",
    "PTCH_LIM_MAX_DEG": "FW_P_LIM_MAX",
    "PTCH_LIM_MIN_DEG": "FW_P_LIM_MIN",
    "ROLL_LIMIT_DEG": "FW_R_LIM",
    "TECS_CLMB_MAX": "FW_T_CLMB_MAX",
    "TECS_SINK_MAX": "FW_T_SINK_MAX",
    "WP_LOITER_RAD": "NAV_LOITER_RAD",
}
# Of the battery monitor, which only an aircraft with a battery has.
_ARDUPLANE_BATTERY: dict[str, tuple[float, int]] = {
    "BATT_CAPACITY": (3300, _REAL),  # An INT32, too.
    "BATT_FS_LOW_ACT": (0, _INT8),
    "BATT_LOW_MAH": (0, _REAL),
    "BATT_MONITOR": (4, _INT8),
}
_PX4_BATTERY: dict[str, tuple[float, int]] = {
    "BAT_CRIT_THR": (0.07, _REAL),
    "BAT_LOW_THR": (0.15, _REAL),
    "COM_LOW_BAT_ACT": (0, _INT32),
}
_READ_ONLY = frozenset({"MIS_TOTAL", "RALLY_TOTAL"})
UNINDEXED = 65535


class Parameters:
    """Named values, in alphabetical order.

    Parameters
    ----------
    table : mapping, optional
        Name to default and MAV_PARAM_TYPE; ArduPlane's if left out.
    names : mapping, optional
        ArduPlane's name to this autopilot's, for those that the control loops read.
    """

    def __init__(
        self,
        table: Mapping[str, tuple[float, int]] = _ARDUPLANE,
        names: Mapping[str, str] | None = None,
    ) -> None:
        self._types = {name: kind for name, (_, kind) in table.items()}
        self._values = {name: float(default) for name, (default, _) in table.items()}
        self._aliases = dict(names or {})
        self._names = sorted(self._values)

    @classmethod
    def px4_defaults(cls) -> Parameters:
        """PX4's parameters."""
        return cls(_PX4, _PX4_NAMES)

    def add_battery(self) -> None:
        """Add the parameters of the battery monitor."""
        table = _PX4_BATTERY if "FW_AIRSPD_TRIM" in self._values else _ARDUPLANE_BATTERY
        self._types |= {name: kind for name, (_, kind) in table.items()}
        self._values |= {name: float(default) for name, (default, _) in table.items()}
        self._names = sorted(self._values)

    @property
    def climb_rates_m_s(self) -> tuple[float, float]:
        """Largest rates of climb and descent; those of a PX4's missions are set for themselves, too."""
        climb, sink = self["TECS_CLMB_MAX"], self["TECS_SINK_MAX"]
        wanted = self._values.get("FW_T_CLMB_R_SP", climb), self._values.get("FW_T_SINK_R_SP", sink)
        return min(climb, wanted[0]), min(sink, wanted[1])

    @property
    def stall_prevention_m_s(self) -> float:
        """Airspeed at which an ArduPlane could just fly level, for its stall prevention; 0 without that."""
        return self._values["AIRSPEED_MIN"] if self._values.get("STALL_PREVENTION") else 0.0

    def __len__(self) -> int:
        return len(self._names)

    def __getitem__(self, name: str) -> float:
        return self._values[self._aliases.get(name, name)]

    def __setitem__(self, name: str, value: float) -> None:
        name = self._aliases.get(name, name)
        if name not in self._values:
            raise KeyError(name)
        self._values[name] = float(value)

    def set_from_client(self, name: str, value: float) -> bool:
        """Set a value as a client may; ``False`` if there is no such parameter or it is read only."""
        if name not in self._values:
            return False
        kind = self._types[name]
        if kind == _INT32:
            # PX4 sends integers bytewise, as they are in memory.
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        if name not in _READ_ONLY and abs(value) < 1e9:  # NaN is refused, too.
            self._values[name] = value if kind == _REAL else float(round(value))
        return True

    def name_of(self, identifier: str | bytes, index: int) -> str | None:
        """Name of a requested parameter: by index, or by identifier if the index is -1."""
        if index >= 0:
            return self._names[index] if index < len(self._names) else None
        name = identifier.decode("ascii", "replace") if isinstance(identifier, bytes) else identifier
        name = name.rstrip("\0")
        return name if name in self._values else None

    def message(self, name: str, *, indexed: bool = True) -> Message:
        """PARAM_VALUE of a parameter."""
        index = self._names.index(name) if indexed else UNINDEXED
        kind, value = self._types[name], self._values[name]
        if kind == _INT32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return mavlink.MAVLink_param_value_message(name.encode("ascii"), value, kind, len(self._names), index)

    @property
    def names(self) -> list[str]:
        """All names, in the order of their indices."""
        return list(self._names)
