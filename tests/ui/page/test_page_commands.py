"""Commands that open a page: who may look, and what of."""

import json

import pytest

from companion.recording import mcap_schema as channels
from companion.types.events import Dialect
from companion.ui.page import playback_page
from tests.sim.client import CONFIGS
from tests.support.recorded import recorded
from tests.ui.page.test_playback import asked, lines_of

pytestmark = pytest.mark.xdist_group("recorded flights")  # they share flights that are made once a process
PORT = 18_457


@pytest.fixture
def shown(monkeypatch):
    """Playbacks that a page was opened for, and what its server told of them; it is not waited for an end."""
    found = []

    class Looked(playback_page.PageServer):
        def close(self):
            sources = json.loads(asked(self, "/sources.json")[2])["sources"]
            found.extend(zip(self._pages._playbacks, sources, strict=True))
            super().close()

    monkeypatch.setattr(playback_page, "PageServer", Looked)
    monkeypatch.setattr(playback_page, "wait_for_interrupt", lambda: None)
    return found


@pytest.fixture(scope="module")
def flown():
    return recorded("first-flight", 3, Dialect.PX4)


def test_a_recording_needs_no_mission_file(companion_command, flown, shown):
    folder, flight = flown
    done = companion_command("replay", folder, "--page", PORT)
    assert (done.code, done.err) == (0, "")
    assert f"page: http://127.0.0.1:{PORT}/" in done.out
    [(playback, source)] = shown
    assert source["recording"] == "/recording/0"
    told = [message for topic, message in lines_of(playback) if topic == channels.DECISION]
    assert [entry["text"] for entry in told] == [entry.text for entry in flight.recorder.decisions]
    standing = [message for topic, message in lines_of(playback) if topic == channels.STANDING]
    assert [standing[-1]["mode"], standing[-1]["next_goal"]] == ["arrived", 1]
    assert standing[20]["num_items"] > standing[0]["num_items"], "ours are in the list by then"


def test_what_would_be_decided_now_lies_beside_it(companion_command, flown, shown):
    folder, _ = flown
    done = companion_command("replay", folder / "flight.tlog", folder / "mission.yaml", "--page", PORT)
    assert done.code == 0
    (before, _), (now, source) = shown
    assert source["name"] == "what would be decided now, by first-flight"

    def decided(playback):
        rows = [message for topic, message in lines_of(playback) if topic == channels.DECISION]
        return [(row["stamp_s"], row["kind"], row["text"]) for row in rows]

    assert decided(now) == decided(before), "of a simulated flight the same to the byte"
    assert {topic for topic, _ in lines_of(now)} == {topic for topic, _ in lines_of(before)}


def test_two_recordings(companion_command, flown, shown):
    folder, _ = flown
    done = companion_command("replay", folder, "--beside", folder / "flight.tlog", "--page", PORT)
    assert done.code == 0
    assert len(shown) == 2


def test_without_a_page_a_mission_file_is_needed(companion_command, flown):
    done = companion_command("replay", flown[0])
    assert done.code == 2
    assert "MISSION: got nothing; expected a mission file, or --page" in done.err


def test_a_folder_is_replayed_as_its_tlog(companion_command, flown):
    folder, _ = flown
    done = companion_command("replay", folder, folder / "mission.yaml", "--expect", folder)
    assert done.code == 0
    assert "as flown:" in done.out


def test_nobody_else_looks_without_a_token(companion_command, monkeypatch, tmp_path):
    monkeypatch.setenv("COMPANION_PAGE_LISTEN", "0.0.0.0")
    monkeypatch.delenv("COMPANION_PAGE_TOKEN", raising=False)
    mission = CONFIGS / "first-flight.yaml"
    done = companion_command(
        "run", mission, "--link", "tcp://127.0.0.1:9", "--page", PORT, "--record", tmp_path
    )
    assert done.code == 2
    assert "--page-listen: got 0.0.0.0; expected a token beside it" in done.err
