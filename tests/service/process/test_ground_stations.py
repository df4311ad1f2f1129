"""What stations are told of component 195: pymavlink at another of the autopilot's links, and MAVSDK."""

import socket
import threading

import pytest
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.telemetry import Telemetry
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.link.messages.codec import Codec
from companion.service.process.telemetry_out import TelemetryReporter
from companion.types.plan import Measures, Plan, PlanStatus
from sim.faults import FaultyLink, LinkFaults
from tests.flight.test_app import at, both, switch
from tests.flight.test_flight_day import off, uploaded
from tests.sim.client import PLAIN, Client
from tests.support.sitl_harness import SitlHarness

BOOT, STANDBY = mavlink.MAV_STATE_BOOT, mavlink.MAV_STATE_STANDBY
ACTIVE, CRITICAL = mavlink.MAV_STATE_ACTIVE, mavlink.MAV_STATE_CRITICAL
STATION, SERVICE = (255, 190), 195
ASKED_EVERY_S = 5
CHUNK = 50
LONG = "CHECK: " + " ".join(f"word{number}" for number in range(20))


class Station:
    """A ground station at the simulator's second link, which asks for a heartbeat beside those that come.

    What it asks of the service goes to it as through a router: between components of its own system the
    simulator passes nothing on. Answers come through the simulator.
    """

    def __init__(self, harness):
        self._harness = harness
        self._client = Client.on_new_channel(harness.simulator, *STATION)
        self._client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        self._asked_s = 0.0

    def ask(self, message):
        self._harness.app.link.receive(message.pack(self._client.mav))

    def set(self, name, value):
        self.ask(mavlink.MAVLink_param_set_message(1, SERVICE, name.encode(), value, 9))

    def __call__(self, harness):
        self._client.poll()
        if harness.now_s - self._asked_s >= ASKED_EVERY_S:
            self._asked_s = harness.now_s
            self.ask(
                mavlink.MAVLink_command_long_message(
                    1, SERVICE, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 0.0, *(0.0,) * 6
                )
            )

    def heard(self, kind, begin_s=0.0, end_s=float("inf")):
        return [
            message
            for stamp, message in self._client.log
            if message.get_srcComponent() == SERVICE
            and message.get_type() == kind
            and begin_s <= stamp < end_s
        ]

    def states(self, begin_s, end_s):
        """What the heartbeats between two instants told."""
        beats = self.heard("HEARTBEAT", begin_s, end_s)
        assert len(beats) >= end_s - begin_s - 1.0, "one a second"
        return {beat.system_status for beat in beats}


def flown(until_s, steps=(), *, is_warm=True, on_ground=False, silent_s=None):
    """A flight with a station, whose position is lost from one instant to another."""
    harness = SitlHarness(mission_from_text(PLAIN, "plain.yaml"), on_ground=on_ground)
    harness.is_warm = is_warm
    if silent_s is not None:
        harness.flight.wire = link = FaultyLink(harness.simulator, LinkFaults(), seed=1)
        position = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        link.watch = lambda frame, is_ours: (
            is_ours
            or not silent_s[0] <= harness.now_s < silent_s[1]
            or int.from_bytes(frame[7:10], "little") != position
        )
    station = Station(harness)
    harness.fly(until_s, both(*(step(station) if step is setting else step for step in steps), station))
    return harness, station


def setting(station):
    """Replanning is switched off at 12 s, and on again at 18 s."""
    return both(
        at(12.0, lambda _: station.set("SRRT_ENABLE", 0.0)),
        at(18.0, lambda _: station.set("SRRT_ENABLE", 1.0)),
    )


@pytest.mark.parametrize(
    ("flight", "told"),
    [
        pytest.param({"until_s": 8.0, "is_warm": False}, [(BOOT, 2, 8)], id="kernels are compiled"),
        pytest.param({"until_s": 12.0, "on_ground": True}, [(STANDBY, 2, 12)], id="on the ground"),
        pytest.param({"until_s": 25.0}, [(ACTIVE, 5, 25)], id="flies the mission"),
        pytest.param(
            {"until_s": 40.0, "silent_s": (20.0, 30.0)},
            [(ACTIVE, 10, 20), (CRITICAL, 23, 30), (ACTIVE, 33, 40)], id="no position",
        ),
        pytest.param(
            {"until_s": 26.0, "steps": [switch(10.0, "FBWA"), switch(18.0, "AUTO")]},
            [(ACTIVE, 5, 10), (STANDBY, 12, 18), (ACTIVE, 20, 26)], id="the pilot flies",
        ),
        pytest.param(
            {"until_s": 24.0, "steps": [setting]},
            [(ACTIVE, 5, 12), (STANDBY, 14, 18), (ACTIVE, 20, 24)], id="switched off",
        ),
        pytest.param({"until_s": 110.0}, [(ACTIVE, 5, 60), (STANDBY, 100, 110)], id="arrived"),
    ],
)  # fmt: skip
def test_its_heartbeat_is_true_in_every_state(flight, told):
    _, station = flown(**flight)
    for state, begin_s, end_s in told:
        assert station.states(begin_s, end_s) == {state}, (begin_s, end_s)


def test_a_heartbeat_that_is_asked_for_tells_the_same():
    _, station = flown(14.0, [switch(8.0, "FBWA")])
    beats = station.heard("HEARTBEAT")
    assert len(beats) >= 12 + 2, "one a second, and every five seconds one more"
    assert len(station.heard("COMMAND_ACK")) == 2
    assert station.states(9.5, 14.0) == {STANDBY}


def test_its_heartbeat_is_true_on_a_day_from_the_ground_to_the_ground():
    harness, station = flown(200.0, [uploaded(5.0), off(12.0)], on_ground=True)
    said = {entry.text: entry.stamp_s for entry in harness.recorder.decisions if entry.kind != "swap"}
    over_s = next(stamp for text, stamp in said.items() if text.startswith("planning"))
    there_s = next(stamp for text, stamp in said.items() if text.startswith("at the last goal"))
    landed_s = next(stamp for text, stamp in said.items() if text == "the flight is over")
    assert station.states(2.0, over_s - 1.0) == {STANDBY}
    assert station.states(over_s + 2.0, there_s - 1.0) == {ACTIVE}
    assert station.states(there_s + 2.0, landed_s + 5.0) == {STANDBY}


# --- words and figures


@pytest.fixture(scope="module")
def words_and_figures():
    """A flight in which a long text is said, and figures are told every second."""
    reporting = []

    def report(harness):
        if not reporting:
            reporting.append(TelemetryReporter(harness.app, harness.app._clock, "/", None, 0.0))
            path = harness.app.state.flown
            made = Plan(
                PlanStatus.EXACT, None if path is None else path.path, Measures(quality=0.75), 1, "", 0
            )
            reporting[0].planned(made, 1.0)
        if round(harness.now_s * 50) % 50 == 0:
            reporting[0].tell(harness.now_s, with_computer=True)

    def say(harness):
        harness.app.link.tell(mavlink.MAV_SEVERITY_WARNING, LONG)
        harness.app.link.tell(mavlink.MAV_SEVERITY_INFO, LONG[:100])

    return flown(15.0, [at(12.0, say), lambda harness: harness.now_s > 10.0 and report(harness)])


class Assembled:
    """Texts put together from chunks as stations do.

    QGroundControl and MAVProxy collect the chunks of an id, show the text with the first that is not full,
    and take one without an id for whole.
    """

    def __init__(self):
        self.texts = []
        self._parts = {}

    def take(self, message):
        if message.id == 0:
            self.texts.append((message.severity, message.text))
            return
        parts = self._parts.setdefault(message.id, {})
        parts[message.chunk_seq] = message.text
        is_last = len(message.text) < CHUNK
        if is_last and len(parts) == message.chunk_seq + 1:
            whole = "".join(parts[number] for number in sorted(parts))
            self.texts.append((message.severity, whole))
            del self._parts[message.id]

    @property
    def is_waiting(self):
        return bool(self._parts)


def test_what_is_decided_is_told_in_words(words_and_figures):
    harness, station = words_and_figures
    assembled = Assembled()
    for message in station.heard("STATUSTEXT"):
        assembled.take(message)
    told = {text for _, text in assembled.texts}
    decided = {entry.told for entry in harness.recorder.decisions if entry.stamp_s > 2.0 and entry.told}
    assert decided
    assert decided <= told
    assert (mavlink.MAV_SEVERITY_WARNING, LONG) in assembled.texts
    assert (mavlink.MAV_SEVERITY_INFO, LONG[:100]) in assembled.texts, "two full chunks, and an empty one"
    assert not assembled.is_waiting


def test_figures_have_names_and_are_told_every_second(words_and_figures):
    _, station = words_and_figures
    values = station.heard("NAMED_VALUE_FLOAT", 11.0, 15.0)
    assert {value.name for value in values} == {"threat", "plan_q"}
    assert len(values) == 8
    assert {value.value for value in values if value.name == "plan_q"} == {0.75}
    assert all(0.0 <= value.value <= 1.0 for value in values)
    computers = station.heard("ONBOARD_COMPUTER_STATUS", 11.0, 15.0)
    assert len(computers) == 4
    assert computers[0].ram_total > computers[0].ram_usage > 0


def test_mavsdk_puts_long_texts_together():
    """Its own handler of chunks, over loopback: a text of three chunks, one of two full ones, a short one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    client = Mavsdk(Configuration.create_manual(*STATION, True))
    client.add_any_connection(f"udpin://127.0.0.1:{port}")
    codec, autopilot = Codec(1), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    expected, told, is_over = [LONG, LONG[:100], "Planner flies the mission"], [], threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.connect(("127.0.0.1", port))
        line.send(mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3).pack(autopilot))
        plugin = Telemetry(client.first_autopilot(10.0))

        def take(text, _):
            told.append(text.text)
            if len(told) == len(expected):
                is_over.set()

        plugin.subscribe_status_text(take)
        for words in expected:
            line.send(codec.status_text(mavlink.MAV_SEVERITY_WARNING, words))
        assert is_over.wait(10.0), told
    assert told == expected
    plugin.destroy()
    client.destroy()
