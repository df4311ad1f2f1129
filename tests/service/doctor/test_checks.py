"""The doctor's judgements, each with what was found, and its round over a link to the simulator."""

import asyncio
import os
import random
import re
from datetime import UTC, datetime

import pytest

from companion.clock import ManualClock
from companion.config import load_mission, mission_from_text
from companion.config.compose import goals_of
from companion.link.messages.codec import Codec
from companion.link.wire.decoded_frame import AutopilotVersion
from companion.link.wire.memory_transport import MemoryTransport
from companion.service.doctor import host_checks as doctor
from companion.service.doctor.energy_checks import EnergyDoctor
from companion.service.doctor.finding import Verdict
from companion.service.doctor.link_checks import LinkDoctor
from companion.service.doctor.parameter_checks import (
    ARDUPLANE,
    PX4,
    parameter_findings,
    parameter_names,
    return_findings,
    version,
)
from companion.types.events import Dialect
from companion.types.mission import Command
from sim.autopilot.operator_missions import ground_of
from sim.simulator import Simulator
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import FIRST_FLIGHT

OK, WARN, FAIL = Verdict.OK, Verdict.WARN, Verdict.FAIL
MISSION = mission_from_text(FIRST_FLIGHT, "first-flight.yaml")
GOOD = {
    "MIS_RESTART": 0.0, "RTL_AUTOLAND": 2.0, "TERRAIN_FOLLOW": 0.0,
    "AVD_ENABLE": 0.0, "AVD_F_ACTION": 1.0, "AVD_W_ACTION": 1.0, "ADSB_TYPE": 0.0,
    "WP_RADIUS": 50.0, "WP_MAX_RADIUS": 0.0, "ALT_OFFSET": 0.0,
    "AIRSPEED_MIN": 12.0, "AIRSPEED_MAX": 38.0, "AIRSPEED_CRUISE": 25.0,
    "ROLL_LIMIT_DEG": 50.0, "STALL_PREVENTION": 1.0,
    "SERIAL1_PROTOCOL": 2.0, "SERIAL1_BAUD": 921.0,
}  # fmt: skip
GOOD_PX4 = {
    "MIS_TKO_LAND_REQ": 0.0, "NAV_TRAFF_AVOID": 1.0, "NAV_ACC_RAD": 10.0, "FW_AIRSPD_MIN": 12.0,
    "FW_R_LIM": 50.0,
    "FW_AIRSPD_MAX": 38.0, "FW_AIRSPD_TRIM": 25.0, "MAV_0_CONFIG": 101.0, "MAV_0_MODE": 0.0,
    "MAV_1_CONFIG": 102.0, "MAV_1_MODE": 2.0, "SER_TEL1_BAUD": 57_600.0, "SER_TEL2_BAUD": 921_600.0,
}  # fmt: skip


IN_SPACE = mission_from_text(FIRST_FLIGHT.replace("dimension: 2", "dimension: 3"), "first-flight.yaml")


@pytest.mark.parametrize(
    ("dialect", "rates", "verdict", "words"),
    [
        (Dialect.ARDUPILOT, (5.0, 5.0), OK, "5 m/s up, 5 m/s down"),
        (Dialect.PX4, (3.0, 2.0), WARN, "set FW_T_CLMB_R_SP 4.3 and FW_T_SINK_R_SP 4.3"),
        (Dialect.PX4, (4.3, 2.0), WARN, "otherwise paths are flatter"),
        (Dialect.PX4, (4.3, 4.3), OK, "4.3 m/s up"),
    ],
)
def test_an_autopilot_that_climbs_less_steeply_than_the_file_allows_is_told(dialect, rates, verdict, words):
    """25 m/s at 10 degrees are 4.34 m/s."""
    names = ("TECS_CLMB_MAX", "TECS_SINK_MAX") if dialect is Dialect.ARDUPILOT else (
        "FW_T_CLMB_R_SP", "FW_T_SINK_R_SP"
    )  # fmt: skip
    values = dict(zip(names, rates, strict=True))
    found = {each.check: each for each in parameter_findings(dialect, values, IN_SPACE, None)}["climb rates"]
    assert found.verdict is verdict
    assert words in f"{found.found} {found.advice}"
    assert "climb rates" not in {each.check for each in parameter_findings(dialect, values, MISSION, None)}


def test_a_climb_rate_that_is_not_reported_is_told():
    found = verdicts(parameter_findings(Dialect.PX4, {"FW_T_CLMB_R_SP": 5.0}, IN_SPACE, None))
    assert found["FW_T_SINK_R_SP"] is WARN
    assert not {"FW_T_CLMB_R_SP", "climb rates"} & set(found)


@pytest.mark.parametrize(
    ("dialect", "changes", "verdict", "words"),
    [
        (Dialect.ARDUPILOT, {}, OK, "50° at 24.2 m/s EAS"),
        (Dialect.ARDUPILOT, {"ROLL_LIMIT_DEG": 30.0}, WARN, "30° at 24.2 m/s EAS set ROLL_LIMIT_DEG 40:"),
        # cos = (22 / 24.19)^2: 34.2 degrees. 40 degrees need 24.19 * sqrt(cos 40 deg) = 21.2.
        (Dialect.ARDUPILOT, {"AIRSPEED_MIN": 22.0}, WARN, "34° at 24.2 m/s EAS set AIRSPEED_MIN 21 or less"),
        (Dialect.ARDUPILOT, {"AIRSPEED_MIN": 23.0, "STALL_PREVENTION": 0.0}, OK, "50°"),
        (Dialect.PX4, {"FW_R_LIM": 30.0}, WARN, "set FW_R_LIM 40: otherwise turns are wider"),
    ],
)
def test_an_autopilot_that_banks_less_than_the_file_allows_is_told(dialect, changes, verdict, words):
    values = (GOOD if dialect is Dialect.ARDUPILOT else GOOD_PX4) | changes
    found = {each.check: each for each in parameter_findings(dialect, values, MISSION, None)}["bank"]
    assert found.verdict is verdict
    assert words in f"{found.found} {found.advice}"
    del values["ROLL_LIMIT_DEG" if dialect is Dialect.ARDUPILOT else "FW_R_LIM"]
    assert "bank" not in {each.check for each in parameter_findings(dialect, values, MISSION, None)}


def verdicts(findings):
    return {finding.check: finding.verdict for finding in findings}


def test_a_clock_of_the_past_is_a_failure():
    assert doctor.clock_set(datetime(1970, 1, 1, tzinfo=UTC)).verdict is FAIL
    assert doctor.clock_set(datetime(2026, 11, 21, tzinfo=UTC)).verdict is OK


@pytest.mark.parametrize(("state", "verdict"), [(0, OK), (5, WARN), (-1, WARN)])
def test_an_unsynchronised_clock_is_told(state, verdict):
    assert doctor.clock_synchronised(state).verdict is verdict


def test_a_cold_a_temporary_and_a_warm_kernel_cache_are_told_apart(tmp_path):
    assert doctor.kernel_cache(tmp_path).verdict is WARN
    packed = tmp_path / "packed"
    packed.mkdir()
    assert doctor.kernel_cache(tmp_path, packed).verdict is WARN
    (packed / "x.o").touch()
    assert doctor.kernel_cache(tmp_path, packed).verdict is OK
    (tmp_path / "search-0123.o").touch()
    assert doctor.kernel_cache(tmp_path).verdict is OK
    temporary = tmp_path / "safe-rrt-companion-x"
    temporary.mkdir()
    assert doctor.kernel_cache(temporary).verdict is WARN
    assert doctor.kernel_cache(tmp_path / "none").verdict is FAIL


def test_a_disk_that_fills_is_told(tmp_path, monkeypatch):
    for free_mb, verdict in ((100, FAIL), (1_000, WARN), (5_000, OK)):
        usage = type("Usage", (), {"free": free_mb * 2**20})
        monkeypatch.setattr(doctor.shutil, "disk_usage", lambda folder, usage=usage: usage)
        assert doctor.disk(tmp_path / "flights" / "to come").verdict is verdict


def test_a_serial_port_is_looked_at(tmp_path):
    assert "not there" in doctor.serial_port(tmp_path / "ttyNone").found
    (tmp_path / "file").touch()
    assert doctor.serial_port(tmp_path / "file").verdict is FAIL
    master, slave = os.openpty()
    try:
        assert doctor.serial_port(type(tmp_path)(os.ttyname(slave))).verdict is OK
    finally:
        os.close(master)
        os.close(slave)


def test_a_key_that_others_may_read_is_a_failure(tmp_path):
    key = tmp_path / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o644)
    assert doctor.signing_key(key).verdict is FAIL
    key.chmod(0o600)
    assert doctor.signing_key(key).verdict is OK


@pytest.mark.parametrize(
    ("dialect", "values", "number"), [(Dialect.ARDUPILOT, GOOD, 11), (Dialect.PX4, GOOD_PX4, 6)]
)
@pytest.mark.parametrize("baud_rate", [None, 921_600])
def test_good_parameters_need_nothing(dialect, values, number, baud_rate):
    findings = parameter_findings(dialect, values, MISSION, baud_rate)
    assert {finding.verdict for finding in findings} == {OK}
    assert len(findings) == number
    assert set(values) <= set(parameter_names(dialect))


@pytest.mark.parametrize(
    ("changes", "check", "verdict"),
    [
        ({"MIS_RESTART": 1.0}, "MIS_RESTART", FAIL),
        ({"AVD_ENABLE": 1.0}, "AVD_ENABLE", WARN),
        ({"AVD_ENABLE": 1.0, "AVD_F_ACTION": 4.0}, "AVD_F_ACTION", FAIL),
        ({"ADSB_TYPE": 1.0}, "ADSB_TYPE", WARN),
        ({"WP_RADIUS": 160.0}, "WP_RADIUS", WARN),
        ({"WP_RADIUS": 10.0}, "WP_RADIUS", WARN),
        ({"AIRSPEED_MIN": 26.0}, "airspeeds", FAIL),
        ({"SERIAL1_BAUD": 57.0}, "serial ports", WARN),
        ({"SERIAL1_BAUD": float("nan")}, "serial ports", WARN),
        ({"SERIAL1_PROTOCOL": 1.0}, "serial ports", WARN),
        ({"SERIAL1_PROTOCOL": 5.0}, "serial ports", WARN),
    ],
)
def test_what_would_harm_on_arduplane_is_told_with_advice(changes, check, verdict):
    findings = parameter_findings(Dialect.ARDUPILOT, {**GOOD, **changes}, MISSION, 921_600)
    found = next(finding for finding in findings if finding.check == check)
    assert found.verdict is verdict
    assert "set" in found.advice or "let" in found.advice


@pytest.mark.parametrize(
    ("name", "value", "verdict"),
    [("MIS_TKO_LAND_REQ", 2.0, WARN), ("NAV_TRAFF_AVOID", 2.0, FAIL), ("NAV_ACC_RAD", 80.0, WARN)],
)
def test_what_would_harm_on_px4_is_told(name, value, verdict):
    findings = parameter_findings(Dialect.PX4, {**GOOD_PX4, name: value}, None, None)
    assert verdicts(findings)[name] is verdict


@pytest.mark.parametrize(
    ("changes", "advice"),
    [
        ({"MAV_1_CONFIG": 0.0}, "MAV_1_CONFIG 102"),
        ({"MAV_1_CONFIG": 201.0}, "MAV_1_CONFIG 102"),
        ({"SER_TEL2_BAUD": 57_600.0}, "SER_TEL2_BAUD for 921600"),
        ({"SER_TEL2_BAUD": float("nan")}, "SER_TEL2_BAUD for 921600"),
        ({"MAV_1_MODE": 0.0}, "MAV_n_MODE 2"),
    ],
)
def test_px4s_serial_ports_are_judged_by_the_line_that_is_used(changes, advice):
    values = {**GOOD_PX4, **changes}
    (found,) = (
        entry for entry in parameter_findings(Dialect.PX4, values, None, 921_600)
        if entry.check == "serial ports"
    )  # fmt: skip
    assert found.verdict is WARN
    assert advice in found.advice


@pytest.mark.parametrize("dialect", list(Dialect))
@pytest.mark.parametrize(("baud_rate", "verdict"), [(None, OK), (921_600, WARN)])
def test_serial_ports_that_are_not_told_are_not_judged(dialect, baud_rate, verdict):
    found = parameter_findings(dialect, {}, MISSION, baud_rate)[-1]
    assert (found.check, found.found, found.verdict) == ("serial ports", "not reported", verdict)
    assert "set" not in found.advice


def test_a_parameter_that_is_not_told_is_a_warning():
    for dialect, checks in ((Dialect.ARDUPILOT, ARDUPLANE), (Dialect.PX4, PX4)):
        found = verdicts(parameter_findings(dialect, {}, MISSION, None))
        assert all(found[check.name] is WARN for check in checks)


def test_another_version_than_those_measured_is_a_warning():
    assert version(Dialect.ARDUPILOT, AutopilotVersion((4, 7, 0), 255)).verdict is OK
    assert version(Dialect.ARDUPILOT, AutopilotVersion((4, 5, 7), 255)).verdict is WARN
    assert version(Dialect.PX4, None).verdict is WARN


def test_a_version_is_told_with_its_kind_of_release():
    # FIRMWARE_VERSION_TYPE in MAVLink's common.xml; an official release needs no word.
    kinds = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: "", 7: "?"}
    for number, kind in kinds.items():
        found = version(Dialect.PX4, AutopilotVersion((1, 17, 2), number))
        assert (found.verdict, found.found) == (OK, f"PX4 1.17.2{kind}")


class Round:
    """A link doctor before the simulator, with the wire in the test's hands."""

    def __init__(
        self,
        url="tcp://autopilot:1",
        dialect=Dialect.ARDUPILOT,
        wire=lambda data, now_s: data,
        mission=MISSION,
    ):
        self.clock, self.wire = ManualClock(), wire
        ours, self.theirs = MemoryTransport.pair()
        self.simulator = Simulator(mission, seed=1, dialect=dialect)
        self.doctor = LinkDoctor(ours, self.clock, url, mission)

    def findings(self, seconds=3.0):
        return asyncio.run(self._run(seconds))

    async def _run(self, seconds):
        self.theirs.set_receiver(self.simulator.receive)
        await self.theirs.open()
        running = asyncio.create_task(self.doctor.examine(seconds))
        while not running.done():
            self.simulator.step(0.02)
            data = self.wire(self.simulator.take_outgoing(), self.clock.now_s())
            if data:
                self.theirs.send(data)
            self.clock.advance_to(self.clock.now_s() + 0.02)
            for _ in range(4):
                await asyncio.sleep(0)
        return running.result()


@pytest.mark.parametrize("dialect", list(Dialect))
def test_a_good_link_is_found_good(dialect):
    findings = Round(dialect=dialect).findings()
    assert all(finding.advice for finding in findings if finding.verdict is not OK)
    found = verdicts(findings)
    assert [check for check, verdict in found.items() if verdict is FAIL] == []
    streams = ("link loss", "GLOBAL_POSITION_INT", "VFR_HUD", "MISSION_CURRENT", "autopilot")
    assert [found[check] for check in streams] == [OK] * 5


def test_an_arduplane_fails_by_the_one_parameter_that_would_harm():
    round_ = Round()
    round_.simulator.autopilot.parameters["MIS_RESTART"] = 1.0
    found = {finding.check: finding for finding in round_.findings()}
    assert [check for check, finding in found.items() if finding.verdict is FAIL] == ["MIS_RESTART"]
    assert "set 0" in found["MIS_RESTART"].advice
    assert found["autopilot"].found == "ArduPilot 4.7.0dev"
    assert found["airspeeds"].verdict is OK


def test_whole_numbers_of_px4_are_read_as_they_lie_in_memory():
    findings = Round(dialect=Dialect.PX4).findings()
    assert next(finding for finding in findings if finding.check == "MIS_TKO_LAND_REQ").found == "2"


@pytest.mark.thorough
def test_losses_are_counted_and_slow_streams_told():
    toss = random.Random(1)

    def every_second_turn(data, now_s):
        return b"" if toss.random() < 0.5 else data

    found = verdicts(Round(wire=every_second_turn).findings())
    assert found["link loss"] is FAIL
    assert WARN in (found["GLOBAL_POSITION_INT"], found["VFR_HUD"])


@pytest.mark.parametrize(
    ("url", "wire", "words"),
    [
        ("serial:///dev/ttyAMA0:57600", lambda data, now_s: b"", "nothing comes"),
        (
            "serial:///dev/ttyAMA0:57600",
            lambda data, now_s: bytes(byte ^ 0x5A for byte in data),
            "no message",
        ),
        ("udpin://0.0.0.0:1", lambda data, now_s: Codec(9).named_value(1.0, "x", 1.0), "no autopilot"),
    ],
)
def test_silence_has_its_reasons(url, wire, words):
    round_ = Round(url=url, wire=wire)
    (finding,) = round_.findings()
    assert finding.verdict is FAIL
    assert words in finding.found
    assert finding.advice
    assert not round_.doctor.is_received


@pytest.mark.parametrize("dialect", list(Dialect))
@pytest.mark.parametrize(
    ("capacity_wh", "verdict", "words"),
    [(60.0, OK, "reached"), (15.0, WARN, "reached"), (9.0, FAIL, "missed")],
)
def test_the_battery_s_present_state_is_compared_with_the_goals(dialect, capacity_wh, verdict, words):
    """6.7 Wh lead to the goal against no wind, 8.3 Wh back; some 2 Wh are used while the doctor looks."""
    text = FIRST_FLIGHT + (
        "energy: {power_cruise_w: 418, power_max_airspeed_w: 1354, climb_energy_j_m: 98, "
        f"capacity_wh: {capacity_wh}, reserve_wh: 3}}\n"
    )
    found = Round(dialect=dialect, mission=mission_from_text(text, "electric.yaml")).findings()
    (energy,) = [finding for finding in found if finding.check == "energy"]
    assert energy.verdict is verdict
    number = r"(-?\d+\.\d) Wh"
    read = re.search(
        rf"{number} on board; {number} left at the last goal, the reserve of 3 Wh {words} by {number}",
        energy.found,
    )
    on_board, left, by = map(float, read.groups())
    assert on_board < capacity_wh
    assert left == pytest.approx(on_board - 6.7, abs=0.15)
    assert by == pytest.approx(abs(left - 3.0), abs=0.15)
    assert bool(energy.advice) is (verdict is not OK)


def test_a_battery_that_is_not_reported_is_a_warning_and_taken_for_full():
    text = FIRST_FLIGHT + (
        "energy: {power_cruise_w: 418, power_max_airspeed_w: 1354, climb_energy_j_m: 98, "
        "capacity_wh: 60, reserve_wh: 3}\n"
    )
    mission = mission_from_text(text, "electric.yaml")
    goals = goals_of(mission)
    (energy,) = EnergyDoctor(mission).findings(goals, 0.0)
    assert energy.verdict is WARN
    assert "no state of the battery; if it is full, 53" in energy.found
    assert "BATT_MONITOR" in energy.advice
    assert EnergyDoctor(MISSION).findings(goals, 0.0) == []
    assert EnergyDoctor(mission).findings((), 0.0) == []


@pytest.mark.parametrize("dialect", list(Dialect))
def test_the_item_that_is_lowest_over_the_ground_is_told(dialect):
    """The first waypoint and the circle lie at one place, 150 m up; PX4 also lists a landing."""
    mission = load_mission(CONFIGS / "ridge.yaml")
    around = Round(dialect=dialect, mission=mission)
    (found,) = [entry for entry in around.findings() if entry.check == "ground"]
    items, projection = around.simulator.autopilot.mission_items, around.simulator.autopilot.projection
    ground, home_m = ground_of(mission)
    heights = {}
    for item in items:
        if item.latitude_e7 and item.command not in (Command.NAV_TAKEOFF, Command.NAV_LAND) and item.sequence:
            place = projection.local(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7)
            number = item.sequence + (dialect is Dialect.PX4)
            heights[number] = item.altitude_m + home_m - ground.up_m(*place)
    least = min(heights, key=heights.get)
    assert found.found == f"lowest item {least}, {heights[least]:.0f} m over ground"
    assert "ground" not in {entry.check for entry in Round(dialect=dialect).findings()}


@pytest.mark.parametrize(("numbers", "is_told"), [((4, 6, 1), True), ((4, 6, 2), False), (None, False)])
def test_a_return_path_needs_an_arduplane_that_knows_it(numbers, is_told):
    reported = None if numbers is None else AutopilotVersion(numbers, 255)
    found = return_findings(Dialect.ARDUPILOT, {"RTL_AUTOLAND": 4.0}, reported)
    assert [entry.verdict.value for entry in found] == ["WARN"] * is_told
    assert not return_findings(Dialect.ARDUPILOT, {"RTL_AUTOLAND": 2.0}, reported)
    assert not return_findings(Dialect.PX4, {"RTL_AUTOLAND": 4.0}, reported)
