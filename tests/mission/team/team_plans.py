"""Plans for tests of the team."""

import numpy as np

from companion.frames import LocalFrame
from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.team_settings import TeamSettings

FRAME = LocalFrame(47.4, 8.5, 450.0)
SETTINGS = TeamSettings(apart_m=100.0, apart_up_m=30.0)
BEGIN_S = 1.9e9


def plan(
    *places,
    begin_s=BEGIN_S,
    speed_m_s=20.0,
    member=1,
    number=1,
    radius_m=80.0,
    tolerances_m=(15.0, 8.0),
    **more,
):
    """A plan through places (east, north, up) at a speed."""
    places = np.array(places, dtype=float)
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    times = begin_s + np.concatenate([[0.0], np.cumsum(lengths / speed_m_s)])
    return SharedPlan(member, number, np.column_stack([times, places]), radius_m, *tolerances_m, **more)


def zigzag(num_legs, step_m=500.0):
    """Places of a path with so many legs, none of which can be left out."""
    return [(k * step_m, 200.0 * (k % 2), 50.0 + 7.0 * k) for k in range(num_legs + 1)]
