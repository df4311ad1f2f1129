"""The autopilot's parameters are asked for until they are told, and kept up to date."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages import settings_reader
from companion.link.messages.codec import Codec
from companion.link.messages.settings_reader import AGAIN_CALLS, TRIES, SettingsReader
from companion.link.wire.decoded_frame import ParameterValue
from companion.types.events import Dialect
from companion.types.state import AutopilotSettings
from tests.flight.test_operator import BOTH
from tests.sim.client import plain_mission
from tests.support.sitl_harness import SitlHarness


class Told:
    """A frame of the autopilot's with a PARAM_VALUE."""

    def __init__(self, name, value, bits=0, is_whole=False):
        self.reply = ParameterValue(name, value, bits, is_whole)


def asked(data):
    parser = mavlink.MAVLink(None)
    return [message.param_id for message in parser.parse_buffer(data) or []]


@BOTH
def test_every_field_has_a_name_that_the_simulated_autopilot_knows(dialect):
    harness = SitlHarness(plain_mission(), dialect=dialect).fly(10.0)
    settings = harness.app.state.settings
    names, parameters = dialect.parameter_names, harness.simulator.autopilot.parameters
    for meaning, name in names.items():
        assert getattr(settings, meaning) == pytest.approx(parameters[name])
    only_arduplane = {
        "fence_enable", "fence_types", "num_rally_points", "rally_limit_km", "rally_includes_home",
        "terrain_enable", "terrain_spacing_m", "look_ahead_m",
    }  # fmt: skip
    assert set(names) | only_arduplane == set(AutopilotSettings.__dataclass_fields__)


def test_a_few_at_once_and_not_for_ever(monkeypatch):
    monkeypatch.setattr(settings_reader, "ASKED_AT_ONCE", 4)
    reader, codec = SettingsReader(), Codec(1)
    codec.feed(b"", 0.0)
    reader.begin(Dialect.ARDUPILOT)
    count = len(Dialect.ARDUPILOT.parameter_names)
    questions = [asked(reader.due(codec)) for _ in range(TRIES * count)]
    assert max(map(len, questions)) == 4
    assert len({name for question in questions[:6] for name in question}) == count  # The first ones wait.
    names = [name for question in questions for name in question]
    assert {name: names.count(name) for name in names} == dict.fromkeys(
        Dialect.ARDUPILOT.parameter_names.values(), TRIES
    )


def test_what_is_known_is_asked_for_again_now_and_then():
    reader, codec = SettingsReader(), Codec(1)
    reader.begin(Dialect.ARDUPILOT)
    for name in Dialect.ARDUPILOT.parameter_names.values():
        reader.note(Told(name, 1.0))
    questions = [asked(reader.due(codec)) for _ in range(4 * AGAIN_CALLS)]
    assert [len(question) for question in questions if question] == [1, 1, 1, 1]
    assert len({question[0] for question in questions if question}) == 4


def test_whole_numbers_of_a_px4_lie_as_in_memory_and_nonsense_is_passed_over():
    reader = SettingsReader()
    reader.begin(Dialect.PX4)
    reader.note(Told("NAV_ACC_RAD", 5.6e-45, bits=4, is_whole=True))
    reader.note(Told("FW_R_LIM", math.nan))
    reader.note(Told("SOMETHING", 3.0))
    assert reader.settings == AutopilotSettings(acceptance_radius_m=4.0)
    reader.begin(Dialect.ARDUPILOT)
    assert reader.settings == AutopilotSettings()
