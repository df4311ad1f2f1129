"""The three numbers of power are found again: in windows made from them, and in flights of the simulator."""

import itertools
import math

import numpy as np
import pytest
import yaml

from companion.config import mission_from_text
from companion.config.compose import power_model_of, vehicle_of
from companion.link.messages.codec import Codec
from companion.research.identification.energy_estimate import WINDOWS_MIN, energy_keys
from companion.research.identification.energy_samples import EnergyListener, EnergyWindow
from companion.research.identification.identify_command import document_of, fragment_of, identify
from companion.types.events import AirData, Attitude, BatteryReported, Dialect, GlobalPosition, Heartbeat
from companion.world.vehicle.energy import PowerModel
from companion.world.vehicle.vehicle_model import VehicleModel
from sim.simulator import Simulator
from sim.vehicle.control import Level
from tests.link.pymavlink_frames import heartbeat, packed
from tests.research.identification import synthetic
from tests.sim.client import PLAIN, Client, plain_mission
from tests.sim.vehicle.test_simulated_battery import ENERGY

TRUE = PowerModel(0.016, 3_750.0, 100.0)
VEHICLE = VehicleModel()
NAMES = ("power_cruise_w", "power_max_airspeed_w", "climb_energy_j_m")
TRUTH = dict(zip(NAMES, (TRUE.power_w(25.0), TRUE.power_w(37.5), 100.0), strict=True))


def window(rng, airspeed, climb_m=0.0, bank=0.0, noise=0.0, seconds=10.0):
    level = TRUE.power_w(airspeed, 0.0, bank) * seconds
    energy = max(0.0, level + 100.0 * climb_m) * (1.0 + noise * rng.standard_normal())
    return EnergyWindow(
        energy, seconds * airspeed**3, seconds / math.cos(bank) ** 2 / airspeed, climb_m, seconds
    )


def windows(number, noise=0.0, seed=1, speeds=(14.0, 37.0), climb_m=15.0, bank=0.6):
    rng = np.random.default_rng(seed)
    return [
        window(rng, rng.uniform(*speeds), rng.uniform(-climb_m, climb_m), rng.uniform(0.0, bank), noise)
        for _ in range(number)
    ]


def found_in(given):
    return {key.name: key for key in energy_keys(given, VEHICLE)}


def test_without_noise_the_numbers_are_exact():
    for name, key in found_in(windows(WINDOWS_MIN)).items():
        assert key.value == pytest.approx(TRUTH[name])
        assert key.high - key.low == pytest.approx(0.0, abs=1e-6)


def test_the_intervals_hold_the_truth_as_often_as_they_say():
    """Of 200 recordings with three numbers each, 95 % hold the truth: 600 draws give 570 ± 5.3."""
    hits = 0
    for seed in range(200):
        found = found_in(windows(60, noise=0.08, seed=seed))
        hits += sum(found[name].low <= TRUTH[name] <= found[name].high for name in NAMES)
    assert 535 <= hits <= 590


def test_idle_descents_do_not_bend_the_line():
    """A motor that is off in a descent takes nothing, however steep it is."""
    rng = np.random.default_rng(2)
    steep = [window(rng, 25.0, -80.0) for _ in range(20)]
    found = found_in([*windows(60), *steep])
    assert found["climb_energy_j_m"].value == pytest.approx(100.0)
    assert found["climb_energy_j_m"].note == "60 windows"


def test_at_one_airspeed_only_its_own_power_is_known():
    found = found_in(windows(60, noise=0.02, speeds=(24.9, 25.1), climb_m=0.2, bank=0.0))
    assert found["power_cruise_w"].value == pytest.approx(TRUTH["power_cruise_w"], rel=0.02)
    assert found["power_max_airspeed_w"].value is None
    assert "fly other airspeeds, too" in found["power_max_airspeed_w"].note
    assert found["climb_energy_j_m"].value is None
    assert "fly climbs and descents, too" in found["climb_energy_j_m"].note


def test_no_drag_comes_out_negative():
    """What is found may be pasted: the mission file refuses negative drags."""
    for seed in range(20):
        found = found_in(windows(WINDOWS_MIN, noise=0.3, seed=seed))
        low, high = found["power_cruise_w"].value, found["power_max_airspeed_w"].value
        if low is not None and high is not None:
            PowerModel.from_level_flight((25.0, low * (1.0 + 1e-9)), (37.5, high), 0.0)


def test_too_few_windows_are_told():
    assert energy_keys([], VEHICLE) == ()
    found = found_in(windows(WINDOWS_MIN - 1))
    assert {key.value for key in found.values()} == {None}
    assert (
        found["power_cruise_w"].note
        == "too little: 19 windows of flight with battery messages; 20 are needed"
    )


# --- windows


def events(seconds, *, airspeed=25.0, power_w=400.0, armed=True, silent=()):
    """Telemetry at 10 Hz with a battery report every two seconds; nothing between the times of ``silent``."""
    yield Heartbeat(0.0, 1, 1, Dialect.ARDUPILOT, "AUTO", is_mission_mode=True, is_armed=armed)
    for tick in range(int(10 * seconds) + 1):
        now = 0.1 * tick
        if any(begin < now < end for begin, end in silent):
            continue
        yield AirData(now, airspeed, airspeed)
        yield Attitude(now, math.radians(60.0), 0.0, 0.0)
        yield GlobalPosition(now, now, 0.0, 0.0, 600.0 + now, now, (airspeed, 0.0, 1.0))
        if tick % 20 == 0:
            yield BatteryReported(now, None, power_w * now / 3_600.0, 22.2)


def listened(given):
    listener = EnergyListener()
    for event in given:
        listener.note(event)
    return listener.windows


def test_a_window_has_its_integrals():
    found = listened(events(45.0))
    assert len(found) == 4
    for entry in found:
        assert entry.seconds == pytest.approx(10.0)
        assert entry.energy_j == pytest.approx(4_000.0)
        assert entry.cubes == pytest.approx(10.0 * 25.0**3)
        assert entry.loads == pytest.approx(10.0 * 4.0 / 25.0)
        assert entry.climb_m == pytest.approx(10.0, abs=0.11)


def test_windows_with_a_gap_are_dropped():
    found = listened(events(60.0, silent=((14.5, 17.0),)))
    assert len(found) == 5  # One until 10 s, then from 18 s on.
    assert {round(entry.energy_j) for entry in found} == {4_000}


@pytest.mark.parametrize("changes", [{"armed": False}, {"airspeed": 3.0}], ids=["disarmed", "standing"])
def test_only_flight_counts(changes):
    assert listened(events(60.0, **changes)) == []


def test_a_changed_battery_is_no_window():
    first, second = list(events(15.0)), [event for event in events(40.0) if event.stamp_s > 15.0]
    swapped = [
        BatteryReported(event.stamp_s, None, event.consumed_wh - 1.5, 22.2)
        if isinstance(event, BatteryReported)
        else event
        for event in second
    ]
    assert {round(entry.energy_j) for entry in listened([*first, *swapped])} == {4_000}


# --- the simulator


def flown(dialect, weather=""):
    """Windows of a flight in steps of airspeed, height and bank, over the link."""
    simulator = Simulator(plain_mission(ENERGY + weather), seed=1, dialect=dialect)
    client, codec, listener = Client(simulator), Codec(), EnergyListener()
    for number, rate in ((147, 0.5), (33, 10.0), (30, 10.0), (74, 5.0)):
        client.stream(number, rate)
    autopilot = simulator.autopilot
    simulator.set_mode("CRUISE" if dialect is Dialect.ARDUPILOT else "POSCTL")
    steps = itertools.product((16.0, 25.0, 34.0), ((0.0, 100.0), (0.4, 140.0), (0.0, 100.0)))
    for airspeed, (bank, height) in steps:
        autopilot.parameters["AIRSPEED_CRUISE"] = airspeed
        autopilot.flight.steering = Level(bank, height)
        for _ in range(50):
            simulator.step(1.0)
            for frame in codec.feed(simulator.take_outgoing(), simulator.now_s):
                for event in frame.events:
                    listener.note(event)
    return listener.windows


@pytest.mark.parametrize(
    ("dialect", "weather", "tolerance"),
    [
        (Dialect.ARDUPILOT, "", 0.02),
        (Dialect.PX4, "", 0.04),
        (Dialect.ARDUPILOT, "simulation: {wind_speed_m_s: 5, wind_from_deg: 240, turbulence: light}\n", 0.1),
    ],
    ids=["arduplane", "px4", "arduplane in light turbulence"],
)
def test_the_simulators_aircraft_is_found(dialect, weather, tolerance):
    """Level powers as measured in straight flight, tests/sim/vehicle; 98 J/m are 6 kg over the efficiency."""
    found = {key.name: key for key in energy_keys(flown(dialect, weather), VEHICLE)}
    for name, true in zip(NAMES, (418.0, 1_354.0, 98.1), strict=True):
        assert found[name].value == pytest.approx(true, rel=tolerance), name


# --- the command


def record_battery(folder, mission, seconds=400):
    """A flight along a straight plan at changing airspeeds, whose battery follows the true model."""
    plan = synthetic.straight_plan(mission, seconds)
    recorder, used_j = synthetic.recorder_of(folder, mission, plan), 0.0
    for at, place in zip(plan.times_s, plan.positions_enu_m, strict=True):
        for tenth in range(10):
            now = at + 0.1 * tenth
            airspeed = 22.0 + 8.0 * math.sin(now / 30.0)
            used_j += 0.1 * TRUE.power_w(airspeed)
            recorder.frame(now, synthetic.airspeed_frame(airspeed))
            recorder.frame(
                now,
                packed(synthetic.mavlink.MAVLink_attitude_message(round(1e3 * now), 0.0, 0.0, 0.0, 0, 0, 0)),
            )
            recorder.frame(now, synthetic.position_frame(mission, now, place, (airspeed, 0.0, 0.0)))
        recorder.frame(at, heartbeat())
        cells = [22_200, *[65_535] * 9]
        recorder.frame(
            at + 0.95,
            packed(
                synthetic.mavlink.MAVLink_battery_status_message(
                    0, 0, 1, 0, cells, 0, 0, round(used_j / 100.0), 80
                )
            ),
        )
    recorder.close()


def test_the_command_tells_the_keys_and_they_can_be_pasted(tmp_path):
    text = PLAIN.replace("east_m: [-6000, 6000]", "east_m: [-6000, 40000]")
    record_battery(tmp_path / "flight", mission_from_text(text, "known.yaml"))
    flights, found = identify([tmp_path / "flight"], None)
    fragment = yaml.safe_load(fragment_of(found))["energy"]
    assert fragment["power_cruise_w"] == pytest.approx(TRUTH["power_cruise_w"], rel=0.02)
    told = {entry["key"]: entry for entry in document_of(flights, found)["energy"]}
    assert set(told) == set(NAMES)
    assert told["power_cruise_w"]["low"] <= fragment["power_cruise_w"] <= told["power_cruise_w"]["high"]
    pasted = {"climb_energy_j_m": 100.0, **fragment, "capacity_wh": 200.0, "reserve_wh": 40.0}
    model = power_model_of(mission_from_text(PLAIN + yaml.safe_dump({"energy": pasted}), "pasted.yaml"))
    assert model.power_w(25.0) == pytest.approx(fragment["power_cruise_w"])


def test_recordings_without_a_battery_tell_nothing_of_energy(tmp_path):
    mission = mission_from_text(
        PLAIN.replace("east_m: [-6000, 6000]", "east_m: [-6000, 40000]"), "known.yaml"
    )
    synthetic.record_fixes(
        tmp_path / "f", mission, place_std=0.8, height_std=1.6, velocity_std=0.2, seconds=30
    )
    flights, found = identify([tmp_path / "f"], None)
    assert "energy" not in fragment_of(found)
    assert "energy" not in document_of(flights, found)
    assert energy_keys(flights[0].windows, vehicle_of(mission)) == ()
