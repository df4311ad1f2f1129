"""A recorded flight through the same code: the same to the byte, or the first difference in words."""

import asyncio
import json
import re
import shutil

import pytest

from companion.config import load_mission, mission_from_text
from companion.link.messages.codec import _EXTRAS
from companion.link.wire.framing import raw_frame, renumbered
from companion.link.wire.tlog import read_tlog
from companion.recording import recorder as record
from companion.service.replay import replay_command as replaying
from companion.service.replay.comparison import first_difference
from companion.types.events import Dialect
from sim.sitl import Flight
from tests.cli.calls import in_a_process
from tests.sim.client import CONFIGS
from tests.support.recorded import recorded, replayed

pytestmark = pytest.mark.xdist_group("recorded flights")  # they share flights that are made once a process

FIRST = CONFIGS / "first-flight.yaml"


def with_planning(**changes):
    mission = load_mission(FIRST)
    return mission.model_copy(update={"planning": mission.planning.model_copy(update=changes)})


@pytest.mark.parametrize(("seed", "dialect"), [(1, Dialect.ARDUPILOT), (3, Dialect.PX4)])
def test_decisions_and_missions_are_those_flown(seed, dialect):
    folder, flight = recorded("first-flight", seed, dialect)
    recording, result = replayed(folder / "flight.tlog", load_mission(folder / "mission.yaml"))
    assert first_difference(recording, result) is None
    assert result.diverged_s is None
    told = [(entry.stamp_s, entry.kind, entry.text) for entry in flight.recorder.decisions]
    assert [(entry.stamp_s, entry.kind, entry.text) for entry in result.decisions] == told
    assert len(result.uploads) >= 2
    assert [entry.items for entry in result.uploads] == [entry.items for entry in result.flown_uploads]
    held = flight.simulator.autopilot.mission_items
    places = [(item.command, item.latitude_e7, item.longitude_e7) for item in held]
    assert [(item.command, item.latitude_e7, item.longitude_e7) for item in result.held] == places


def test_a_mission_file_that_was_read_again_in_flight_is_read_again(tmp_path):
    """At 20 s the threshold for a better path is taken away: from then on every plan is swapped in."""
    text, done = FIRST.read_text(encoding="utf-8"), []
    changed = text.replace("planning:\n", "planning:\n  swap_gain: 0.0\n").replace("  # swap_gain: 0.05", "")
    assert changed != text

    def reload(flight):
        if flight.now_s >= 20.0 and not done:
            done.append(flight.now_s)
            flight.app.reload(mission_from_text(changed, "changed.yaml"), changed)

    flight = Flight(load_mission(FIRST), 3, tmp_path, Dialect.PX4, mission_text=text)
    asyncio.run(flight.fly(reload))
    kinds = [entry.kind for entry in flight.recorder.decisions]
    assert "reload" in kinds
    assert "better" in " ".join(entry.text for entry in flight.recorder.decisions if entry.stamp_s > 20.0)
    recording, result = replayed(tmp_path / "flight.tlog", load_mission(FIRST))
    assert first_difference(recording, result) is None
    assert [entry.kind for entry in result.decisions] == kinds


def test_another_seed_is_told_by_its_first_decision():
    folder, _ = recorded("first-flight", 1)
    recording, result = replayed(folder / "flight.tlog", load_mission(FIRST), seed=2)
    differs = first_difference(recording, result)
    assert differs.flown.startswith("'swap: first plan, cost ")
    assert differs.now.startswith("'swap: first plan, cost ")
    assert differs.stamp_s < 5.0


def first_kept_s(flight):
    return next(entry.stamp_s for entry in flight.recorder.decisions if entry.kind == "keep")


def test_a_changed_threshold_names_the_first_decision_and_goes_on():
    folder, flight = recorded("first-flight", 3, Dialect.PX4)
    recording, result = replayed(folder / "flight.tlog", with_planning(swap_gain=0.0))
    differs = first_difference(recording, result)
    assert differs.flown.startswith("'keep: cost ")
    assert differs.now.startswith("'swap: better, cost ")
    assert 15.0 < differs.stamp_s == pytest.approx(first_kept_s(flight), abs=0.05)
    assert result.diverged_s >= differs.stamp_s
    later = [entry for entry in result.decisions if entry.stamp_s > result.diverged_s]
    assert [entry.kind for entry in later].count("swap") >= 2  # the model answers where nobody did
    assert not [entry for entry in later if entry.kind == "rejected"]
    assert later[-1].kind == "arrived"


def test_what_was_swapped_and_is_kept_now_is_noticed_too():
    """The recorded autopilot answers an upload that is not made."""
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    _, result = replayed(folder / "flight.tlog", with_planning(time_horizon_s=40.0))
    assert result.diverged_s is not None
    assert len(result.uploads) < len(result.flown_uploads)
    assert result.decisions[-1].kind == "arrived"


def test_from_a_tlog_alone_decisions_are_as_the_pilot_was_told(tmp_path):
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    shutil.copy(folder / "flight.tlog", tmp_path / "alone.tlog")
    recording, result = replayed(tmp_path / "alone.tlog", load_mission(FIRST), seed=3)
    assert recording.are_texts_cut
    told = [entry for entry in result.decisions if entry.told]
    flown, now = ([entry.kind for entry in made] for made in (result.flown_decisions, told))
    # When each plan was begun is not told by a tlog, so that from the first mission on paths may part.
    first = flown.index("swap") + 1
    assert flown[:first] == now[:first]
    assert flown[-1] == now[-1] == "arrived"


def test_a_signed_recording_is_replayed_without_its_key(tmp_path):
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    signed = b""
    for entry in read_tlog(folder / "flight.tlog"):
        raw = bytearray(entry.raw)
        if raw[0] == 0xFD:
            raw[2] |= 1  # the checksum no longer fits, so it is made again as a signer would
            signed += round(entry.time_s * 1e6).to_bytes(8, "big") + _resealed(bytes(raw)) + bytes(13)
    (tmp_path / "flight.tlog").write_bytes(signed)
    shutil.copy(folder / "flight.mcap", tmp_path / "flight.mcap")
    recording, result = replayed(tmp_path / "flight.tlog", load_mission(FIRST))
    assert first_difference(recording, result) is None


def _resealed(raw):
    frame = raw_frame(raw)
    extra = _EXTRAS.get(frame.message_id)
    return raw if extra is None else renumbered(raw, raw[4], extra)


def test_the_command_says_what_it_found(tmp_path, companion_command):
    folder, flight = recorded("first-flight", 3, Dialect.PX4)
    same = companion_command(
        "replay", folder / "flight.tlog", folder / "mission.yaml", "--expect", folder,
        "--json", tmp_path / "out.json",
    )  # fmt: skip
    assert same.code == 0, same.err
    missions = sum(entry.kind == "swap" for entry in flight.recorder.decisions)
    assert f"as flown: {len(flight.recorder.decisions)} decisions, {missions} missions" in same.out
    document = json.loads((tmp_path / "out.json").read_text())
    assert document["equal"] is True
    assert document["first_difference"] is None
    assert len(document["missions"]) == missions >= 2
    text = (folder / "mission.yaml").read_text().replace("# swap_gain: 0.05", "swap_gain: 0.0")
    (tmp_path / "changed.yaml").write_text(text)
    other = companion_command("replay", folder / "flight.tlog", tmp_path / "changed.yaml", "--expect", folder)
    assert other.code == 1
    words = " ".join(other.out.split())
    at_s = first_kept_s(flight)
    assert f"first difference at {at_s:.1f} s (00:00:{int(at_s):02d}Z): flown 'keep: cost " in words
    assert ", now 'swap: better, cost " in words


@pytest.mark.slow  # another process and an empty cache compile the kernels again
def test_nothing_hangs_on_the_process_its_folder_or_its_cache(tmp_path, monkeypatch):
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONHASHSEED", "4711")
    log, mission = folder / "flight.tlog", folder / "mission.yaml"
    done = in_a_process("replay", log, mission, "--expect", folder, timeout_s=1_800)
    assert done.code == 0, done.out + done.err


@pytest.mark.parametrize(("arguments", "named"), [(["nowhere.tlog", FIRST], "nowhere.tlog")])
def test_what_is_not_there_is_named(companion_command, arguments, named):
    done = companion_command("replay", *arguments)
    assert done.code == 2
    assert named in done.err


def test_a_folder_without_a_recording_is_named(tmp_path, companion_command):
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    done = companion_command("replay", folder / "flight.tlog", folder / "mission.yaml", "--expect", tmp_path)
    assert done.code == 2
    assert str(tmp_path.name) in done.err


@pytest.mark.parametrize(
    "damage", [lambda mcap: b"", lambda mcap: bytes(range(256)) * 40, lambda mcap: mcap[:100]],
    ids=["empty", "random", "cut"],
)  # fmt: skip
@pytest.mark.thorough
def test_an_mcap_that_tells_nothing_makes_no_flight_equal(damage, tmp_path, companion_command):
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    shutil.copytree(folder, tmp_path / "flight")
    mcap = tmp_path / "flight" / "flight.mcap"
    mcap.write_bytes(damage(mcap.read_bytes()))
    text = (folder / "mission.yaml").read_text().replace("# swap_gain: 0.05", "swap_gain: 0.0")
    (tmp_path / "changed.yaml").write_text(text)
    log, changed = tmp_path / "flight" / "flight.tlog", tmp_path / "changed.yaml"
    done = companion_command("replay", log, changed, "--expect", tmp_path / "flight")
    assert done.code == 1, done.out
    assert "No flight.mcap beside flight.tlog can be read" in done.out


def test_an_mcap_that_ends_early_says_how_far_it_was_compared(tmp_path, companion_command):
    folder, flight = recorded("first-flight", 3, Dialect.PX4)
    shutil.copytree(folder, tmp_path / "flight")
    mcap = tmp_path / "flight" / "flight.mcap"
    data = mcap.read_bytes()
    mcap.write_bytes(data[: len(data) // 2])
    log, mission = tmp_path / "flight" / "flight.tlog", folder / "mission.yaml"
    done = companion_command("replay", log, mission, "--expect", tmp_path / "flight")
    assert done.code == 0, done.out
    ends_s = float(re.search(r"compared up to ([\d.]+) s", done.out)[1])
    assert 5.0 < ends_s < 60.0
    num_decisions = sum(entry.stamp_s <= ends_s for entry in flight.recorder.decisions)
    assert num_decisions < len(flight.recorder.decisions)
    assert f"as flown: {num_decisions} decisions" in done.out


@pytest.mark.parametrize("data", [b"", bytes(range(256)) * 20], ids=["empty", "random"])
def test_what_is_no_recording_is_named(data, tmp_path, companion_command):
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    (tmp_path / "flight.tlog").write_bytes(data)
    for arguments in (
        [tmp_path / "flight.tlog", FIRST],
        [folder / "flight.tlog", FIRST, "--expect", tmp_path],
    ):
        done = companion_command("replay", *arguments)
        assert done.code == 2, done.out
        assert "flight.tlog: no frame of MAVLink in it" in done.err


@pytest.mark.thorough
def test_what_is_another_than_flown_is_said_before_the_difference(tmp_path, companion_command, monkeypatch):
    folder, _ = recorded("first-flight", 3, Dialect.PX4)
    same = companion_command("replay", folder / "flight.tlog", folder / "mission.yaml")
    assert "is not the one flown" not in same.out
    assert "Flown with" not in same.out
    now = record.versions_now()
    monkeypatch.setattr(replaying, "versions_now", lambda: now | {"numpy": "9.9"})
    text = (folder / "mission.yaml").read_text().replace("# swap_gain: 0.05", "swap_gain: 0.0")
    (tmp_path / "changed.yaml").write_text(text)
    done = companion_command("replay", folder / "flight.tlog", tmp_path / "changed.yaml")
    assert "The mission file is not the one flown, of first-flight." in done.out
    assert f"Flown with numpy {now['numpy']} (now 9.9)." in done.out
