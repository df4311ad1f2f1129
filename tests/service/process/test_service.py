"""``companion run`` without an autopilot: it says so within ten seconds, and keeps trying."""

import asyncio
import logging
from pathlib import Path
from types import SimpleNamespace

import pytest

from companion.clock import ManualClock
from companion.link.wire.memory_transport import MemoryTransport
from companion.service.process.recorded_flight import REPORT_SILENCE_S, RecordedFlight

URL = "udpin://127.0.0.1:14540"


class Listener:
    """What the report asks of the service."""

    def __init__(self):
        self.receives_autopilot = False
        self.link = SimpleNamespace(transport=MemoryTransport())


def reported(caplog, moves):
    """Advance the clock by each of the moves, a pair of seconds and what is heard from then on."""
    app, clock, counts = Listener(), ManualClock(100.0), []

    async def run():
        task = asyncio.create_task(RecordedFlight(app, None, Path(), clock).report_silence(URL))
        for seconds, hears in moves:
            await asyncio.sleep(0)
            app.receives_autopilot = hears
            clock.advance_to(clock.now_s() + seconds)
            for _ in range(3):
                await asyncio.sleep(0)
            counts.append(len(caplog.messages))
        assert not task.done()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    with caplog.at_level(logging.WARNING, logger="companion"):
        asyncio.run(run())
    return counts


def test_silence_is_told_within_ten_seconds_with_the_link(caplog):
    assert REPORT_SILENCE_S <= 10.0
    assert reported(caplog, [(REPORT_SILENCE_S, False)]) == [1]
    assert "no autopilot heard" in caplog.text
    assert URL in caplog.text
    assert "still trying" in caplog.text
    assert "(" not in caplog.text.partition("still trying")[2]


def test_why_the_line_is_not_up_is_told_with_it(caplog, monkeypatch):
    monkeypatch.setattr(MemoryTransport, "trouble", "Connection refused", raising=False)
    monkeypatch.setattr(MemoryTransport, "__init__", lambda self: None)
    reported(caplog, [(REPORT_SILENCE_S, False)])
    assert "still trying (Connection refused)" in caplog.text


def test_it_is_told_again_and_again(caplog):
    assert reported(caplog, [(REPORT_SILENCE_S, False)] * 4) == [1, 2, 3, 4]


def test_nothing_is_told_while_the_autopilot_is_heard(caplog):
    moves = [(REPORT_SILENCE_S, hears) for hears in (True, True, False, True)]
    assert reported(caplog, moves) == [0, 0, 1, 1]
