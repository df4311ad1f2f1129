"""The autopilot's actions in failsafes, by its parameters.

The actions are those for fixed-wing aircraft of ArduPlane 4.7 (``Parameters.cpp``,
``AP_BattMonitor_Params.cpp``, ``AC_Fence.cpp``) and PX4 1.17 (``commander_params.c``, ``geofence_params.c``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from companion.service.doctor.finding import Finding, ok, warn

RETURN: Final = "return to launch"
UNPREDICTED: Final = "the planner does not predict it: {name} {value} flies it where nothing was checked"
# These actions are predicted while they are flown, or leave the mission as it is.
PREDICTED: Final = frozenset({
    RETURN, "nothing", "a warning", "nothing in missions", "it flies the mission", "it circles where it is",
})  # fmt: skip


@dataclass(frozen=True, slots=True)
class FailsafeAction:
    """A parameter that selects what the autopilot does in a failsafe.

    Parameters
    ----------
    name : str
        Name of the parameter.
    event : str
        When the action is taken, in words.
    actions : mapping of float to str
        What each value does, in words.
    switch : str, optional
        Name of a parameter that is 0 while the failsafe is off.
    """

    name: str
    event: str
    actions: Mapping[float, str]
    switch: str = ""

    def finding(self, values: Mapping[str, float]) -> Finding | None:
        """Return what is done, given the values of the parameters; None if the autopilot does not have it."""
        value = values.get(self.name)
        if value is None:
            return None
        if self.switch and values.get(self.switch) == 0.0:
            return ok(self.name, f"{self.event}: nothing ({self.switch} 0)")
        action = self.actions.get(value)
        found = f"{self.event}: {action or 'unknown'}"
        if action in PREDICTED:
            return ok(self.name, found)
        return warn(self.name, found, UNPREDICTED.format(name=self.name, value=f"{value:g}"))


_BATTERY: Final = {
    0.0: "a warning", 1.0: RETURN, 2.0: "the landing sequence, or return to launch", 3.0: "it terminates",
    5.0: "the parachute", 7.0: "AUTOLAND, or return to launch",
}  # fmt: skip
_LINK_LOST: Final = {
    0.0: "nothing", 1.0: "it circles where it is", 2.0: RETURN, 3.0: "it lands where it is",
    5.0: "it terminates", 6.0: "the motor stops",
}  # fmt: skip
ARDUPLANE_FAILSAFES: Final = (
    FailsafeAction("BATT_FS_LOW_ACT", "battery low", _BATTERY, "BATT_MONITOR"),
    FailsafeAction("BATT_FS_CRT_ACT", "battery critical", _BATTERY, "BATT_MONITOR"),
    FailsafeAction(
        "FS_SHORT_ACTN",
        "remote control lost",
        {
            0.0: "nothing in missions", 1.0: "it circles where it is", 2.0: "it glides straight on",
            3.0: "nothing", 4.0: "it flies straight on",
        },
    ),
    FailsafeAction(
        "FS_LONG_ACTN",
        "remote control or ground station lost for long",
        {
            0.0: "nothing in missions", 1.0: RETURN, 2.0: "it glides straight on", 3.0: "the parachute",
            4.0: "it flies the mission", 5.0: "AUTOLAND, or return to launch",
        },
    ),
    FailsafeAction(
        "FENCE_ACTION",
        "fence crossed",
        {
            0.0: "a warning", 1.0: RETURN, 6.0: "it flies to the fence's return point",
            7.0: "it flies to the fence's return point", 8.0: "AUTOLAND, or return to launch",
        },
        "FENCE_ENABLE",
    ),
)  # fmt: skip
PX4_FAILSAFES: Final = (
    FailsafeAction(
        "COM_LOW_BAT_ACT",
        "battery low",
        {
            0.0: "a warning", 2.0: "it lands where it is",
            3.0: f"{RETURN}, and a landing where it is at last",
        },
    ),
    FailsafeAction("NAV_RCL_ACT", "remote control lost", _LINK_LOST),
    FailsafeAction("NAV_DLL_ACT", "ground station lost", _LINK_LOST),
    FailsafeAction(
        "GF_ACTION",
        "fence crossed",
        {
            0.0: "nothing", 1.0: "a warning", 2.0: "it circles where it is", 3.0: RETURN,
            4.0: "it terminates", 5.0: "it lands where it is",
        },
    ),
)  # fmt: skip


def failsafe_names(failsafes: Sequence[FailsafeAction]) -> tuple[str, ...]:
    """Return the names of the parameters to read."""
    switches = sorted({failsafe.switch for failsafe in failsafes} - {"", *map(_name, failsafes)})
    return (*map(_name, failsafes), *switches)


def failsafe_findings(failsafes: Sequence[FailsafeAction], values: Mapping[str, float]) -> list[Finding]:
    """Return what the autopilot does in each failsafe, given the parameters that were read."""
    findings = (failsafe.finding(values) for failsafe in failsafes)
    return [finding for finding in findings if finding is not None]


def _name(failsafe: FailsafeAction) -> str:
    return failsafe.name
