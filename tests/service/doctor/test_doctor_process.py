"""What ``companion doctor`` exits with."""

import json

from companion.service.doctor import host_checks
from tests.cli.calls import FIRST_FLIGHT


def examined(command, *arguments):
    done = command("doctor", *arguments, "--json", "-")
    return done.code, {entry["check"]: entry for entry in json.loads(done.out)}


def test_a_failed_check_exits_with_one(companion_command, monkeypatch):
    usage = type("Usage", (), {"free": 0})
    monkeypatch.setattr(host_checks.shutil, "disk_usage", lambda folder: usage)
    code, found = examined(companion_command, FIRST_FLIGHT)
    assert code == 1
    assert found["disk"]["verdict"] == "FAIL"


def test_a_missing_serial_port_is_named_and_exits_with_three(companion_command, tmp_path):
    code, found = examined(companion_command, "--link", f"serial://{tmp_path}/ttyNone:57600")
    assert code == 3
    assert found["serial port"]["verdict"] == "FAIL"
    assert "ttyNone" in found["serial port"]["found"]
