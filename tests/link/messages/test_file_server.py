"""MAVLink FTP, read only: what is carried out, what is refused, and that nothing that is sent does harm."""

import struct
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.config.parameters.pilot_parameters import Parameters
from companion.flight.messages.send_budgets import SendBudgets
from companion.link.messages.codec import Codec
from companion.link.messages.file_server import BURST_MAX, DATA_MAX, SESSION_S, SESSIONS_MAX, FileServer
from tests.support.sitl_harness import FIRST_FLIGHT

LONG = bytes(range(256)) * 8  # 2048 bytes: nine portions
FILES = {"/long.bin": LONG, "/short.txt": b"abc"}
TERMINATE, RESET, LIST, OPEN, READ, WRITE, REMOVE, CRC, BURST, ACK, NAK = (
    1,
    2,
    3,
    4,
    5,
    7,
    8,
    14,
    15,
    128,
    129,
)
SIZE, SESSION, FULL, END, UNKNOWN, MISSING = 3, 4, 5, 6, 7, 10
STATION = (255, 190)


def payload(operation, data=b"", *, number=7, session=0, size=None, offset=0):
    size = len(data) if size is None else size
    head = struct.pack("<HBBBBBBI", number, session, operation, size, 0, 0, 0, offset)
    return head + data.ljust(DATA_MAX, b"\0")


class Client:
    """A station that asks one server, by a clock of its own."""

    def __init__(self, server=None, asker=STATION):
        self.counters = Counter()
        self.server = server or FileServer(lambda: FILES, self.counters)
        self.asker, self.now_s = asker, 100.0

    def ask(self, *arguments, **keys):
        return [
            Answer(told) for told in self.server.answers(payload(*arguments, **keys), self.asker, self.now_s)
        ]

    def one(self, *arguments, **keys):
        (answer,) = self.ask(*arguments, **keys)
        return answer


class Answer:
    def __init__(self, told):
        assert len(told) == 251
        fields = struct.unpack_from("<HBBBBBBI", told)
        self.number, self.session, self.operation, self.size, self.answered, self.end, _, self.offset = fields
        self.data = told[12 : 12 + self.size]
        assert not any(told[12 + self.size :])

    @property
    def error(self):
        assert (self.operation, self.size) == (NAK, 1)
        return self.data[0]


def test_a_file_is_opened_read_and_closed():
    client = Client()
    opened = client.one(OPEN, b"/long.bin\0")
    assert (opened.operation, opened.answered, opened.number) == (ACK, OPEN, 8)
    assert struct.unpack("<I", opened.data) == (2048,)
    got = b""
    while (answer := client.one(READ, size=100, offset=len(got))).operation == ACK:
        assert answer.offset == len(got)
        got += answer.data
    assert answer.error == END
    assert got == LONG
    assert client.one(TERMINATE).operation == ACK
    assert client.one(READ, size=100).error == SESSION
    assert client.counters == {"refused_file": 1}


def test_a_burst_has_numbers_in_a_row_an_end_and_a_bound():
    client = Client()
    client.ask(OPEN, b"long.bin")
    answers = client.ask(BURST, size=DATA_MAX, number=65534)
    assert [answer.number for answer in answers] == [65535, 0, 1, 2]
    assert [answer.end for answer in answers] == [0, 0, 0, 1]
    assert len(answers) == BURST_MAX
    assert b"".join(answer.data for answer in answers) == LONG[: 4 * DATA_MAX]
    (last,) = client.ask(BURST, size=DATA_MAX, offset=2000)
    assert (last.data, last.end) == (LONG[2000:], 1)
    assert client.one(BURST, size=DATA_MAX, offset=2048).error == END


def test_the_folder_is_listed():
    client = Client()
    assert client.one(LIST, b"/").data == b"Flong.bin\t2048\0Fshort.txt\t3\0"
    assert client.one(LIST, b"/", offset=1).data == b"Fshort.txt\t3\0"
    assert client.one(LIST, b"/", offset=2).error == END
    assert client.one(LIST, b"/etc").error == MISSING


def test_the_checksum_is_that_of_the_protocol():
    # of "abc" by hand: begun at 0, not inverted
    value = 0
    for byte in b"abc":
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xEDB88320 if value & 1 else 0)
    assert struct.unpack("<I", Client().one(CRC, b"/short.txt").data) == (value,)


@pytest.mark.parametrize(
    "path",
    [b"", b"/", b"/etc/passwd", b"../../etc/passwd", b"/short.txt/../long.bin", b"//short.txt", b"/SHORT.TXT",
     b"short.txt ", b"\xff\xfe", b"\0short.txt", b"/." * 100],
)  # fmt: skip
def test_no_path_leads_elsewhere(path):
    for operation in (OPEN, CRC):
        assert Client().one(operation, path).error == MISSING


@pytest.mark.parametrize("operation", [0, 6, WRITE, REMOVE, 9, 10, 11, 12, 13, 16, 127, 130, 255])
def test_nothing_else_is_carried_out(operation):
    client = Client()
    client.ask(OPEN, b"short.txt")
    assert client.one(operation, b"short.txt").error == UNKNOWN
    assert client.counters == {"refused_file": 1}


def test_answers_are_not_answered():
    client = Client()
    assert client.ask(ACK) == client.ask(NAK) == []
    assert client.server.answers(b"\x01\x02", STATION, 0.0) == []
    assert client.counters == {"refused_file": 3}


def test_sizes_that_cannot_be_are_refused():
    assert Client().one(READ, size=240).error == SIZE
    assert Client().one(OPEN, b"short.txt", size=255).error == SIZE


def test_a_question_that_is_repeated_opens_no_second_session():
    client = Client()
    first, again = client.one(OPEN, b"short.txt"), client.one(OPEN, b"short.txt")
    assert first.__dict__ == again.__dict__


def test_sessions_are_bounded_apart_and_end():
    first = Client()
    others = [Client(first.server, (system, 190)) for system in range(1, SESSIONS_MAX + 1)]
    sessions = [client.one(OPEN, b"short.txt").session for client in (first, *others[:-1])]
    assert sessions == [0, 1, 2, 3]
    late = others[-1]
    assert late.one(OPEN, b"short.txt").error == FULL
    assert late.one(READ, session=1).error == SESSION
    assert late.one(RESET).operation == ACK
    assert others[0].one(READ, session=1).data == b"abc"
    for client in (late, others[0]):
        client.now_s += SESSION_S + 0.1
    assert late.one(OPEN, b"long.bin").session == 0
    assert first.one(READ).error == SESSION
    assert others[0].one(READ, session=1).error == SESSION


def test_an_open_file_stays_what_it_was():
    files = {"/a": b"before"}
    client = Client(FileServer(lambda: files, Counter()))
    client.ask(OPEN, b"a")
    files["/a"] = b"after"
    assert client.one(READ).data == b"before"


OPERATION = st.sampled_from([*range(17), ACK, NAK, 255])
PATHS = st.sampled_from([b"/long.bin", b"short.txt", b"/", b"/etc/passwd", b"", b"\xff"])
STEP = st.tuples(
    st.integers(0, 9), OPERATION, st.one_of(PATHS, st.binary(max_size=DATA_MAX)), st.integers(0, 255),
    st.integers(0, 6), st.one_of(st.integers(0, 2100), st.integers(0, 2**32 - 1)), st.floats(-50.0, 50.0),
)  # fmt: skip


@given(steps=st.lists(STEP, max_size=30))
def test_whatever_is_asked_only_the_files_are_told(steps):
    counters, now_s = Counter(), 0.0
    server = FileServer(lambda: FILES, counters)
    for system, operation, data, size, session, offset, passed_s in steps:
        now_s += passed_s
        asked = payload(operation, data, session=session, size=size, offset=offset)
        before = counters["refused_file"]
        told = [Answer(entry) for entry in server.answers(asked, (system, 1), now_s)]
        assert len(told) <= BURST_MAX
        assert len(server._sessions) <= SESSIONS_MAX
        for answer in told:
            if answer.operation == NAK:
                assert answer.error == END or counters["refused_file"] == before + 1
            elif operation in (READ, BURST):
                assert any(file[answer.offset :].startswith(answer.data) for file in FILES.values())
                assert answer.data
            else:
                assert operation in (TERMINATE, RESET, LIST, OPEN, CRC)
        assert told or counters["refused_file"] == before + 1


@given(raw=st.binary(max_size=251))
def test_no_bytes_raise_anywhere_between_the_wire_and_the_answer(raw):
    codec = Codec(1)
    budgets = SendBudgets(codec, None)
    budgets.begin(Parameters(mission_from_text(FIRST_FLIGHT, "m"), None))
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    message = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 195, list(raw.ljust(251, b"\0")))
    for frame in codec.feed(message.pack(station), 1.0):
        for told in mavlink.MAVLink(None).parse_buffer(budgets.answer(frame, 1.0)) or []:
            assert (told.get_type(), told.target_system, told.target_component) == (
                "FILE_TRANSFER_PROTOCOL", 255, 190,
            )  # fmt: skip


@pytest.mark.parametrize(("system", "component"), [(1, 1), (2, 195), (0, 0), (1, 0)])
def test_what_is_asked_of_others_is_left_alone(system, component):
    codec = Codec(1)
    budgets = SendBudgets(codec, None)
    budgets.begin(Parameters(mission_from_text(FIRST_FLIGHT, "m"), None))
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    asked = mavlink.MAVLink_file_transfer_protocol_message(0, system, component, list(payload(LIST, b"/")))
    (frame,) = codec.feed(asked.pack(station), 1.0)
    assert budgets.answer(frame, 1.0) == b""
