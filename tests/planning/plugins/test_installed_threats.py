"""Models of static threats of other packages: one sight for planner, check and judge, and none that harms."""

import logging
import math

import numpy as np
import pytest

from companion.assurance.encounters import Masks, encounter_with, radar_threats
from companion.assurance.exposure import Exposure, ExposureModel
from companion.config import load_mission, mission_from_text
from companion.config.compose import world_of
from companion.errors import ConfigError, ThreatModelError
from companion.planning.plugins import installed_threats
from companion.planning.plugins.installed_threats import with_sight
from companion.research.campaign.campaign_spec import load_campaign
from companion.research.campaign.runs import plan_runs, result_of
from companion.types.threat import Radar, ThreatPicture
from companion.world.threat_field import threat_field
from tests.support.foreign_packages import DOCS
from tests.support.paths import path_of

MISSION = DOCS / "example-threat" / "sector.yaml"
AROUND = Radar("watch", (1000.0, 800.0, 100.0), 500.0)
MODEL = ExposureModel(airspeed_min_m_s=12.5, airspeed_max_m_s=37.5, penetration_speed_m_s=30.0)


def looking(packages, *values):
    """The radar with the sight of docs/example-threat."""
    packages.install_example("example-threat")
    return with_sight(AROUND, "sector", values)


def eastward(north_m):
    """A level path at 25 m/s that passes the radar."""
    east = np.arange(600.0, 1301.0, 25.0)
    places = np.column_stack([east, np.full(len(east), north_m), np.full(len(east), 100.0)])
    return path_of(np.arange(len(east)) * 1.0, places, np.full(len(east), 0.5 * math.pi))


def test_the_example_sees_its_sector_and_nothing_else(packages):
    floor = looking(packages, 0.0, 120.0).lowest_seen_m
    degrees = np.array([0.0, 59.0, 61.0, 180.0, 299.0, 301.0])
    ahead = np.column_stack([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
    seen = floor(np.array([1000.0, 800.0]) + 300.0 * ahead) < 100.0
    assert seen.tolist() == [True, True, False, False, False, True]


def test_it_may_see_only_what_is_high(packages):
    floor = looking(packages, 0.0, 360.0, 10.0).lowest_seen_m
    assert floor(np.array([[1000.0, 1000.0]])) == pytest.approx(100.0 + 200.0 * math.tan(math.radians(10.0)))


@pytest.mark.compiled
def test_planner_check_judge_and_picture_see_the_same(packages):
    packages.install_example("example-threat")
    mission = load_mission(MISSION)
    (radar,) = mission.radar_list
    east, north, level = threat_field(world_of(mission), 100.0)
    flat_east, flat_north = (axis.ravel() for axis in np.meshgrid(east, north))
    away = np.hypot(flat_east - radar.position_enu_m[0], flat_north - radar.position_enu_m[1])
    is_clear = np.abs(away - 500.0) > 30.0  # Edges of the sector are told apart by a cell of the field only.
    side = np.degrees(np.arctan2(flat_east - radar.position_enu_m[0], flat_north - radar.position_enu_m[1]))
    is_clear &= (np.abs(np.abs(side) - 60.0) * away > 57.3 * 30.0) & (away > 30.0)
    expected = (away < 500.0) & (np.abs(side) < 60.0)
    assert ((level.ravel() > 0.0) == expected)[is_clear].all()
    assert expected[is_clear].sum() > 100
    for north_m, is_seen in ((950.0, True), (650.0, False)):
        path = eastward(north_m)
        levels = Exposure((), mission.bounds.east_m + mission.bounds.north_m, MODEL).levels(
            path, ThreatPicture(radars=(radar,))
        )
        assert bool(levels.max() > 0.1) is is_seen
        flown = np.column_stack([path.times_s, path.positions_enu_m])
        (threat,) = radar_threats([radar], flown)
        assert bool(encounter_with(threat, flown, Masks(())).levels.max() > 0.1) is is_seen


@pytest.mark.compiled
def test_the_example_runs_in_a_campaign_beside_safe_rrt_and_the_straight_line(packages):
    packages.install_example("example-threat")
    packages.install_example("example-planner")
    campaign = load_campaign(DOCS / "example-threat" / "campaign.yaml")
    assert campaign.identity()["threat_models"] == [
        ["sector", "'sector' of example-threat 1.0 (example_threat:SectorRadar)"]
    ]
    assert {run.method for run in campaign.runs} == {"safe-rrt", "beeline"}
    reached = {}
    for run in campaign.runs:
        mission = campaign.mission(run.mission, run.setting)
        _, (plan,) = plan_runs(mission, method=run.method, first_seed=run.seed, runs=1, time_limit_s=None)
        told = result_of(plan, mission)
        reached[run.method, run.setting] = told["success"], plan.measures.total_threat_amount
    assert reached["safe-rrt", "looks-away"] == (True, 0.0)
    assert reached["beeline", "looks-away"] == (True, 0.0)
    assert reached["safe-rrt", "looks-at-it"][0]
    assert not reached["beeline", "looks-at-it"][0]
    assert reached["beeline", "looks-at-it"][1] > 1.0


BROKEN = [
    ("absent:Model", None, "ModuleNotFoundError"),
    ("broken:Model", "class Own(BaseException):\n    pass\n\n\nraise SystemExit(3)\n", "SystemExit: 3"),
    (
        "broken:Model",
        "class Own(Exception):\n    pass\n\n\ndef Model(radar):\n    raise Own('no')\n",
        "Own: no",
    ),
    ("broken:Model", "def Model(radar, width):\n    return lambda places: places[:, 0]\n", "TypeError"),
    ("broken:Model", "def Model(radar):\n    return 3\n", "got int; expected what can be called with places"),
    (
        "broken:Model",
        "def Model(radar):\n    return lambda places: places\n",
        "got an array of shape (1089, 2)",
    ),
    (
        "broken:Model",
        "def Model(radar):\n    return lambda places: places[:, 0] * float('nan')\n",
        "not numbers",
    ),
    ("broken:Model", "def Model(radar):\n    return lambda places: 1 / 0\n", "ZeroDivisionError"),
]


@pytest.mark.parametrize(("place", "text", "told"), BROKEN)
def test_a_mission_with_a_broken_model_is_refused_at_its_line(packages, place, text, told):
    packages.install(
        "broken-one", {"sector": place}, {"broken": text} if text else {}, group=installed_threats.GROUP
    )
    mission = MISSION.read_text(encoding="utf-8").replace("model_values: [0, 120]", "model_values: []")
    with pytest.raises(ConfigError, match=r"m\.yaml:30: radars\.0\.model: .*broken-one 1\.0") as caught:
        mission_from_text(mission, "m.yaml")
    assert told in str(caught.value)


def test_a_model_that_nobody_has_and_values_without_a_model_are_refused():
    text = MISSION.read_text(encoding="utf-8")
    with pytest.raises(ConfigError, match=r"radars\.0\.model: .*0 threat models of one name"):
        mission_from_text(text, "m.yaml")
    with pytest.raises(ConfigError, match=r"radars\.0\.model_values: .*no model"):
        mission_from_text(text.replace("model: sector", "known_beforehand: true"), "m.yaml")
    with pytest.raises(ThreatModelError, match="0 threat models"):
        with_sight(AROUND, "sector", ())


LATER = """class Own(Exception):
    pass


class Model:
    def __init__(self, radar):
        self.calls = 0

    def __call__(self, places):
        self.calls += 1
        if self.calls > 1:
            raise Own("at call %d" % self.calls)
        return places[:, 0] + 1e9
"""


def test_a_model_that_fails_later_becomes_a_radar_that_sees_all_around_and_is_told_once(packages, caplog):
    packages.install("later-one", {"later": "later:Model"}, {"later": LATER}, group=installed_threats.GROUP)
    radar = with_sight(AROUND, "later", ())
    places = np.zeros((3, 2))
    assert (radar.lowest_seen_m(places) > 1e8).all()
    with caplog.at_level(logging.ERROR):
        for _ in range(2):
            assert (radar.lowest_seen_m(places) == -np.inf).all()
    (told,) = [record.getMessage() for record in caplog.records if "call 2" in record.getMessage()]
    assert "'later' of later-one 1.0 (later:Model): got Own: at call 2" in told
    assert "sees all around" in told
    path = eastward(900.0)
    exposure = Exposure((), (0.0, 2000.0, 0.0, 1500.0), MODEL)
    seen, around = (exposure.levels(path, ThreatPicture(radars=(one,))) for one in (radar, AROUND))
    np.testing.assert_array_equal(seen, around)
