"""What is wrong is told in one line, with file, line, key, value and expectation, and by the exit code."""

import logging
import re
from pathlib import Path

import pytest

from companion import cli
from companion.errors import LinkError
from tests.cli.calls import FIRST_FLIGHT, changed, in_a_process

COMMANDS = ["check", "plan", "sitl"]


def only_line(result):
    assert result.out == ""
    lines = result.err.splitlines()
    assert len(lines) == 1, result.err
    return lines[0]


WRONG = {
    "unknown key": ("unit_m: 25", "unit_km: 25", "unit_km", "a key that is not known", "unit_m (metres)"),
    "wrong unit": (
        "airspeed_cruise_m_s: 25", "airspeed_cruise_m_s: 90 km/h", "vehicle.airspeed_cruise_m_s", "90 km/h",
        "a number (metres per second)",
    ),
    "goal inside an obstacle": (
        "{east_m: 1750, north_m: 750,", "{east_m: 1150, north_m: 1075,", "goals.0", "",
        "a point outside the obstacle 'wall'",
    ),
    "polygon that crosses itself": (
        "[[1000, 1050], [1300, 1050], [1300, 1100], [1000, 1100]]",
        "[[1000, 1050], [1300, 1100], [1300, 1050], [1000, 1100]]", "obstacles.0.polygon_enu_m", "",
        "edges that do not cross or touch",
    ),
    "start out of bounds": (
        "{east_m: 150, north_m: 750", "{east_m: -150, north_m: 750", "start.east_m", "-150",
        "within bounds.east_m, 0 to 2000",
    ),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_wrong_mission_file(companion, tmp_path, command, wrong):
    old, new, key, value, expected = wrong
    path, line = changed(tmp_path, old, new)
    result = companion(command, path)
    assert result.code == 2
    told = only_line(result)
    assert told.startswith(f"error: {path}:{line}: {key}: got ")
    assert f"; expected {expected}" in told
    assert value in told


@pytest.mark.parametrize("command", COMMANDS)
def test_a_missing_file(companion, tmp_path, command):
    path = tmp_path / "nowhere.yaml"
    result = companion(command, path)
    assert result.code == 2
    assert only_line(result).startswith(f"error: {path}: file: got no such file or directory; expected")


def test_the_entry_exits_alike_in_a_process_of_its_own(tmp_path):
    path, line = changed(tmp_path, "unit_m: 25", "unit_km: 25")
    result = in_a_process("check", path)
    assert result.code == 2
    assert result.out == ""
    assert result.err.startswith(
        f"error: {path}:{line}: unit_km: got a key that is not known; expected unit_m"
    )
    assert result.err.count("\n") == 1


@pytest.mark.parametrize(
    "arguments", [["fly"], ["check"], ["plan", FIRST_FLIGHT, "--runs", "0"], ["run", FIRST_FLIGHT]]
)
def test_bad_usage(companion, arguments):
    result = companion(*arguments)
    assert result.code == 2
    assert result.out == ""
    assert "Error" in result.err


def test_an_unknown_method(companion):
    result = companion("plan", FIRST_FLIGHT, "--method", "teleport")
    assert result.code == 2
    told = only_line(result)
    assert "method: got teleport; expected one of" in told
    assert "safe-rrt" in told


@pytest.mark.parametrize(
    "url", ["", "foo", "udpin://", "tcp://host", "serial:///dev/ttyAMA0", "udpout://127.0.0.1:99999"]
)
def test_a_link_that_is_none(companion, tmp_path, url):
    result = companion("run", FIRST_FLIGHT, "--link", url, "--record", tmp_path)
    assert result.code == 2
    assert "--link" in only_line(result)
    assert list(tmp_path.iterdir()) == []


def test_an_autopilot_that_is_none(companion):
    result = companion("sitl", FIRST_FLIGHT, "--autopilot", "betaflight", "--headless")
    assert result.code == 2
    assert "px4" in result.err


@pytest.mark.parametrize("option", ["--json", "--plot"])
@pytest.mark.parametrize("place", ["a file/out.png", "a folder.png"])
def test_a_target_that_cannot_be_written(companion, tmp_path, option, place):
    (tmp_path / "a file").write_text("")
    (tmp_path / "a folder.png").mkdir()
    target = tmp_path / place
    result = companion("check", FIRST_FLIGHT, option, target)
    assert result.code == 2
    assert len(result.err.splitlines()) == 1
    assert result.err.startswith(f"error: {target}: {option}: got ")
    assert "expected a file to write" in result.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a file", "a folder.png"]


def test_link_failures_exit_with_three(companion, monkeypatch):
    async def refused(*_, **__):
        raise LinkError("udpin://0.0.0.0:14540: address in use")

    monkeypatch.setattr("companion.service.process.service.serve", refused)
    result = companion("run", FIRST_FLIGHT, "--link", "udpin://0.0.0.0:14540")
    assert result.code == 3
    assert only_line(result) == "error: udpin://0.0.0.0:14540: address in use"


def test_faults_of_our_own_exit_with_four_and_leave_a_trace(companion, monkeypatch, caplog):
    def broken(_):
        raise ZeroDivisionError("by nobody's wish")

    monkeypatch.setattr("companion.config.load_mission", broken)
    with caplog.at_level(logging.ERROR):
        result = companion("check", FIRST_FLIGHT)
    assert result.code == 4
    assert "internal error" in caplog.text
    assert "ZeroDivisionError: by nobody's wish" in caplog.text


def test_without_a_simulator_sitl_says_what_to_install(companion, monkeypatch):
    before = list(cli.app.registered_commands)
    monkeypatch.setattr(cli, "entry_points", lambda **_: [])
    try:
        result = companion("sitl", FIRST_FLIGHT, "--headless")
    finally:
        cli.app.registered_commands[:] = before
    assert result.code == 2
    assert "pip install 'safe-rrt-companion[sim]'" in only_line(result)


@pytest.mark.parametrize(
    ("package", "extra", "command", "options"),
    [
        ("matplotlib", "plot", "check", ["--plot", "mission.png"]),
        ("matplotlib", "plot", "plan", ["--plot", "plan.png"]),
        ("matplotlib", "plot", "report", []),
        ("matplotlib", "plot", "sitl", []),
        ("jsbsim", "sim", "sitl", ["--headless"]),
    ],
)
@pytest.mark.thorough
def test_a_package_that_is_not_installed(tmp_path, monkeypatch, package, extra, command, options):
    monkeypatch.chdir(tmp_path)
    given = tmp_path if command == "report" else FIRST_FLIGHT
    result = in_a_process(command, given, *options, without=package)
    assert result.code == 2
    told = f"error: companion: {command}: got no {package} installed; "
    assert only_line(result) == f"{told}expected pip install 'safe-rrt-companion[{extra}]'"
    assert list(tmp_path.iterdir()) == []


def test_any_other_module_that_is_missing_is_a_fault_of_our_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = in_a_process(
        "check", FIRST_FLIGHT, "--plot", "mission.png", without="companion.ui.reports.plots"
    )
    assert result.code == 4
    assert "internal error" in result.err


@pytest.mark.parametrize("command", ["plan", "sitl"])
def test_goals_left_to_an_autopilot_that_is_not_there(companion, tmp_path, command):
    text = Path(FIRST_FLIGHT).read_text(encoding="utf-8")
    file = tmp_path / "operator.yaml"
    file.write_text(re.sub(r"goals:\n(  - .*\n)+", "goals: from_autopilot\n", text), encoding="utf-8")
    result = companion(command, file)
    assert result.code == 2
    assert "goals" in only_line(result)
    assert companion("check", file).code == 0
