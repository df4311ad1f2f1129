"""An engine that stops over ridges: the field behind the nearest ridge is left, for one along the valley."""

from dataclasses import replace

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.mission.glide.glide_progress import begin_of
from companion.mission.glide.landing_choice import best_field
from companion.types.events import Dialect
from sim.vehicle.true_ground import TrueGround
from tests.glide.glide_flights import GlideHarness, judged

STOPS_S = 27.0
# From the south end of a valley to its north end. Home lies on a flank, "behind" across a ridge of 270 m.
MISSION = """
name: valley-of-ridges
dimension: 3
unit_m: 25
origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}
bounds: {east_m: [0, 5000], north_m: [0, 3500], up_m: [20, 600]}
start: {east_m: 2150, north_m: 250, up_m: 280, course_deg: 340}
goals: [{east_m: 1800, north_m: 3200, up_m: 280, acceptance_radius_m: 60}]
vehicle: {airspeed_min_m_s: 12.5, airspeed_max_m_s: 37.5, airspeed_cruise_m_s: 25, acceleration_max_m_s2: 0.5,
  turn_radius_min_m: 125, straight_length_min_m: 125, penetration_speed_m_s: 30}
planning: {sensing_horizon_m: 825, time_horizon_s: 15, total_planning_time_s: 300}
terrain: {generated: {kind: ridges, seed: 4, relief_m: 280}, height_min_m: 50}
authority: {glide: true}
glide:
  ratio: 10.5
  airspeed_m_s: 18
  fields:
    - {name: valley, east_m: 1680, north_m: 3050, radius_m: 90}
    - {name: behind, east_m: 3200, north_m: 1250, radius_m: 90}
simulation: {wind_speed_m_s: 2, wind_from_deg: 250, turbulence: light}
"""


class Watched(GlideHarness):
    """A flight that remembers what could be chosen when thrust was missed."""

    options = begin = None

    def act(self, _harness):
        """Stop the engine when it is time, and look at the choices once it is missed."""
        super().act(self)
        state = self.app.state
        if self.begin is None and not self.app.replanning.performance.has_thrust:
            self.options = state.rules.glide_options(state.home_enu_m, state.rally_points)
            self.begin = begin_of(
                self.options, self.app._departure.glide._world_model.ownship.state(self.now_s)
            )


@pytest.mark.parametrize("dialect", [Dialect.ARDUPILOT, pytest.param(Dialect.PX4, marks=pytest.mark.slow)])
def test_the_field_behind_the_ridge_is_left_for_one_in_the_valley(dialect):
    mission = mission_from_text(MISSION, "ridges.yaml")
    harness = Watched(mission, 1, dialect, STOPS_S)
    harness.fly(STOPS_S + 400.0, harness.act)
    told = judged(1, mission, dialect, harness)
    assert told.verdict == "at the field", told
    assert told.place == "valley"
    assert best_field(harness.options, harness.begin).place.name == "valley"
    flat = best_field(replace(harness.options, ground=None), harness.begin)
    assert flat.place.name == "behind", "who believes the ground flat flies into the ridge:"
    assert least_height_on(flat.direct, harness.simulator.truth.ground) < 0.0
    rows = np.array(harness.simulator.truth.path)
    glided = rows[rows[:, 0] > harness.stopped_s]
    ground: TrueGround = harness.simulator.truth.ground
    over = glided[:, 3] - ground.ups_m(glided[:, 1], glided[:, 2])
    away = np.hypot(glided[:, 1] - 1680.0, glided[:, 2] - 3050.0)
    assert over[away > 400.0].min() > 25.0, "far from the field the ground is far, too"


def least_height_on(glide, ground):
    """Least height over the simulator's ground on a glide up to its end."""
    track = glide.track()
    at = np.linspace(0.0, len(track) - 1.0, 500)
    line = np.column_stack([np.interp(at, np.arange(len(track)), track[:, axis]) for axis in range(3)])
    return float((line[:-1, 2] - ground.ups_m(line[:-1, 0], line[:-1, 1])).min())
