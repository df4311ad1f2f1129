"""``companion doctor`` as a process, and the simulators as others, over TCP."""

import json

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.service.client import Client
from tests.service.processes import FIRST_FLIGHT, free_port, process, simulator


def run_checks(port, *more):
    with process("-m", "companion", "doctor", FIRST_FLIGHT, "--link", f"tcp://127.0.0.1:{port}",
                 "--seconds", 1, "--json", "-", *more) as running:  # fmt: skip
        said, _ = running.communicate(timeout=120.0)
    return running.returncode, {entry["check"]: entry for entry in json.loads(said)}


def failures(found):
    return [
        entry["check"] for entry in found.values() if entry["verdict"] == "FAIL" and entry["check"] != "disk"
    ]


def test_a_simulated_px4_passes_and_gets_advice():
    port = free_port()
    with simulator(port, FIRST_FLIGHT, 1.0, "--autopilot", "px4"):
        code, found = run_checks(port)
    assert failures(found) == []
    assert code == ("disk" in found and found["disk"]["verdict"] == "FAIL")
    assert found["MIS_TKO_LAND_REQ"]["verdict"] == "WARN"
    assert all(entry["advice"] for entry in found.values() if entry["verdict"] != "OK")


def test_an_arduplane_fails_by_the_one_parameter_that_would_harm():
    port = free_port()
    with simulator(port, FIRST_FLIGHT, 1.0), Client(port) as client:
        client.hear("HEARTBEAT")
        client.send(mavlink.MAVLink_param_set_message(1, 1, b"MIS_RESTART", 1.0, 9))
        client.hear("PARAM_VALUE", lambda message: message.param_id == "MIS_RESTART")
        code, found = run_checks(port)
    assert code == 1
    assert failures(found) == ["MIS_RESTART"]
    assert "set 0" in found["MIS_RESTART"]["advice"]
    assert found["autopilot"]["found"] == "ArduPilot 4.7.0dev"
    assert found["link loss"]["verdict"] == "OK"
    assert found["airspeeds"]["verdict"] == "OK"


def test_a_missing_serial_port_is_named_and_exits_with_three(tmp_path):
    with process("-m", "companion", "doctor", "--link", f"serial://{tmp_path}/ttyNone:57600",
                 "--json", "-") as running:  # fmt: skip
        said, _ = running.communicate(timeout=120.0)
    assert running.returncode == 3
    found = {entry["check"]: entry for entry in json.loads(said)}
    assert found["serial port"]["verdict"] == "FAIL"
    assert "ttyNone" in found["serial port"]["found"]
