"""Every stored input of every fuzz target, and that the targets see what they are for."""

from collections import Counter

import pytest

from companion.errors import ConfigError
from companion.link.messages import codec as codecs
from companion.link.missions.mission_sniffer import MissionSniffer
from companion.link.missions.mission_transfer import MissionDownload, Upload
from companion.link.wire import signing
from companion.link.wire.framing import raw_frame
from tests.fuzz import file_targets, link_targets, mission_targets, seeds
from tests.fuzz.scripts import IDS, SIGNED, V2, Reader, pieces_of, record_of
from tests.fuzz.targets import BrokenPromiseError, all_targets, corpus_of
from tests.link.pymavlink_frames import heartbeat, position

TARGETS = all_targets()
SMALL = 4096
FEW = 100


@pytest.mark.parametrize("name", TARGETS)
def test_every_stored_input_keeps_the_promises(name):
    """As the fuzzer would try it; what each escape was is told by its input's name."""
    escaped = {}
    for path in corpus_of(name):
        try:
            TARGETS[name].check(path.read_bytes())
        except Exception as error:  # whatever it is, all inputs are tried
            escaped[path.name] = f"{type(error).__name__}: {error}"
    assert escaped == {}


@pytest.mark.parametrize("name", TARGETS)
def test_the_corpus_is_small_and_there(name):
    paths = corpus_of(name)
    assert 5 <= len(paths) <= FEW
    assert max(path.stat().st_size for path in paths) <= SMALL


def test_the_seeds_are_those_that_the_recordings_make(tmp_path):
    seeds.write(tmp_path)
    for name in TARGETS:
        made = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        stored = {path.name: path.read_bytes() for path in corpus_of(name) if path.name.startswith("seed-")}
        assert stored == made


def test_a_script_makes_the_recorded_frame_again():
    for raw in (heartbeat(), position()):
        (made,) = pieces_of(Reader(record_of(raw)), IDS)
        assert made.is_sound
        found, _ = link_targets.framed([made.raw])
        assert [(frame.message_id, frame.payload) for frame in found] == [
            (frame.message_id, frame.payload) for frame in link_targets.framed([raw])[0]
        ]


def wire_script(*records):
    return bytes((0, 16, 63)) + b"".join(records)


SOUND = record_of(heartbeat(), IDS, V2)


def framing_by(monkeypatch, found):
    """A framer that finds what a function of the chunks says."""
    monkeypatch.setattr(link_targets, "framed", lambda chunks: (found(list(chunks)), Counter()))


def test_a_framer_without_its_checksum_is_noticed(monkeypatch):
    damaged = bytes((3,)) + SOUND[1:] + bytes((18, 0, 1))
    (piece,) = pieces_of(Reader(damaged))
    framing_by(monkeypatch, lambda chunks: [raw_frame(piece.raw)])
    with pytest.raises(BrokenPromiseError, match="does not fit its checksum"):
        link_targets.check_framer(wire_script(damaged))


def test_a_framer_that_loses_a_frame_is_noticed(monkeypatch):
    framed = link_targets.framed
    framing_by(monkeypatch, lambda chunks: framed(chunks)[0][:-1])
    with pytest.raises(BrokenPromiseError, match="a sound frame was lost"):
        link_targets.check_framer(wire_script(SOUND, SOUND))


def test_a_framer_that_forgets_between_portions_is_noticed(monkeypatch):
    framed = link_targets.framed
    framing_by(monkeypatch, lambda chunks: [frame for chunk in chunks for frame in framed([chunk])[0]])
    with pytest.raises(BrokenPromiseError, match="other believed frames"):
        link_targets.check_framer(wire_script(SOUND, SOUND, SOUND))


def test_a_signer_that_takes_anything_is_noticed(monkeypatch):
    monkeypatch.setattr(signing.Signer, "accepts", lambda self, frame: True)
    with pytest.raises(BrokenPromiseError, match="nobody with the key"):
        link_targets.check_signer(bytes((4, 0, 0, 0, 1, 0, 2, 5, 5)) + bytes(6))
    with pytest.raises(BrokenPromiseError, match="twice"):
        link_targets.check_signer(bytes((0, 0, 0, 0, 1, 0, 2, 5, 5, 1)) + bytes((2, 0)) * 2)


def test_a_codec_that_takes_no_note_of_what_is_finite_is_noticed(monkeypatch):
    told = codecs.Request("command", 1, 1, 0, (float("nan"),))
    monkeypatch.setitem(codecs._REQUESTS, "HEARTBEAT", lambda message: told)
    with pytest.raises(BrokenPromiseError, match="no finite number"):
        link_targets.check_codec(bytes((1,)) + record_of(heartbeat(), link_targets.LISTENED))


def test_an_upload_that_succeeds_too_soon_is_noticed(monkeypatch):
    monkeypatch.setattr(Upload, "note_ack", lambda self, ack, now_s: setattr(self, "failure", ""))
    with pytest.raises(BrokenPromiseError, match="not every item was sent"):
        mission_targets.check_transfer(bytes((0, 0, 3, 1, 2, 0, 0)))


def test_a_reading_that_never_ends_is_noticed(monkeypatch):
    monkeypatch.setattr(MissionDownload, "due", lambda self, now_s: [])
    with pytest.raises(BrokenPromiseError, match="for ever"):
        mission_targets.check_transfer(bytes((128, 1, 3, 1)))


def test_a_sniffer_that_invents_uploads_is_noticed(monkeypatch):
    def invents(self, frame, vehicle, stamp_s):
        self.uploads += [None, None]

    monkeypatch.setattr(MissionSniffer, "feed", invents)
    with pytest.raises(BrokenPromiseError, match="pairs"):
        mission_targets.check_sniffer(bytes((1,)) + record_of(heartbeat(), mission_targets.EXCHANGED))


def test_a_mission_that_is_another_when_read_again_is_noticed(monkeypatch):
    monkeypatch.setattr(
        mission_targets, "text_of", lambda config: mission_targets.MISSION.replace("60}", "61}")
    )
    with pytest.raises(BrokenPromiseError, match="another"):
        mission_targets.check_mission_file(bytes((255,)) + mission_targets.MISSION.encode())


def test_the_mission_that_scripts_change_is_a_sound_one():
    mission_targets.mission_from_text(mission_targets.MISSION, "small.yaml")
    with pytest.raises(ConfigError):
        mission_targets.mission_from_text("name: a\n", "small.yaml")


def test_a_reader_that_leaves_a_message_out_is_noticed(monkeypatch):
    read = file_targets.documents_in
    sound = bytes((0, 0, 1, 3, 2, 1, 3, 0))
    assert file_targets.McapScript(sound).is_sound
    file_targets.check_mcap(sound)
    monkeypatch.setattr(
        file_targets,
        "documents_in",
        lambda path, counters: {k: v[1:] for k, v in read(path, counters).items()},
    )
    with pytest.raises(BrokenPromiseError, match="as it was written"):
        file_targets.check_mcap(sound)


def test_a_log_reader_that_skips_an_entry_is_noticed(monkeypatch):
    read = file_targets.read_tlog
    monkeypatch.setattr(file_targets, "read_tlog", lambda path, counters: list(read(path, counters))[1:])
    with pytest.raises(BrokenPromiseError, match="neither read nor counted"):
        file_targets.check_tlog(bytes((1,)) + bytes(8) + record_of(heartbeat()) + record_of(position()))


def test_signed_frames_are_sound_for_the_framer():
    (piece,) = pieces_of(Reader(bytes((SIGNED,)) + SOUND[1:] + bytes(13)))
    found, counters = link_targets.framed([piece.raw])
    assert [frame.raw for frame in found] == [piece.raw]
    assert counters == Counter()
