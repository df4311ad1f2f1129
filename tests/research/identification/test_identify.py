"""Noise that is known is found again in recordings; where there is too little, that is said."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.stats import chi2

from companion.config import load_mission, mission_from_text
from companion.config.compose import vehicle_of
from companion.errors import RecordError
from companion.research.identification.flown_samples import flown_of
from companion.research.identification.identify_command import document_of, fragment_of, identify
from companion.research.identification.noise_estimate import identified, independent_samples, interval_of
from sim.vehicle.sensors import Accuracy
from tests.link.pymavlink_frames import heartbeat
from tests.research.identification import synthetic
from tests.sim.client import CONFIGS

RECORDINGS = Path(__file__).parents[2] / "service" / "replay" / "recordings"
GOOD = (CONFIGS / "first-flight.yaml").read_text(encoding="utf-8")
NOISE = {
    "acceleration_std_m_s2": 0.5, "course_rate_std_rad_s": 0.05, "climb_rate_std_rad_s": 0.02,
    "position_std_m": 3.0, "altitude_std_m": 4.0, "course_std_deg": 1.5, "climb_std_deg": 1.5,
}  # fmt: skip
MOTION = ("acceleration_std_m_s2", "course_rate_std_rad_s", "climb_rate_std_rad_s")


def mission_with(noise):
    lines = "".join(f"  {key}: {value}\n" for key, value in noise.items())
    text = GOOD.replace("vehicle:\n", "vehicle:\n" + lines, 1)
    return mission_from_text(text.replace("east_m: [0, 2000]", "east_m: [0, 40000]"), "known.yaml")


def key_of(found, name):
    return next(key for key in found.keys if key.name == name)


@pytest.fixture(scope="module", params=[1, 2], ids=["as it is", "three times"])
def closed_loop(request, tmp_path_factory):
    share = {1: 1.0, 2: 3.0}[request.param]
    noise = {key: share * value for key, value in NOISE.items()}
    folder = tmp_path_factory.mktemp("known") / "flight"
    synthetic.record_closed_loop(folder, mission_with(noise), seed=request.param)
    return noise, folder


def test_noise_that_is_known_is_found_again(closed_loop):
    noise, folder = closed_loop
    flown = flown_of(folder)
    # The aircraft that is identified is taken for another: nothing may come from the mission file's noise.
    found = identified([flown], vehicle_of(mission_from_text(GOOD, "other.yaml")))
    assert found.tracked_s > 0.95 * synthetic.LENGTH_S
    assert found.tracked_s == pytest.approx(sum(np.ptp(run.times_s) for run in flown.deviations))
    for key in ("position_std_m", "altitude_std_m", "course_std_deg"):
        assert found.known[key] == pytest.approx(noise[key], rel=0.01)
    for key in MOTION:
        told = key_of(found, key)
        assert told.low <= told.value <= told.high
        assert told.value == pytest.approx(noise[key], rel=0.2), key
        assert told.high / told.low < 2.0


def test_white_noise_of_fixes_and_velocities_is_seen_where_no_accuracy_is_told(tmp_path):
    mission = mission_with({})
    synthetic.record_fixes(tmp_path / "f", mission, place_std=0.8, height_std=1.6, velocity_std=0.2)
    found = identified([flown_of(tmp_path / "f")], vehicle_of(mission))
    assert found.known["position_std_m"] == pytest.approx(0.8, rel=0.1)
    assert found.known["altitude_std_m"] == pytest.approx(1.6, rel=0.12)
    assert found.known["course_std_deg"] == pytest.approx(math.degrees(0.2 / 25.0), rel=0.1)
    assert found.known["climb_std_deg"] == pytest.approx(math.degrees(0.2 / 25.0), rel=0.12)
    assert found.known["initial_position_std_m"] == found.known["position_std_m"]


@pytest.mark.parametrize("name", ["first-flight-ardupilot", "first-flight-px4"])
def test_the_simulators_sensors_are_found_in_its_flights(name):
    true = Accuracy()
    flown = flown_of(RECORDINGS / f"{name}.tlog")
    found = identified([flown], vehicle_of(flown.mission))
    place = math.hypot(true.horizontal_drift_m, true.position_m)
    height = math.hypot(true.vertical_drift_m, true.position_m)
    course = math.degrees(true.velocity_m_s / 25.0)
    assert found.known["position_std_m"] == pytest.approx(place, rel=0.1)
    assert found.known["altitude_std_m"] == pytest.approx(height, rel=0.3)
    assert found.known["course_std_deg"] == pytest.approx(course, rel=0.1)
    # White noise of fixes is 0.15 m; what the velocities' noise adds up to between two fixes is seen with it.
    innovations = flown.reported_errors.innovations[:, :2] / math.sqrt(2.0)
    assert true.position_m * 0.9 < innovations.std() < 2.0 * true.position_m


def test_of_a_flight_of_a_minute_the_motion_is_not_told():
    flown = flown_of(RECORDINGS / "first-flight-ardupilot.tlog")
    found = identified([flown], vehicle_of(flown.mission))
    for name in MOTION:
        assert key_of(found, name).value is None
        assert key_of(found, name).note.startswith("too little: 55 s along plans")
    assert "  # course_rate_std_rad_s: too little" in fragment_of(found)


def test_the_fragment_is_a_part_of_a_mission_file(closed_loop):
    noise, folder = closed_loop
    flights, found = identify([folder], None)
    keys = yaml.safe_load(fragment_of(found))["vehicle"]
    assert set(keys) == {*noise, "initial_position_std_m"}
    text = GOOD.replace("vehicle:\n", fragment_of(found) + "\n", 1)
    vehicle = mission_from_text(text, "pasted.yaml").vehicle
    assert vehicle.position_std_m == pytest.approx(noise["position_std_m"], rel=0.01)
    document = json.loads(json.dumps(document_of(flights, found), allow_nan=False))
    assert document["vehicle"] == pytest.approx(keys)
    assert document["recordings"] == [str(folder)]


def test_two_flights_say_more_than_one(closed_loop):
    _, folder = closed_loop
    one, (_, two) = identify([folder], None)[1], identify([folder, folder], None)
    for name in MOTION:
        first, both = key_of(one, name), key_of(two, name)
        assert both.value == pytest.approx(first.value, rel=0.02)
        assert both.high - both.low < first.high - first.low


def test_a_plan_that_is_not_followed_is_left_out(tmp_path):
    mission = mission_with({})
    plan = synthetic.straight_plan(mission, 200)
    recorder = synthetic.recorder_of(tmp_path / "f", mission, plan)
    for at in range(150):
        aside = 300.0 if at >= 100 else 5.0  # a pilot flies elsewhere in the end
        recorder.frame(at, heartbeat())
        recorder.frame(
            at, synthetic.position_frame(mission, at, (25.0 * at, 800.0 + aside, 103.0), (25, 0, 0))
        )
    recorder.close()
    flown = flown_of(tmp_path / "f")
    (run,) = flown.deviations
    assert flown.num_left_out == 50
    assert run.values[1:, 0] == pytest.approx(5.0, abs=0.1)  # to the left of an eastward path: north
    assert run.values[1:, 1] == pytest.approx(0.0, abs=0.1)
    assert run.values[1:, 2] == pytest.approx(3.0, abs=0.1)


def test_a_tlog_alone_tells_of_sensors_only(tmp_path):
    tlog = tmp_path / "gcs.tlog"
    tlog.write_bytes((RECORDINGS / "first-flight-ardupilot.tlog").read_bytes())
    with pytest.raises(RecordError, match="--mission"):
        flown_of(tlog)
    flights, found = identify([tlog], CONFIGS / "first-flight.yaml")
    assert found.tracked_s == 0.0
    assert found.known["position_std_m"] == 1.0
    assert key_of(found, MOTION[0]).value is None
    assert flights[0].mission == load_mission(CONFIGS / "first-flight.yaml")
    with pytest.raises(RecordError, match="neither a tlog nor a folder"):
        flown_of(tmp_path)


def test_correlated_samples_by_hand():
    # The mean product is 1 of each with itself, (1 - 1 + 1)/3 one apart, (-1 - 1)/2 two apart, which ends it.
    assert independent_samples([np.array([1.0, 1.0, -1.0, -1.0])], 3) == pytest.approx(4 / (1 + 2 / 3))


def test_correlated_samples_are_worth_fewer():
    rng = np.random.default_rng(3)
    white = rng.standard_normal(20_000)
    assert independent_samples([white], 50) == pytest.approx(20_000, rel=0.1)
    walk = np.zeros(20_000)
    for k in range(1, len(walk)):
        walk[k] = 0.9 * walk[k - 1] + white[k]
    # A Gauss-Markov process of correlation r a sample is worth (1 - r)/(1 + r) of its samples.
    assert independent_samples([walk], 200) == pytest.approx(20_000 * 0.1 / 1.9, rel=0.2)
    assert independent_samples([walk[:10_000], walk[10_000:]], 200) == pytest.approx(
        20_000 * 0.1 / 1.9, rel=0.2
    )


@pytest.mark.parametrize("num", [8, 20, 300])
def test_intervals_are_those_of_chi_square(num):
    low, high = interval_of(2.0, num)
    assert low == pytest.approx(2.0 * math.sqrt(num / chi2.ppf(0.975, num)), rel=0.01)
    assert high == pytest.approx(2.0 * math.sqrt(num / chi2.ppf(0.025, num)), rel=0.01)
