"""A simulator that says nothing."""

import asyncio

import pytest

from companion.errors import NoAutopilotError
from sim.sitl import Flight
from tests.flights.flown import mission_named


def test_a_silent_autopilot_ends_the_flight_after_ten_seconds(monkeypatch):
    flight = Flight(mission_named("first-flight"), 1)
    monkeypatch.setattr(flight.simulator, "take_outgoing", lambda: b"")
    with pytest.raises(NoAutopilotError, match="within 10 s") as failure:
        asyncio.run(flight.fly())
    assert failure.value.exit_code == 3
    assert 10.0 < flight.now_s < 10.1
