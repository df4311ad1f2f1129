"""What the pilot is told of the battery, and when the service turns back, by outlooks made by hand."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from companion.assurance.violation import Violation
from companion.flight.construction.cycle import Conclusion
from companion.flight.monitors import energy_watch
from companion.flight.monitors.energy_watch import COMMAND_AGAIN_S, EnergyWatch
from companion.flight.prediction.energy_ahead import EnergyOutlook
from companion.flight.state.decision import SwapDecision, Verdict
from companion.flight.state.flight_phase import FlightPhase
from companion.flight.state.list_state import MissionPosition
from companion.flight.state.modes import Mode
from companion.types.events import BatteryReported
from companion.types.pilot_texts import pilot_message
from tests.flight.construction.test_cycle import flying, state, straight
from tests.flight.prediction.test_energy_ahead import PATH_WH_S, SECTION
from tests.flight.prediction.test_return_path import ARDUPLANE, made

AIRBORNE = FlightPhase(0.0, is_armed=True, is_moving=True)
BLOCKED = (Violation("clearance", 3, 5.0, 15.0, "distance to wall [m]"),)


class Scripted:
    """A watch whose outlook a test says, second by second, and what became of it."""

    def __init__(self, monkeypatch, *, turn_back=True, clear=(), drain=1.0):
        flown = flying(made(ARDUPLANE, extra=SECTION), straight())
        mission = flown.mission.model_copy(
            update={"authority": flown.mission.authority.model_copy(update={"turn_back": turn_back})}
        )
        rules = replace(flown.rules, mission=mission)
        self.flight = SimpleNamespace(state=replace(flown, rules=rules, mode=Mode.ACTIVE, phase=AIRBORNE))
        self.reader = SimpleNamespace(current=None, position=MissionPosition.OURS)
        self.told, self.whys, self.now_s, self.clear, self.drain = [], [], 0.0, clear, drain
        self.outlook = None
        world = SimpleNamespace(ownship=SimpleNamespace(state=lambda now_s: state(east=500.0, stamp=now_s)))
        self.watch = EnergyWatch(self.flight, world, self.reader, SimpleNamespace(decide=self._decide))
        monkeypatch.setattr(energy_watch, "energy_outlook", lambda *_: self.outlook)
        monkeypatch.setattr(energy_watch, "return_path", lambda *_: self.clear)

    def _decide(self, _kind, text, why=None, *, tell="", **values):
        self.told.append((self.now_s, pilot_message(tell, **values).text))
        self.whys.append((text, why))

    def second(self, turn_back_in_s=math.inf, at_home_wh=20.0, report=True, has_thrust=True):
        """Fly for a second at the model's power; whether a return is commanded."""
        self.now_s += 1.0
        self.outlook = EnergyOutlook(5.0, 10.0, turn_back_in_s, 30.0, at_home_wh)
        if report:
            used_wh = self.drain * self.now_s * PATH_WH_S
            self.watch.observe(BatteryReported(self.now_s, None, used_wh, 22.0))
        return self.watch.look(self.now_s, has_thrust=has_thrust)

    def put(self, **changes):
        self.flight.state = replace(self.flight.state, **changes)

    def texts(self):
        return [text for _, text in self.told]


def begun(monkeypatch, **changes):
    """A watch that has said at the takeover what it says."""
    scripted = Scripted(monkeypatch, **changes)
    scripted.second(report=False)
    scripted.second()
    scripted.told.clear()
    return scripted


def test_at_the_takeover_it_is_told_once_whether_goal_and_home_can_be_reached(monkeypatch):
    scripted = Scripted(monkeypatch)
    for _ in range(5):
        scripted.second(at_home_wh=34.6)
    assert scripted.texts() == ["Battery: goal and home reachable, 35 Wh at home"]
    assert scripted.whys[0][1]["left_at_home_wh"] == 34.6


def test_or_that_they_can_not(monkeypatch):
    scripted = Scripted(monkeypatch)
    for _ in range(5):
        scripted.second(at_home_wh=9.9)  # The reserve is 10 Wh.
    assert scripted.texts() == ["Battery: goal and home NOT both reachable"]


def test_a_minute_and_half_a_minute_before(monkeypatch):
    scripted = begun(monkeypatch, turn_back=False)
    for seconds in range(90, 0, -1):
        assert not scripted.second(float(seconds))
    assert scripted.texts() == ["Battery: turn back in 60 s", "Battery: turn back in 30 s"]
    first, second = (at for at, _ in scripted.told)
    assert 2.0 + 90.0 - first + 1.0 >= 60.0
    assert second - first == pytest.approx(30.0)


def test_at_once_if_less_is_left_and_again_after_there_was_more(monkeypatch):
    scripted = begun(monkeypatch, turn_back=False)
    for seconds in (200.0, 42.7, 41.0, 70.0, 42.0, 91.0, 59.0, 12.0):
        scripted.second(seconds)
    assert scripted.texts() == [
        "Battery: turn back in 42 s", "Battery: turn back in 59 s", "Battery: turn back in 12 s",
    ]  # fmt: skip


def test_without_thrust_nothing_is_told_and_no_return_is_commanded(monkeypatch):
    scripted = begun(monkeypatch, drain=3.0)
    for seconds in (20.0, 2.0, 0.0):
        assert not scripted.second(seconds, has_thrust=False)
    assert scripted.texts() == []
    assert scripted.watch.outlook is None
    assert scripted.second(0.0)


def test_a_battery_that_falls_too_fast_is_told_once(monkeypatch):
    scripted = begun(monkeypatch, drain=1.9)
    for _ in range(60):
        scripted.second()
    assert scripted.texts() == ["Battery falls 1.9 times as fast as planned"]
    assert scripted.watch.now(scripted.now_s).ratio == pytest.approx(1.9, rel=1e-3)


def test_a_battery_that_falls_more_slowly_counts_as_planned(monkeypatch):
    scripted = begun(monkeypatch, drain=0.7)
    for _ in range(60):
        scripted.second()
    assert scripted.texts() == []
    assert scripted.watch.now(scripted.now_s).ratio == 1.0
    assert scripted.watch.now(scripted.now_s).left_wh == pytest.approx(100.0 - 0.7 * 62.0 * PATH_WH_S)


def turned(monkeypatch):
    scripted = begun(monkeypatch)
    assert not scripted.second(5.1)
    assert scripted.second(5.0)
    return scripted


def test_it_turns_back_where_the_mission_file_allows_it(monkeypatch):
    scripted = turned(monkeypatch)
    assert scripted.texts()[-1] == "Battery: turning back now"
    assert scripted.watch.is_turning_back


def test_it_turns_back_before_the_last_way_home_that_it_affords_ends(monkeypatch):
    scripted = begun(monkeypatch)
    scripted.watch.note_last_way_home(scripted.now_s + 7.0)
    assert not scripted.second(200.0)
    assert scripted.second(200.0)  # 5 s before.
    assert scripted.texts() == ["Battery: turn back in 6 s", "Battery: turning back now"]


def test_a_return_that_is_not_begun_is_commanded_again(monkeypatch):
    scripted = turned(monkeypatch)
    scripted.put(mode=Mode.YIELDED)
    seconds = [number for number in range(1, 13) if scripted.second(0.0)]
    assert seconds == [COMMAND_AGAIN_S, 2 * COMMAND_AGAIN_S]


@pytest.mark.parametrize(
    ("mode", "position"),
    [
        (Mode.SUSPENDED, MissionPosition.OURS),
        (Mode.YIELDED, MissionPosition.RETURNING),
        (Mode.YIELDED, MissionPosition.PAST_GOAL),
        (Mode.YIELDED, MissionPosition.ELSEWHERE),
    ],
)
def test_a_return_that_is_begun_is_left_alone_and_so_is_the_pilot(monkeypatch, mode, position):
    scripted = turned(monkeypatch)
    scripted.put(mode=mode)
    scripted.reader.position = position
    assert not scripted.second(0.0)
    assert not scripted.watch.is_turning_back
    scripted.put(mode=Mode.YIELDED)
    scripted.reader.position = MissionPosition.OURS
    assert not any(scripted.second(0.0) for _ in range(20))
    scripted.put(mode=Mode.ACTIVE)  # The pilot flies on all the same.
    assert not any(scripted.second(0.0) for _ in range(20))
    assert scripted.texts()[-1] == "Battery: turn back in 0 s"


@pytest.mark.parametrize(("clear", "reason"), [(BLOCKED, "clearance"), (None, "not known")])
def test_a_way_home_that_does_not_keep_clear_is_told_once_and_not_flown_before_it_does(
    monkeypatch, clear, reason
):
    scripted = begun(monkeypatch, clear=clear)
    assert not any(scripted.second(3.0) for _ in range(5))
    assert scripted.texts().count("Battery: turn back! RTL does not keep clear") == 1
    assert reason in scripted.whys[-1][0]
    scripted.clear = ()
    assert scripted.second(2.0)


def test_nothing_is_said_of_a_battery_that_is_not_heard(monkeypatch):
    scripted = Scripted(monkeypatch)
    assert not any(scripted.second(0.0, report=False) for _ in range(5))
    assert scripted.texts() == []
    assert scripted.watch.status(scripted.now_s) is None


def test_after_a_landing_everything_begins_anew(monkeypatch):
    scripted = turned(monkeypatch)
    scripted.put(phase=FlightPhase(0.0))
    scripted.second(0.0)
    assert not scripted.watch.is_turning_back
    scripted.put(phase=AIRBORNE)
    assert scripted.second(0.0)


def test_without_the_section_it_does_nothing(monkeypatch):
    scripted = Scripted(monkeypatch)
    mission = scripted.flight.state.mission.model_copy(update={"energy": None})
    scripted.put(rules=replace(scripted.flight.state.rules, mission=mission))
    assert not any(scripted.second(0.0) for _ in range(5))
    assert scripted.texts() == []
    assert scripted.watch.status(scripted.now_s) is None


def test_a_plan_says_what_would_be_left(monkeypatch):
    scripted = begun(monkeypatch)
    found = Conclusion(SwapDecision(Verdict.KEEP, "kept", {"cost": 1.0}))
    noted = scripted.watch.annotated(found, straight(), scripted.now_s)
    assert noted.decision.why["cost"] == 1.0
    assert noted.decision.why["left_at_goal_wh"] > noted.decision.why["left_at_home_wh"]
    assert scripted.watch.annotated(found, None, scripted.now_s) is found


def test_the_recorded_message(monkeypatch):
    scripted = begun(monkeypatch)
    scripted.second(77.0)
    left_wh = 100.0 - 3.0 * PATH_WH_S
    assert scripted.watch.status(scripted.now_s) == {
        "left_wh": pytest.approx(left_wh), "ratio": 1.0, "home_wh": 5.0, "margin_wh": 10.0,
        "turn_back_in_s": 77.0,
    }  # fmt: skip
