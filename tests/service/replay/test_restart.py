"""A service that is killed in flight and started anew: its second recording replays by itself."""

import pytest

from companion.config import mission_from_text
from companion.flight.state.checkpoint import Checkpoint
from companion.recording.recorder import About, Recorder
from companion.service.replay.comparison import first_difference
from companion.types.events import Dialect
from sim.sitl import EPOCH_S, STEP_S
from tests.support.recorded import replayed
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness

KILLED_S = 30.0
TWO_GOALS = FIRST_FLIGHT.replace(
    "goals:\n", "goals:\n  - {east_m: 500, north_m: 750, up_m: 100, acceptance_radius_m: 60}\n"
)


class RestartedService(SitlHarness):
    """A harness whose services are like processes: each with a recording and files of its own."""

    def __init__(self, folder, dialect):
        super().__init__(mission_from_text(TWO_GOALS, "two-goals.yaml"), dialect=dialect)
        self._folder = folder

    def _started(self, ours, clock):
        self.recorder.close()
        about = About(self.flight.mission, self.flight.seed, TWO_GOALS, STEP_S)
        self.flight.recorder = self.recorder = Recorder(self.log(len(self.apps)), EPOCH_S, about)
        self.checkpoint = Checkpoint(self._folder / "flight")
        return super()._started(ours, clock)

    def log(self, number):
        return self._folder / str(number)


@pytest.mark.parametrize("dialect", Dialect)
@pytest.mark.thorough
def test_a_restart_in_flight_is_replayed_from_its_own_recording(dialect, tmp_path):
    def kill(harness):
        harness.is_killed = harness.is_killed or (len(harness.apps) == 1 and harness.now_s >= KILLED_S)

    harness = RestartedService(tmp_path, dialect).fly(70.0, kill)
    assert len(harness.apps) == 2
    assert "1 goals reached" in harness.texts("restart")[0]
    assert ".flown.npz" in harness.checkpoint.contents
    for number in range(2):
        recording, result = replayed(harness.log(number) / "flight.tlog", harness.flight.mission)
        assert first_difference(recording, result) is None
        assert result.decisions
    assert [entry.text for entry in result.decisions] == [entry.text for entry in harness.recorder.decisions]


def test_without_what_was_remembered_the_replay_would_part(tmp_path, monkeypatch):
    """So the test above can fail."""

    def kill(harness):
        harness.is_killed = harness.is_killed or (len(harness.apps) == 1 and harness.now_s >= KILLED_S)

    harness = RestartedService(tmp_path, Dialect.ARDUPILOT).fly(70.0, kill)
    monkeypatch.setattr("companion.service.replay.replayed_app.checkpoint_of", lambda about: Checkpoint())
    recording, result = replayed(harness.log(1) / "flight.tlog", harness.flight.mission)
    assert first_difference(recording, result) is not None
