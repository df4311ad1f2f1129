"""The autopilot's parameters are asked for until they are told, and kept up to date."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages import settings_reader
from companion.link.messages.codec import Codec
from companion.link.messages.settings_reader import AGAIN_CALLS, TRIES, SettingsReader
from companion.link.wire.decoded_frame import AutopilotVersion, ParameterValue
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
    return [m.param_id for m in parser.parse_buffer(data) or [] if m.get_type() == "PARAM_REQUEST_READ"]


@BOTH
def test_every_field_has_a_name_that_the_simulated_autopilot_knows(dialect):
    harness = SitlHarness(plain_mission(), dialect=dialect).fly(10.0)
    settings = harness.app.state.settings
    names, parameters = dialect.parameter_names, harness.simulator.autopilot.parameters
    for meaning, name in names.items():
        assert getattr(settings, meaning) == pytest.approx(parameters[name])
    only_one = {
        "fence_enable", "fence_types", "slope_min_m", "flight_options", "return_climb_m", "level_bank_deg",
        "num_rally_points", "rally_limit_km", "rally_includes_home", "terrain_enable", "terrain_follow",
        "terrain_spacing_m", "look_ahead_m", "climb_wanted_m_s", "sink_wanted_m_s",
        "height_acceptance_m", "passing_max_m", "height_offset_m", "stall_prevention",
    }  # fmt: skip
    assert set(names) | only_one == set(AutopilotSettings.__dataclass_fields__)


def test_a_few_at_once_and_not_for_ever(monkeypatch):
    monkeypatch.setattr(settings_reader, "ASKED_AT_ONCE", 4)
    reader, codec = SettingsReader(), Codec(1)
    codec.feed(b"", 0.0)
    reader.begin(Dialect.ARDUPILOT)
    wanted = (*Dialect.ARDUPILOT.parameter_names.values(), "GLIDE_SLOPE_MIN")
    count = len(wanted)
    questions = [asked(reader.due(codec)) for _ in range(TRIES * count)]
    assert max(map(len, questions)) == 4
    assert (
        len({name for question in questions[: count // 4 + 1] for name in question}) == count
    )  # The first ones wait.
    names = [name for question in questions for name in question]
    assert {name: names.count(name) for name in names} == dict.fromkeys(wanted, TRIES)


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


class Version:
    """A frame with an AUTOPILOT_VERSION."""

    def __init__(self, *numbers):
        self.reply = AutopilotVersion(numbers, 255)


@pytest.mark.parametrize(
    ("dialect", "numbers", "is_straight"),
    [
        (Dialect.ARDUPILOT, (4, 5, 7), True),
        (Dialect.ARDUPILOT, (4, 6, 1), True),
        (Dialect.ARDUPILOT, (4, 6, 2), False),  # its release notes name DO_RETURN_PATH_START
        (Dialect.ARDUPILOT, (4, 7, 0), False),
        (Dialect.ARDUPILOT, (0, 0, 0), False),  # some builds of one's own
        (Dialect.PX4, (1, 15, 0), False),
    ],
)
@pytest.mark.parametrize("is_version_first", [True, False])
def test_rtl_autoland_4_is_a_straight_return_with_an_arduplane_that_does_not_know_it(
    dialect, numbers, is_straight, is_version_first
):
    reader, name = SettingsReader(), dialect.parameter_names["return_kind"]
    reader.begin(dialect)
    frames = [Version(*numbers), Told(name, 4.0, bits=4)]
    for frame in frames if is_version_first else frames[::-1]:
        reader.note(frame)
    assert reader.settings.return_kind == (0.0 if is_straight else 4.0)
    reader.note(Told(name, 2.0, bits=2))
    assert reader.settings.return_kind == 2.0


def test_an_arduplane_is_asked_for_its_version_until_it_says_it():
    reader, codec = SettingsReader(), Codec(1)
    reader.begin(Dialect.ARDUPILOT)

    def asks():
        kinds = [
            message.get_type() for message in mavlink.MAVLink(None).parse_buffer(reader.due(codec)) or []
        ]
        return "COMMAND_LONG" in kinds

    assert [asks() for _ in range(TRIES + 2)] == [True] * TRIES + [False] * 2
    reader.begin(Dialect.ARDUPILOT)
    assert asks()
    reader.note(Version(4, 6, 3))
    assert not asks()


@pytest.mark.parametrize(
    ("told", "slopes"),
    [
        ({}, None),
        ({"ALT_SLOPE_MIN": 20.0}, (20.0, 20.0)),
        ({"GLIDE_SLOPE_MIN": 20.0}, (20.0, 20.0)),  # its name before version 4.7
        ({"ALT_SLOPE_MIN": 0.0}, (math.inf, math.inf)),
        ({"ALT_SLOPE_MIN": 15.0, "FLIGHT_OPTIONS": 16_384.0}, (math.inf, 15.0)),
        ({"ALT_SLOPE_MIN": 15.0, "FLIGHT_OPTIONS": 16_383.0}, (15.0, 15.0)),
    ],
)
def test_which_legs_an_arduplane_flies_as_slopes(told, slopes):
    reader = SettingsReader()
    reader.begin(Dialect.ARDUPILOT)
    for name, value in told.items():
        reader.note(Told(name, value))
    assert reader.settings.slope_min == slopes
