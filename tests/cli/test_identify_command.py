"""``companion identify`` as a user meets it."""

import json
from pathlib import Path

from tests.sim.client import CONFIGS

RECORDINGS = Path(__file__).parents[1] / "service" / "replay" / "recordings"


def test_it_prints_what_can_be_pasted_into_a_mission_file(companion):
    result = companion("identify", RECORDINGS / "first-flight-px4.tlog")
    assert result.code == 0
    assert "\nvehicle:\n" in result.out
    assert "\n  position_std_m: 1  # " in result.out
    assert "\n  # climb_rate_std_rad_s: too little: 54 s along plans" in result.out


def test_json_is_one_document_of_all_recordings(companion):
    names = [str(RECORDINGS / f"first-flight-{kind}.tlog") for kind in ("px4", "ardupilot")]
    result = companion("identify", *names, "--json", "-")
    assert result.code == 0
    document = json.loads(result.out)
    assert document["recordings"] == names
    assert document["tracked_s"] > 100.0
    assert document["vehicle"]["position_std_m"] == 1.0
    # Two flights of a minute are enough where one is not.
    assert 0.0 < document["vehicle"]["climb_rate_std_rad_s"] < 0.1


def test_too_little_is_an_exit_code_and_what_is_no_recording_an_error(companion, tmp_path):
    empty = tmp_path / "empty.tlog"
    empty.touch()
    result = companion("identify", empty, "--mission", CONFIGS / "first-flight.yaml")
    assert result.code == 1
    assert "too little: 0 s along plans" in result.out
    result = companion("identify", tmp_path)
    assert result.code == 2
    assert "neither a tlog nor a folder" in result.err
