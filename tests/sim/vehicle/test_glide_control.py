"""Without thrust the simulated autopilot keeps an airspeed by pitch, as ArduPlane's TECS does."""

import pytest

from companion.config import load_mission
from sim.simulator import Simulator
from sim.vehicle.control import Level
from tests.sim.client import CONFIGS

AIRSPEED_M_S = 17.5


def calm():
    mission = load_mission(CONFIGS / "first-flight.yaml")
    weather = mission.simulation.model_copy(update={"wind_speed_m_s": 0.0, "turbulence": "none"})
    simulator = Simulator(mission.model_copy(update={"simulation": weather}), seed=1)
    simulator.step(5.0)
    simulator.set_mode("FBWA")
    simulator._scenario.flight.has_thrust = False
    return simulator, simulator._scenario.flight


def flown(simulator, flight, below_m, seconds):
    """The true states before and after a flight to a height below the aircraft."""
    simulator.autopilot._speed_m_s = AIRSPEED_M_S
    before = flight.dynamics.state
    for _ in range(round(seconds / 0.02)):
        flight.steering = Level(0.0, flight.estimate.up_m - below_m)
        simulator.step(0.02)
    return before, flight.dynamics.state


def test_in_a_descent_it_glides_at_the_commanded_airspeed():
    """18 m/s true: drag over weight by the airframe's polar is 0.0894, so 11.2 m for each metre of height."""
    simulator, flight = calm()
    flown(simulator, flight, 60.0, 15.0)
    before, after = flown(simulator, flight, 60.0, 15.0)
    assert after.equivalent_airspeed_m_s == pytest.approx(AIRSPEED_M_S, abs=0.3)
    sink = (before.up_m - after.up_m) / 15.0
    assert after.true_airspeed_m_s / sink == pytest.approx(11.2, rel=0.03)


def test_in_sinking_air_it_keeps_the_airspeed_and_sinks_with_the_air():
    """Air that sinks by 1.5 m/s takes as much height besides the glide's own 1.6 m/s."""
    simulator, flight = calm()
    flight.dynamics._executive["atmosphere/wind-down-fps"] = 1.5 / 0.3048
    flown(simulator, flight, 60.0, 15.0)
    before, after = flown(simulator, flight, 60.0, 10.0)
    assert after.equivalent_airspeed_m_s == pytest.approx(AIRSPEED_M_S, abs=0.4)
    assert (before.up_m - after.up_m) / 10.0 == pytest.approx(18.0 / 11.2 + 1.5, abs=0.3)


def test_while_it_has_to_keep_its_height_it_slows_to_underspeed_and_then_sinks_at_the_lowest_airspeed():
    """AIRSPEED_MIN is 12 m/s, and underspeed below 10.8."""
    simulator, flight = calm()
    height = flight.estimate.up_m
    slowest, ended = 100.0, []
    for _ in range(round(45.0 / 0.02)):
        flight.steering = Level(0.0, height)
        simulator.step(0.02)
        slowest = min(slowest, flight.dynamics.state.equivalent_airspeed_m_s)
        ended.append(flight.dynamics.state.equivalent_airspeed_m_s)
    assert 9.5 < slowest < 11.5
    assert ended[-1] == pytest.approx(12.0, abs=0.5)
    assert flight.dynamics.state.up_m < height - 5.0
