"""The simulated battery: by hand, against the airframe's own figures, and absent unless it is asked for."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.events import Dialect
from sim.autopilot.autopilot_parameters import Parameters
from sim.scenario import build
from sim.simulator import Simulator
from sim.vehicle.attitude import GRAVITY_M_S2, Airframe
from sim.vehicle.control import TICK_S, Level
from sim.vehicle.simulated_battery import AVIONICS_W, EFFICIENCY, SimulatedBattery
from tests.sim.client import Client, plain_mission

ENERGY = """
energy: {power_cruise_w: 418, power_max_airspeed_w: 1354, climb_energy_j_m: 98,
  capacity_wh: 222, reserve_wh: 44}
"""
BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)


def test_thrust_and_avionics_drain_it():
    battery = SimulatedBattery(222.0)
    battery.drain(60.0, 1_800.0)
    assert battery.used_wh == pytest.approx(0.5 * (60.0 / EFFICIENCY + AVIONICS_W))
    assert battery.remaining == pytest.approx(1.0 - battery.used_wh / 222.0)
    # 108 W of a full pack: I = 4.307 A, since 25.2 V less 0.03 ohm times 4.307 A are 25.07 V.
    assert battery.current_a == pytest.approx(4.307, abs=0.001)
    assert battery.used_mah == pytest.approx(4_307.0 / 2.0, abs=1.0)
    battery.drain(-60.0, 3_600.0)  # A propeller in the wind gives nothing back.
    assert battery.used_wh == pytest.approx(54.0 + AVIONICS_W)


def test_the_voltage_falls_from_full_to_empty_and_no_further():
    battery = SimulatedBattery(10.0)
    assert battery.voltage_v == pytest.approx(25.2)
    battery.drain(1e6, 3_600.0)
    assert battery.remaining == 0.0
    battery.drain(0.0, 0.0)
    assert battery.voltage_v == pytest.approx(19.8, abs=0.02)


def test_charge_times_voltage_is_the_energy():
    battery, energy_wh = SimulatedBattery(222.0), 0.0
    for _ in range(1_000):
        before_mah = battery.used_mah
        battery.drain(250.0, 1.0)
        energy_wh += 1e-3 * (battery.used_mah - before_mah) * battery.voltage_v
    assert energy_wh == pytest.approx(battery.used_wh, rel=1e-3)


def test_one_that_is_worse_than_told_falls_faster():
    good, worn = SimulatedBattery(222.0), SimulatedBattery(222.0, 1.9)
    for battery in (good, worn):
        battery.drain(240.0, 60.0)
    assert worn.used_wh == pytest.approx(1.9 * good.used_wh)


@pytest.mark.parametrize("airspeed", [16.0, 25.0, 35.0])
def test_level_flight_takes_the_airframes_drag(airspeed):
    """The drag of the airframe's figures, which the control loops know, not of JSBSim's tables."""
    scenario = build(plain_mission(ENERGY), 1, Dialect.ARDUPILOT)
    flight = scenario.flight
    flight.airspeed_m_s, flight.steering = airspeed, Level(0.0, 100.0)
    for _ in range(round(25.0 / TICK_S)):
        flight.tick()
    before = flight.battery.used_wh
    for _ in range(round(20.0 / TICK_S)):
        flight.tick()
    power = 3_600.0 * (flight.battery.used_wh - before) / 20.0
    state, airframe = scenario.dynamics.state, Airframe()
    lift = airframe.lift_coefficient(state.equivalent_airspeed_m_s, 1.0)
    drag = airframe.drag_n(state.equivalent_airspeed_m_s, lift)
    assert power == pytest.approx(drag * state.true_airspeed_m_s / EFFICIENCY + AVIONICS_W, rel=0.03)


def test_a_climb_takes_its_weight():
    scenario = build(plain_mission(ENERGY), 1, Dialect.ARDUPILOT)
    flight = scenario.flight
    flight.steering = Level(0.0, 100.0)

    def flown(seconds):
        before = flight.battery.used_wh
        for _ in range(round(seconds / TICK_S)):
            flight.tick()
        return 3_600.0 * (flight.battery.used_wh - before)

    flown(20.0)
    level = flown(30.0)
    flight.steering = Level(0.0, 150.0)
    climbed = flown(30.0)
    assert scenario.dynamics.state.up_m == pytest.approx(150.0, abs=3.0)
    assert climbed - level == pytest.approx(50.0 * Airframe().mass_kg * GRAVITY_M_S2 / EFFICIENCY, rel=0.06)


@BOTH
def test_without_the_section_nothing_tells_of_a_battery(dialect):
    client = Client(Simulator(plain_mission(), seed=1, dialect=dialect))
    autopilot = client.simulator.autopilot
    assert len(autopilot.parameters) == len(
        Parameters() if dialect is Dialect.ARDUPILOT else Parameters.px4_defaults()
    )
    assert client.stream(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0) != 0
    client.step(3.0)
    assert not client.all("BATTERY_STATUS")
    assert {message.voltage_battery for message in client.all("SYS_STATUS")} <= {16_000}
    assert client.simulator.energy_used_wh == 0.0


@BOTH
def test_with_the_section_both_messages_tell_the_same(dialect):
    client = Client(Simulator(plain_mission(ENERGY), seed=1, dialect=dialect))
    for number in (mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, mavlink.MAVLINK_MSG_ID_SYS_STATUS):
        assert client.stream(number, 1.0) == 0
    client.step(30.0)
    told, status = client.all("BATTERY_STATUS")[-1], client.all("SYS_STATUS")[-1]
    used_wh = client.simulator.energy_used_wh
    assert told.current_consumed == pytest.approx(1e3 * used_wh / 24.7, rel=0.05)
    counts_energy = dialect is Dialect.ARDUPILOT
    assert told.energy_consumed == (pytest.approx(36.0 * used_wh, rel=0.05) if counts_energy else -1)
    assert told.battery_remaining == status.battery_remaining == math.floor(100.0 * (1.0 - used_wh / 222.0))
    assert told.voltages[0] == pytest.approx(status.voltage_battery, abs=50)


def test_the_flight_is_the_same_with_a_battery():
    plain, electric = (Simulator(plain_mission(extra), seed=3) for extra in ("", ENERGY))
    for simulator in (plain, electric):
        simulator.step(20.0)
    assert plain.truth.path == electric.truth.path


def test_a_factor_of_the_drain_reaches_the_battery():
    flights = [Simulator(plain_mission(ENERGY), seed=1, battery_drain=drain) for drain in (1.0, 2.0)]
    for flight in flights:
        flight.step(10.0)
    assert flights[1].energy_used_wh == pytest.approx(2.0 * flights[0].energy_used_wh)
