"""Check of the energy on board: whether it lasts to the goals and back, by the battery's present state."""

from __future__ import annotations

from companion.config import MissionConfig
from companion.config.compose import energy_budget_of
from companion.planning.problem import GoalRegion
from companion.service.doctor.finding import Finding, fail, ok, warn
from companion.tracking.battery import BatteryEstimator
from companion.types.events import BatteryReported, Event

CHECK = "energy"


class EnergyDoctor:
    """Listens to the battery and compares it with what the mission costs.

    Parameters
    ----------
    mission : MissionConfig
        The mission file; without a section ``energy`` there are no findings.
    """

    def __init__(self, mission: MissionConfig) -> None:
        energy = mission.energy
        self._mission = mission
        self._battery = None if energy is None else BatteryEstimator(float(energy.capacity_wh))

    def observe(self, event: Event) -> None:
        """Take an event of the autopilot."""
        if self._battery is not None and isinstance(event, BatteryReported):
            self._battery.observe(event)

    def findings(self, goals: tuple[GoalRegion, ...], now_s: float) -> list[Finding]:
        """Return what is found, given the goals: the mission file's, or the operator's waypoints."""
        if self._battery is None or not goals:
            return []
        left_wh = self._battery.left_wh(now_s)
        budget = energy_budget_of(self._mission, goals, left_wh)
        if budget is None:
            return []
        if left_wh is None:
            advice = "set up the autopilot's battery monitor (BATT_MONITOR, BATT_CAPACITY; PX4: BAT1_*)"
            return [warn(CHECK, f"no state of the battery; if it is full, {budget.verdict}", advice)]
        share = left_wh / float(self._mission.energy.capacity_wh) if self._mission.energy else 0.0
        found = f"{share:.0%}, {left_wh:.1f} Wh on board; {budget.verdict}"
        if budget.margin_at_goal_wh < 0.0:
            return [fail(CHECK, found, "charge, fly a shorter mission, or lower energy.reserve_wh")]
        if budget.margin_after_return_wh < 0.0:
            return [warn(CHECK, found, "charge, or make sure that it can land at the goals")]
        return [ok(CHECK, found)]
