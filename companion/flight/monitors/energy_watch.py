"""Know what is left on board and what the way home costs, and tell the pilot when to turn back.

Once a second the power that the model expects is noted, so that the battery's reports can be compared with
it. The margin is what is left beyond the way home and the reserve. Where the mission file allows it, the
service returns before the margin is gone.
"""

from __future__ import annotations

import math
from dataclasses import replace

from companion.config.compose import power_model_of
from companion.flight.construction.cycle import Conclusion
from companion.flight.exchange.list_reader import ListReader
from companion.flight.messages.announcer import Announcer
from companion.flight.prediction.energy_ahead import (
    EnergyNow,
    EnergyOutlook,
    energy_at_ends_wh,
    energy_outlook,
    reported_airspeed_m_s,
)
from companion.flight.prediction.return_path import return_path
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import FlightState, StateOwner
from companion.flight.state.list_state import MissionPosition
from companion.flight.state.modes import Mode
from companion.flight.state.world_model import WorldModel
from companion.tracking.battery import BatteryEstimator
from companion.types.events import BatteryReported, Event
from companion.types.path import Path
from companion.types.state import Ownship

ANNOUNCED_S = (60.0, 30.0)  # The pilot is informed this long before the aircraft must turn back.
EARLY_S = 1.5  # Both texts come this much earlier, because the margin is computed once a second.
FAR_AGAIN_S = 30.0  # Both are announced again once the time has exceeded the first by this much.
# The last minute counts less than the whole flight by as much as rising and sinking air may change it.
RECENT_SHARE = 0.9
RATIO_ANNOUNCED = 1.3  # A battery that falls this many times as fast as modelled is announced.
# The service turns back this long before the margin is gone: the command, its answer, and the next look.
TURN_LEAD_S = 5.0
COMMAND_AGAIN_S = 5.0  # A return that the autopilot has not begun is commanded again after this time.


class EnergyWatch:
    """Follows the battery of a mission file with a section ``energy``; without one it does nothing.

    Parameters
    ----------
    flight : StateOwner
        The flown path and the mission file.
    world_model : WorldModel
        The aircraft.
    reader : ListReader
        Knows where in its list the autopilot is.
    announcer : Announcer
        Informs the pilot.

    Attributes
    ----------
    outlook : EnergyOutlook or None
        What the way home costs; None while that or the battery is not known.
    is_turning_back : bool
        Whether a return was commanded for the battery's sake and has not begun yet.
    """

    def __init__(
        self, flight: StateOwner, world_model: WorldModel, reader: ListReader, announcer: Announcer
    ) -> None:
        self._flight, self._world_model = flight, world_model
        self._reader, self._announcer = reader, announcer
        self._estimator: BatteryEstimator | None = None
        self._capacity_wh = 0.0
        self.outlook: EnergyOutlook | None = None
        self.is_turning_back = False
        self._forget_flight()

    def _forget_flight(self) -> None:
        """Forget what was announced in a flight that is over."""
        self.outlook, self.is_turning_back, self._way_home_ends_s = None, False, math.inf
        self._commanded_s, self._announced_s = -math.inf, math.inf
        self._is_ratio_announced = self._is_reach_announced = False
        self._is_blocked_announced = self._has_turned = False

    def observe(self, event: Event) -> None:
        """Take an event of the aircraft."""
        if isinstance(event, BatteryReported) and self._estimator is not None:
            self._estimator.observe(event)

    def now(self, now_s: float) -> EnergyNow | None:
        """Return what is left and how fast it falls; None if that is not known."""
        left_wh = None if self._estimator is None else self._estimator.left_wh(now_s)
        if self._estimator is None or left_wh is None:
            return None
        recent, long = self._estimator.ratio(now_s) or 0.0, self._estimator.long_ratio(now_s) or 0.0
        return EnergyNow(left_wh, max(1.0, long, RECENT_SHARE * recent))

    def status(self, now_s: float) -> dict[str, object] | None:
        """Return the message ``/energy``; None without a section ``energy``, or if nothing is known."""
        now, outlook = self.now(now_s), self.outlook
        if now is None:
            return None
        return {
            "left_wh": now.left_wh,
            "ratio": now.ratio,
            "home_wh": None if outlook is None else outlook.home_wh,
            "margin_wh": None if outlook is None else outlook.margin_wh,
            "turn_back_in_s": None if outlook is None else outlook.turn_back_in_s,
        }

    def look(self, now_s: float, *, has_thrust: bool) -> bool:
        """Compute the margin, once a second, and inform the pilot; not in a glide, which needs no battery.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        has_thrust : bool
            Whether the engine runs.

        Returns
        -------
        bool
            Whether a return to launch is to be commanded now.
        """
        state, ownship = self._flight.state, self._world_model.ownship.state(now_s)
        self._note_expected(state, ownship, now_s)
        if not state.phase.is_airborne:
            self._forget_flight()
        now = self.now(now_s)
        if now is None or ownship is None or not (state.phase.is_airborne and has_thrust):
            self.outlook = None
            return False
        self._tell_ratio(now_s)
        self.outlook = outlook = self._outlook(state, ownship, now, now_s)
        if state.mode is not Mode.ACTIVE:
            self._announced_s = math.inf
            return self._is_unanswered(state, now_s)
        self.is_turning_back = False
        if outlook is None or state.flown is None:
            return False
        self._tell_reach(state, outlook)
        self._tell_time(outlook)
        is_due = outlook.turn_back_in_s <= TURN_LEAD_S and not self._has_turned
        if not (is_due and state.mission.authority.turn_back):
            return False
        return self._turns_back(state, ownship, outlook, now_s)

    def note_last_way_home(self, ends_s: float) -> None:
        """Note until when a return by the kept path keeps clear if no other one is affordable, else infinity.

        Parameters
        ----------
        ends_s : float
            That time by the service's clock [s].
        """
        self._way_home_ends_s = ends_s

    def _outlook(
        self, state: FlightState, ownship: Ownship, now: EnergyNow, now_s: float
    ) -> EnergyOutlook | None:
        """Return the outlook; the aircraft turns back before the last way home that it affords ends."""
        outlook = energy_outlook(state, ownship, self._reader.current, now)
        if outlook is None:
            return None
        ends_s = max(self._way_home_ends_s - now_s, 0.0)
        return replace(outlook, turn_back_in_s=min(outlook.turn_back_in_s, ends_s))

    def annotated(self, found: Conclusion, planned: Path | None, now_s: float) -> Conclusion:
        """Return a plan's conclusion with what would be left at the goal and at home among its numbers.

        Parameters
        ----------
        found : Conclusion
            The conclusion.
        planned : Path or None
            The plan's path; None if it does not lead to the goal.
        now_s : float
            The clock's reading [s].
        """
        made = found.constructed
        path = planned if made is None else made.path
        facts = {} if path is None else self.left_after(path, now_s)
        if not facts:
            return found
        decision = replace(found.decision, why={**found.decision.why, **facts})
        made = None if made is None else replace(made, why={**made.why, **facts})
        return replace(found, decision=decision, constructed=made)

    def left_after(self, path: Path, now_s: float) -> dict[str, object]:
        """Return what would be left at the end of a path to the goal, and at home, for the record.

        The result is empty without a section ``energy``, or if nothing is known of battery or home.
        """
        now, ownship = self.now(now_s), self._world_model.ownship.state(now_s)
        if now is None or ownship is None:
            return {}
        left = energy_at_ends_wh(self._flight.state, ownship, path, self._reader.current, now)
        return {} if left is None else {"left_at_goal_wh": left[0], "left_at_home_wh": left[1]}

    def _note_expected(self, state: FlightState, ownship: Ownship | None, now_s: float) -> None:
        """Note the power that the model expects from now on; follow another capacity of the mission file."""
        model, energy = power_model_of(state.mission), state.mission.energy
        if model is None or energy is None:
            self._estimator = None
            return
        if self._estimator is None or self._capacity_wh != float(energy.capacity_wh):
            self._capacity_wh = float(energy.capacity_wh)
            self._estimator = BatteryEstimator(self._capacity_wh)
        if ownship is None or not state.phase.is_airborne:
            self._estimator.note_expected(now_s, 0.0)
            return
        climb_m_s = ownship.climb_m_s
        power_w = model.power_w(reported_airspeed_m_s(state, ownship), climb_m_s, ownship.bank_rad)
        self._estimator.note_expected(now_s, power_w)

    def _tell_ratio(self, now_s: float) -> None:
        """Tell once a flight that the battery falls faster than modelled."""
        ratio = None if self._estimator is None else self._estimator.ratio(now_s)
        if ratio is None or ratio <= RATIO_ANNOUNCED or self._is_ratio_announced:
            return
        self._is_ratio_announced = True
        words = f"it falls {ratio:.2f} times as fast as planned"
        self._announcer.decide(
            DecisionKind.ENERGY, words, why={"ratio": ratio}, tell="battery ratio", ratio=f"{ratio:.1f}"
        )

    def _tell_reach(self, state: FlightState, outlook: EnergyOutlook) -> None:
        """Tell once, after the takeover, whether goal and home can both be reached."""
        energy, left_wh = state.mission.energy, outlook.at_home_wh
        if self._is_reach_announced or left_wh is None or energy is None or not state.flies_to_goal:
            return
        self._is_reach_announced = True
        is_reached = left_wh >= float(energy.reserve_wh)
        verdict = "goal and home reachable" if is_reached else "goal and home not both reachable"
        self._announcer.decide(
            DecisionKind.ENERGY, f"{verdict}, {left_wh:.1f} Wh left at home", why=_facts(outlook),
            tell="battery reach" if is_reached else "battery short", left=f"{left_wh:.0f}",
        )  # fmt: skip

    def _tell_time(self, outlook: EnergyOutlook) -> None:
        """Tell how long before the aircraft must turn back: at each of :data:`ANNOUNCED_S`, or at once."""
        seconds = outlook.turn_back_in_s
        if seconds > ANNOUNCED_S[0] + FAR_AGAIN_S:
            self._announced_s = math.inf
        due_s = min((stage_s for stage_s in ANNOUNCED_S if seconds <= stage_s + EARLY_S), default=math.inf)
        if due_s >= self._announced_s:
            return
        self._announced_s = due_s
        time = f"{max(math.floor(min(seconds, due_s)), 0)}"
        self._announcer.decide(
            DecisionKind.ENERGY, f"turn back in {time} s", why=_facts(outlook), tell="battery turn", time=time
        )

    def _turns_back(self, state: FlightState, ownship: Ownship, outlook: EnergyOutlook, now_s: float) -> bool:
        """Announce that the service turns back now, or that the way home does not keep clear."""
        found = return_path(state, ownship, self._reader.current)
        if found == ():
            # Once a flight: the pilot may fly on all the same.
            self.is_turning_back = self._has_turned = True
            self._commanded_s = now_s
            self._announcer.decide(
                DecisionKind.ENERGY, "turning back now", why=_facts(outlook), tell="battery return"
            )
            return True
        if not self._is_blocked_announced:
            self._is_blocked_announced = True
            reason = "the way home is not known" if found is None else str(found[0])
            words = f"must turn back, but flies on: {reason}"
            self._announcer.decide(DecisionKind.ENERGY, words, why=_facts(outlook), tell="battery blocked")
        return False

    def _is_unanswered(self, state: FlightState, now_s: float) -> bool:
        """Return whether the autopilot has not begun the return that was commanded a while ago."""
        if state.mode is not Mode.YIELDED or self._reader.position is not MissionPosition.OURS:
            self.is_turning_back = False
        if not self.is_turning_back or now_s - self._commanded_s < COMMAND_AGAIN_S:
            return False
        self._commanded_s = now_s
        return True


def _facts(outlook: EnergyOutlook) -> dict[str, object]:
    """Return the numbers of an outlook for the record."""
    return {
        "margin_wh": outlook.margin_wh,
        "home_wh": outlook.home_wh,
        "turn_back_in_s": outlook.turn_back_in_s,
        "left_at_goal_wh": outlook.at_end_wh,
        "left_at_home_wh": outlook.at_home_wh,
    }
