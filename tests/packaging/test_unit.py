"""The systemd unit: what it may not do, and that each exception says why."""

import re
import subprocess
from pathlib import Path

import pytest

from companion.service.process.service import Service
from tests.packaging.tools import needed

PACKAGING = Path(__file__).parents[2] / "packaging"
UNIT = PACKAGING / "companion.service"
TEXT = UNIT.read_text(encoding="utf-8")
SCORE_MAX = 2.0
# What systemd-analyze counts against it, and the line that a comment must stand before.
EXCEPTIONS = {
    "PrivateDevices=": "DevicePolicy=closed",
    "DeviceAllow=": "DevicePolicy=closed",
    "PrivateNetwork=": "RestrictAddressFamilies=",
    "IPAddressDeny=": "RestrictAddressFamilies=",
    "RestrictAddressFamilies=~AF_UNIX": "RestrictAddressFamilies=",
    "RestrictAddressFamilies=~AF_(INET|INET6)": "RestrictAddressFamilies=",
    "MemoryDenyWriteExecute=": "MemoryDenyWriteExecute=no",
    "ProcSubset=": "ProcSubset=all",
    "PrivateUsers=": "PrivateUsers=no",
    "SupplementaryGroups=": "SupplementaryGroups=dialout",
    "RootDirectory=/RootImage=": "StateDirectory=companion",
}


def settings(key):
    return re.findall(rf"^{key}=(.*)$", TEXT, flags=re.MULTILINE)


@pytest.fixture(scope="module")
def analysis():
    program = needed("systemd-analyze")
    done = subprocess.run(
        [program, "security", "--offline=true", "--no-pager", UNIT],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout


def test_the_exposure_is_low(analysis):
    score = re.search(r"Overall exposure level for \S+: (\d+\.\d+)", analysis)
    assert score, analysis
    assert float(score[1]) <= SCORE_MAX


def test_every_exception_is_explained_in_the_unit(analysis):
    counted = set(re.findall(r"^✗ (\S+)", analysis, flags=re.MULTILINE))
    assert counted <= EXCEPTIONS.keys(), counted - EXCEPTIONS.keys()
    lines = TEXT.splitlines()
    for exception in counted:
        (number,) = [n for n, line in enumerate(lines) if line.startswith(EXCEPTIONS[exception])]
        assert lines[number - 1].startswith("#"), f"{exception}: nothing explains line {number + 1}"


def test_systemd_understands_it(tmp_path):
    program = needed("systemd-analyze")
    unit = tmp_path / "companion.service"
    # Program and user are not installed here; everything else is as it is.
    text = TEXT.replace("/opt/companion/bin/companion", "/bin/true").replace("User=companion", "User=root")
    unit.write_text(text.replace("Group=companion", "Group=root"), encoding="utf-8")
    done = subprocess.run([program, "verify", "--man=no", unit], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.returncode == 0


def test_it_is_watched_restarted_within_limits_and_not_for_a_wrong_mission_file():
    assert settings("Type") == ["notify"]
    assert int(settings("WatchdogSec")[0]) <= 60
    assert settings("Restart") == ["on-failure"]
    assert settings("RestartPreventExitStatus") == ["2"]
    assert int(settings("StartLimitBurst")[0]) <= 10
    assert settings("ExecReload") == ["/bin/kill -HUP $MAINPID"]


def test_what_the_service_writes_lies_in_folders_that_systemd_makes():
    (start,) = settings("ExecStart")
    record = re.search(r"--record (\S+)", start)[1]
    assert record.startswith(f"/var/lib/{settings('StateDirectory')[0]}/")
    (cache,) = [entry for entry in settings("Environment") if entry.startswith("NUMBA_CACHE_DIR=")]
    assert cache == f"NUMBA_CACHE_DIR=/var/cache/{settings('CacheDirectory')[0]}"
    assert settings("LogsDirectory") == ["companion"]


def test_signing_times_go_to_the_state_folder(tmp_path):
    key, state = tmp_path / "etc" / "mavlink.key", tmp_path / "state"
    key.parent.mkdir()
    state.mkdir()
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    good = (Path(__file__).parents[2] / "mission_configs" / "first-flight.yaml").read_text(encoding="utf-8")
    mission = tmp_path / "mission.yaml"
    mission.write_text(good + f"link:\n  signing: {{key_file: {key}}}\n", encoding="utf-8")
    service = Service(mission, "udpin://127.0.0.1:0", state / "flights", {"STATE_DIRECTORY": str(state)})
    service.close()
    assert (state / "mavlink.key.times").exists()
    assert list(key.parent.iterdir()) == [key]
