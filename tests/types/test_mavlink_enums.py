"""Every number under its name, against pymavlink's tables of the dialect."""

from enum import Enum

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types import mavlink_enums
from companion.types.mavlink_enums import MessageId, MissionResult, name_of

# What an enum is called in the dialect, and what its entries' names begin with there.
DIALECT = {
    "Command": ("MAV_CMD", "MAV_CMD_"),
    "MavFrame": ("MAV_FRAME", "MAV_FRAME_"),
    "CommandResult": ("MAV_RESULT", "MAV_RESULT_"),
    "MissionResult": ("MAV_MISSION_RESULT", "MAV_MISSION_"),
    "MissionState": ("MISSION_STATE", "MISSION_STATE_"),
    "LandedState": ("MAV_LANDED_STATE", "MAV_LANDED_STATE_"),
    "MissionType": ("MAV_MISSION_TYPE", "MAV_MISSION_TYPE_"),
    "Severity": ("MAV_SEVERITY", "MAV_SEVERITY_"),
    "ParameterType": ("MAV_PARAM_TYPE", "MAV_PARAM_TYPE_"),
    "Autopilot": ("MAV_AUTOPILOT", "MAV_AUTOPILOT_"),
    "ComponentId": ("MAV_COMPONENT", "MAV_COMP_ID_"),
    "ModeFlag": ("MAV_MODE_FLAG", "MAV_MODE_FLAG_"),
    "VehicleType": ("MAV_TYPE", "MAV_TYPE_"),
    "AdsbAltitudeType": ("ADSB_ALTITUDE_TYPE", "ADSB_ALTITUDE_TYPE_"),
    "EmitterType": ("ADSB_EMITTER_TYPE", "ADSB_EMITTER_TYPE_"),
    "SystemState": ("MAV_STATE", "MAV_STATE_"),
    "EstimatorStatusFlag": ("ESTIMATOR_STATUS_FLAGS", "ESTIMATOR_"),
    "EkfStatusFlag": ("EKF_STATUS_FLAGS", "EKF_"),
    "GpsFix": ("GPS_FIX_TYPE", "GPS_FIX_"),
}
YOUNGER = {"CommandResult": {6: "MAV_RESULT_CANCELLED"}}  # than pymavlink's copy of the dialect
KINDS = {
    name: kind
    for name, kind in vars(mavlink_enums).items()
    if isinstance(kind, type) and issubclass(kind, Enum) and kind.__module__ == mavlink_enums.__name__
}


def test_each_is_compared():
    assert KINDS.keys() == DIALECT.keys() | {"MessageId"}


@pytest.mark.parametrize("name", DIALECT)
def test_numbers_and_names_are_the_dialects(name):
    table, prefix = DIALECT[name]
    ours = {member.value: prefix + member.name for member in KINDS[name]}
    known = {number: entry.name for number, entry in mavlink.enums[table].items()} | YOUNGER.get(name, {})
    assert ours == {number: known[number] for number in ours}


def test_messages_have_their_ids():
    lacking = {397: "COMPONENT_METADATA"}  # in common.xml, and not in pymavlink's copy
    assert {member.value: member.name for member in MessageId} == lacking | {
        number: mavlink.mavlink_map[number].msgname for number in MessageId if number not in lacking
    }
    assert lacking.keys().isdisjoint(mavlink.mavlink_map)


def test_a_number_that_is_none_is_told_as_a_number():
    assert name_of(MissionResult, 13) == "INVALID_SEQUENCE"
    assert name_of(MissionResult, 99) == "result 99"
