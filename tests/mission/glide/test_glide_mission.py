"""The items of the mission to a field, and what a PX4 and an ArduPlane ask of them."""

import math

import pytest

from companion.mission.glide.glide_mission import (
    CIRCLE_ITEM,
    ENTRY_ITEM,
    LAND_ITEM,
    glide_part,
    glide_path,
    glide_waypoints,
)
from companion.mission.glide.landing_choice import Begin, best_field
from companion.mission.list_layout import new_banks
from companion.mission.operator import banks_in, position_of
from companion.types.mission import Command
from sim.autopilot.px4.px4_store import why_infeasible
from sim.projection import FastProjection
from tests.mission.glide.worlds_for_glides import glide_mission_of, options_of

FRAME = glide_mission_of().frame
CHOICE = best_field(options_of(), Begin((0.0, 0.0, 200.0), 0.5 * math.pi, (0.0, 0.0)))
PART = glide_part(glide_waypoints(CHOICE), FRAME)


def test_it_is_a_circle_down_and_a_landing_in_the_field():
    commands = [item.command for item in PART.items]
    assert commands == [
        Command.NAV_WAYPOINT, Command.DO_CHANGE_SPEED, Command.NAV_LOITER_TO_ALT, Command.NAV_LAND,
    ]  # fmt: skip
    assert (commands[ENTRY_ITEM], commands[CIRCLE_ITEM], commands[LAND_ITEM]) == tuple(commands[1:])
    assert position_of(PART.items[LAND_ITEM], FRAME, None) == pytest.approx((1_000.0, 0.0, 0.0), abs=0.02)
    east, north, up = position_of(PART.items[CIRCLE_ITEM], FRAME, None)
    assert (east, north) == pytest.approx(CHOICE.approach.centre_enu_m[:2], abs=0.02)
    assert 0.0 < up <= CHOICE.approach.centre_enu_m[2]
    assert PART.items[CIRCLE_ITEM].parameters[1] == math.ceil(CHOICE.approach.radius_m)


def test_the_airspeed_is_that_of_the_glide_at_its_height():
    """584 m and the circle's height above the sea: the density is 0.944 of that there."""
    assert PART.items[ENTRY_ITEM].parameters[1] == pytest.approx(20.0 * math.sqrt(0.944), abs=0.05)


def test_a_px4_takes_the_landing():
    assert why_infeasible(PART.items, 2, 5.0, FastProjection(FRAME)) == ""


def test_an_arduplane_finds_the_bank_again_after_a_restart():
    layout = new_banks(())
    bank = layout.items_for(PART)
    assert banks_in(bank) == (0, len(bank))


def test_the_path_leads_over_the_circle_to_the_field_and_only_down():
    path = glide_path(CHOICE, 50.0, (0.0, 0.0))
    assert path.times_s[0] == 50.0
    assert (path.times_s[1:] > path.times_s[:-1]).all()
    assert path.positions_enu_m[-1] == pytest.approx((1_000.0, 0.0, 0.0))
    assert (path.positions_enu_m[1:, 2] <= path.positions_enu_m[:-1, 2] + 1e-9).all()
