"""The autopilot's parameters: those of ArduPlane that mean something here."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.channel import Message

_INT8 = mavlink.MAV_PARAM_TYPE_INT8
_INT16 = mavlink.MAV_PARAM_TYPE_INT16
_REAL = mavlink.MAV_PARAM_TYPE_REAL32

# Name: default, type. Defaults are ArduPlane's where the scenario sets no other.
_ARDUPLANE: dict[str, tuple[float, int]] = {
    "ADSB_TYPE": (0, _INT8),
    "AIRSPEED_CRUISE": (22, _REAL),
    "AIRSPEED_MAX": (38, _INT16),
    "AIRSPEED_MIN": (12, _INT16),
    "AVD_ENABLE": (0, _INT8),
    "AVD_F_ACTION": (1, _INT8),
    "AVD_W_ACTION": (1, _INT8),
    "FENCE_ENABLE": (0, _INT8),
    "FS_GCS_ENABL": (0, _INT8),
    "FS_LONG_ACTN": (0, _INT8),
    "GLIDE_SLOPE_MIN": (15, _INT16),
    "MIS_OPTIONS": (0, _INT16),
    "MIS_RESTART": (0, _INT8),
    "MIS_TOTAL": (0, _INT16),
    "NAVL1_DAMPING": (0.75, _REAL),
    "NAVL1_PERIOD": (17, _REAL),
    "PTCH_LIM_MAX_DEG": (20, _REAL),
    "PTCH_LIM_MIN_DEG": (-20, _REAL),
    "ROLL_LIMIT_DEG": (50, _REAL),
    "RTL_ALTITUDE": (100, _REAL),
    "RTL_RADIUS": (100, _INT16),
    "SYSID_THISMAV": (1, _INT16),
    "TECS_CLMB_MAX": (7, _REAL),
    "TECS_SINK_MAX": (7, _REAL),
    "WP_LOITER_RAD": (80, _INT16),
    "WP_RADIUS": (50, _INT16),
}
_READ_ONLY = frozenset({"MIS_TOTAL"})
UNINDEXED = 65535


class Parameters:
    """Named values, in alphabetical order."""

    def __init__(self) -> None:
        self._values = {name: float(default) for name, (default, _) in _ARDUPLANE.items()}
        self._names = sorted(self._values)

    def __len__(self) -> int:
        return len(self._names)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __setitem__(self, name: str, value: float) -> None:
        if name not in self._values:
            raise KeyError(name)
        self._values[name] = float(value)

    def set_from_client(self, name: str, value: float) -> bool:
        """Set a value as a client may; ``False`` if there is no such parameter or it is read only."""
        if name not in self._values:
            return False
        if name not in _READ_ONLY and value == value and abs(value) < 1e9:
            self._values[name] = value if _ARDUPLANE[name][1] == _REAL else float(round(value))
        return True

    def name_of(self, identifier: str | bytes, index: int) -> str | None:
        """Name asked for by index, or by identifier where the index is -1."""
        if index >= 0:
            return self._names[index] if index < len(self._names) else None
        name = identifier.decode("ascii", "replace") if isinstance(identifier, bytes) else identifier
        name = name.rstrip("\0")
        return name if name in self._values else None

    def message(self, name: str, *, indexed: bool = True) -> Message:
        """PARAM_VALUE of a parameter."""
        index = self._names.index(name) if indexed else UNINDEXED
        return mavlink.MAVLink_param_value_message(
            name.encode("ascii"), self._values[name], _ARDUPLANE[name][1], len(self._names), index
        )

    @property
    def names(self) -> list[str]:
        """All names, in the order of their indices."""
        return list(self._names)
