"""A low battery: each autopilot tells of it once, and returns once if its parameters say so."""

import re

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.events import Dialect
from sim.autopilot.battery_failsafe import BatteryFailsafe
from sim.simulator import Simulator
from tests.sim.client import Client, plain_mission
from tests.sim.vehicle.test_simulated_battery import ENERGY

WORN = 4.0  # The battery of 1000 mAh is half empty after 24 s.
SMALL = ENERGY.replace("capacity_wh: 222, reserve_wh: 44", "capacity_wh: 22.2, reserve_wh: 4")


def low_after(seconds, dialect=Dialect.ARDUPILOT, **parameters):
    client = Client(Simulator(plain_mission(SMALL), seed=1, dialect=dialect, battery_drain=WORN))
    station = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
    client.send(station)
    for name, value in parameters.items():
        client.simulator.autopilot.parameters[name] = value
    client.step(seconds)
    return client


def told(client, beginning):
    return [text for text in client.texts() if text.startswith(beginning)]


def test_arduplane_returns_with_its_text():
    client = low_after(40.0, BATT_LOW_MAH=500, BATT_FS_LOW_ACT=1)
    assert client.simulator.autopilot.mode == "RTL"
    (text,) = told(client, "Battery")
    assert re.fullmatch(r"Battery 1 is low \d+\.\d\dV used \d+ mAh", text)
    assert float(text.split()[-2]) == pytest.approx(500, abs=2)
    (message,) = [entry for entry in client.all("STATUSTEXT") if entry.text == text]
    assert message.severity == mavlink.MAV_SEVERITY_WARNING


def test_it_returns_once_and_then_does_what_the_pilot_says():
    client = low_after(40.0, BATT_LOW_MAH=500, BATT_FS_LOW_ACT=1)
    client.simulator.set_mode("AUTO")
    client.step(5.0)
    assert client.simulator.autopilot.mode == "AUTO"
    assert len(told(client, "Battery")) == 1


@pytest.mark.parametrize(("parameters", "texts"), [({}, 0), ({"BATT_LOW_MAH": 500}, 1)])
def test_by_its_defaults_arduplane_flies_on(parameters, texts):
    client = low_after(40.0, **parameters)
    assert client.simulator.autopilot.mode == "AUTO"
    assert len(told(client, "Battery")) == texts


@pytest.mark.parametrize(("action", "mode"), [(0, "MISSION"), (3, "RTL")])
def test_px4_returns_at_the_critical_level_if_it_is_set_to(action, mode):
    client = low_after(40.0, Dialect.PX4, COM_LOW_BAT_ACT=action, BAT_CRIT_THR=0.4)
    assert client.simulator.autopilot.mode == mode
    assert told(client, "Critical battery") == ["Critical battery level"]


@pytest.mark.parametrize("dialect", list(Dialect))
def test_a_battery_that_is_not_low_is_not_told_of(dialect):
    client = low_after(3.0, dialect, **({"BATT_LOW_MAH": 200} if dialect is Dialect.ARDUPILOT else {}))
    assert not told(client, "Battery")
    assert not told(client, "Critical")


def test_on_the_ground_it_does_not_return():
    simulator = Simulator(plain_mission(SMALL), seed=1, on_ground=True)
    autopilot = simulator.autopilot
    autopilot.parameters["BATT_LOW_MAH"], autopilot.parameters["BATT_FS_LOW_ACT"] = 2_000, 1
    simulator.step(1.0)
    assert isinstance(autopilot.battery_failsafe, BatteryFailsafe)
    assert autopilot.mode == "LOITER"  # Not armed: nothing is checked.
    autopilot.arm()
    client = Client(simulator)
    client.step(1.0)
    assert autopilot.mode == "LOITER"
    assert len(told(client, "Battery")) == 1


def test_a_client_reads_and_sets_the_parameters_of_the_battery():
    client = low_after(0.1)
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"BATT_CAPACITY", -1))
    assert client.wait("PARAM_VALUE", param_id="BATT_CAPACITY").param_value == 1_000.0
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"BATT_CAPACITY", 900.0, 6))
    assert client.wait("PARAM_VALUE", param_id="BATT_CAPACITY").param_value == 900.0
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    client.step(3.0)
    listed = {message.param_id: message.param_count for message in client.all("PARAM_VALUE")}
    assert "BATT_LOW_MAH" in listed
    assert listed["WP_RADIUS"] == len(client.simulator.autopilot.parameters)
