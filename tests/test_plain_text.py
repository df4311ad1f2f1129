"""Words from elsewhere lose what no reader is to see: escape characters, line ends, marks of direction."""

import json
import logging
import sys

import numpy as np
import pytest
from rich.console import Console

from companion.config import mission_from_text
from companion.config.compose import world_of
from companion.plain_text import in_page, printable
from companion.recording.reader import Recording
from companion.service.doctor.doctor_command import findings_table
from companion.service.doctor.finding import warn
from companion.service.process.log_format import JsonFormatter, PlainFormatter
from companion.service.replay.comparison import first_difference
from companion.service.replay.engine import Replayed
from companion.service.replay.replay_command import show
from companion.types.record import Decision, FlightRecord
from companion.ui.reports.report import write_report
from tests.cli.calls import FIRST_FLIGHT, changed, in_a_process

HOSTILE = "a\x1b[2Jb\r\nfake\u202edrow\u2028line\x9b31m\ud800$\\frac{$[/]</b>"
BAD = set(map(chr, [*range(32), *range(127, 160), 0x202E, 0x2028, 0xD800])) - {"\n"}


def is_harmless(text):
    return not BAD & set(text)


def test_what_is_harmless_stays():
    for text in ("", "plan 3: cost 0.5", "Zürich – 5 µs, 高度", "no\u00a0break"):
        assert printable(text) == text
    assert printable(5) == "5"


def test_what_is_not_goes():
    assert printable("a\tb\nc") == "a b c"
    assert printable("\x1b[2J\x07\x9b\u202e\u200b\ud800\x7f") == "?[2J??????"
    assert is_harmless(printable(HOSTILE))
    assert "\n" not in printable(HOSTILE)
    assert in_page("<\x1b>") == "&lt;?&gt;"


def record_of(message, **extra):
    record = logging.LogRecord("companion.x", logging.WARNING, "x.py", 1, "%s", (message,), None)
    vars(record).update(extra)
    return record


@pytest.mark.parametrize("formatter", [PlainFormatter(), JsonFormatter()], ids=["text", "json"])
def test_a_message_is_one_line_of_the_log(formatter):
    line = formatter.format(record_of(HOSTILE))
    assert "\n" not in line
    assert is_harmless(line)
    if isinstance(formatter, JsonFormatter):
        assert is_harmless(json.loads(line)["message"])


def test_a_trace_keeps_its_lines_and_loses_the_rest():
    try:
        raise ValueError(HOSTILE)
    except ValueError:
        text = PlainFormatter().format(record_of("it went", exc_info=sys.exc_info()))
    assert text.startswith("it went\nTraceback")
    assert len(text.splitlines()) >= 4
    assert is_harmless(text)


def decided():
    return [Decision(1.0, HOSTILE, HOSTILE, why={"occasion": HOSTILE, "notes": [HOSTILE], HOSTILE: HOSTILE}),
            Decision(2.0, "suspended", HOSTILE), Decision(3.0, "mission", HOSTILE)]  # fmt: skip


def test_pages_and_pictures(tmp_path):
    mission = mission_from_text(FIRST_FLIGHT.read_text(), "m.yaml")
    flown = np.array([[0.0, 150, 750, 100, 0, 0, 25], [5.0, 250, 750, 100, 0, 0, 25]])
    record = FlightRecord(
        flown,
        (),
        (),
        (),
        tuple(decided()),
        np.empty((0, 2)),
        (),
        {"mission": HOSTILE, HOSTILE: 1},
        note=HOSTILE,
    )
    page, _ = write_report(tmp_path, mission, world_of(mission, none_known=False), record)
    text = page.read_text(encoding="utf-8")
    assert is_harmless(text)
    assert "</b>" not in text
    assert text.count("?[2Jb") >= 8


def shown(thing):
    console = Console(width=200, file=open("/dev/null", "w", encoding="utf-8"), record=True)  # noqa: SIM115
    with console.file:
        thing(console)
        return console.export_text()


def test_tables_on_the_terminal():
    result = Replayed(decisions=decided(), flown_decisions=())
    recording = Recording(HOSTILE, (), 1, 0.0, about={"clock": "wall"})
    text = shown(lambda screen: show(recording, result, first_difference(recording, result), screen))
    assert is_harmless(text)
    assert "$[/]</b>" in text
    assert is_harmless(shown(lambda screen: screen.print(findings_table([warn(HOSTILE, HOSTILE, HOSTILE)]))))


def test_a_mission_file_does_not_write_on_the_terminal(tmp_path):
    path, _ = changed(tmp_path, "unit_m: 25", 'unit_m: "\\e[2J"')
    done = in_a_process("check", path)
    assert done.code == 2
    assert is_harmless(done.err)
    text = path.read_text().replace('unit_m: "\\e[2J"', "unit_m: 25")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("description:"))
    path.write_text(text + '\ndescription: "\\e[2J[/] [bold]"\n')
    done = in_a_process("check", path)
    assert (done.code, done.err) == (0, "")
    assert is_harmless(done.out)
    assert "[/] [bold]" in done.out


def test_a_file_name_does_not_write_on_the_terminal(tmp_path):
    done = in_a_process("check", tmp_path / "no\x1b[2J\nfile.yaml")
    assert done.code == 2
    assert is_harmless(done.err)
    assert done.err.count("\n") == 1
