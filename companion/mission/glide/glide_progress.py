"""The progress of a glide to a field: its begin, the choice to keep the field, the time of the final."""

from __future__ import annotations

import math
from dataclasses import replace

from companion.mission.glide.glide_ground import is_glide_over_ground
from companion.mission.glide.landing_choice import (
    RESERVE_M,
    Begin,
    GlideOptions,
    LandingChoice,
    as_flown,
    best_field,
    choice_for,
    left_after_circle_m,
    likely_ways,
    open_ground,
)
from companion.tracking.ownship import predicted
from companion.types.state import Ownship
from companion.world.vehicle.glide import GRAVITY_M_S2, Glide, glide_to

# The final begins when the height that would be left over the field is less than the first number, plus the
# second for each second of the glide: rising or sinking air may change the rate of sink by that much.
FINAL_M, FINAL_M_S = 1.0, 0.25
TURN_BEGINS_S = 1.5  # The autopilot takes this long to take a command and to roll into a turn.
# A final returns to the circle only from farther than this many turn radii, and if it points at the field
# within this angle: a turn could contain a nearer field.
NEAR_RADII, POINTED_RAD = 1.7, math.radians(60.0)
CORRECTED_S = 30.0  # Longer glides count as this long: rising and sinking air averages out.
BOUND_RADII = 6.0  # A final is flown to its end once the field is nearer than this many radii of the circle.
THERE_RADII = 2.3  # No other place is chosen within this many radii of the field or its circle.
BACK_MIN_M = 5.0  # An aircraft that is past the field and higher than this is turned back to it.
KEPT_M = -5.0  # A field is given up for another if, by the model, the height left over is less than this.
ENERGY_LOST_MAX_M = 20.0  # A slow aircraft gives up at most this height for airspeed.
KEPT_MARGIN_M = 12.0  # A glide that comes nearer to an obstacle is given up for another.


def begin_of(options: GlideOptions, ownship: Ownship, ahead_s: float = 0.0) -> Begin:
    """Return where the glide begins: the height is less for an aircraft slower than the glide.

    Parameters
    ----------
    options : GlideOptions
        The glide.
    ownship : Ownship
        The aircraft.
    ahead_s : float
        After this time the glide begins [s].
    """
    ownship = predicted(ownship, ahead_s)
    wind, (east, north, up) = ownship.wind_enu_m_s, ownship.position_enu_m
    air_east, air_north = (own - air for own, air in zip(ownship.velocity_m_s, wind, strict=True))
    lacking = max(options.model.airspeed_m_s**2 - ownship.airspeed_m_s**2, 0.0) / (2.0 * GRAVITY_M_S2)
    height = up - min(lacking, ENERGY_LOST_MAX_M)
    return Begin((east, north, height), math.atan2(air_east, air_north), wind)


def best_place(
    options: GlideOptions, begin: Begin, kept: LandingChoice | None, *, on_final: bool = False
) -> LandingChoice | None:
    """Return the chosen place while it is within reach, else another; the chosen one if there is no other."""
    if kept is None:
        return best_field(options, begin) or open_ground(options, begin)
    is_lost = not is_kept(options, kept, on_final=on_final)
    if kept.place not in options.places:  # A field is better than open ground, if it can be reached for sure.
        found = best_field(options, begin)
        if found is not None and found.spare_m >= RESERVE_M:
            return found
        return (open_ground(options, begin) if is_lost else None) or kept
    if not is_lost:
        return kept
    found = choice_for(options, begin, kept.place) or best_field(options, begin)
    return found or open_ground(options, begin) or kept


def is_near(choice: LandingChoice) -> bool:
    """Return whether the field is near enough that a final to it is flown to its end."""
    return choice.away_m < BOUND_RADII * choice.approach.radius_m


def is_kept(options: GlideOptions, choice: LandingChoice, *, on_final: bool = False) -> bool:
    """Return whether a chosen place is still within reach, on a way that is clear."""
    centre, radius = choice.approach
    away = min(choice.away_m, math.dist(choice.direct.begin_enu_m[:2], centre[:2]))
    return away < THERE_RADII * radius or (
        choice.spare_m >= KEPT_M
        and is_clear_now(options, choice, choice.direct if on_final else choice.to_circle)
    )


def is_clear_now(options: GlideOptions, choice: LandingChoice, glide: Glide) -> bool:
    """Return whether a glide from where the aircraft is now is clear."""
    place = choice.place
    is_clear = options.is_clear(glide.track(place.position_enu_m[2]), KEPT_MARGIN_M)
    return is_clear and (
        options.ground is None
        or is_glide_over_ground(options.ground, glide, place.position_enu_m[2], place.radius_m, KEPT_MARGIN_M)
    )


def circle_is_due(options: GlideOptions, choice: LandingChoice) -> bool:
    """Return whether the aircraft on its final is too high, and far enough for another turn that is clear.

    It is too high if it would come down nearer to the field by way of the circle. From within the circle it
    would first fly out of it, which is not known in advance.
    """
    (east, north, _), radius = choice.approach
    is_outside = math.dist(choice.direct.begin_enu_m[:2], (east, north)) >= radius
    is_above = is_outside and -choice.spare_m < left_after_circle_m(as_flown(options.model), choice)
    is_pointed = abs(choice.direct.turned_rad) < POINTED_RAD
    is_far = choice.away_m > NEAR_RADII * choice.direct.model.turn_radius_m
    return is_above and is_pointed and is_far and is_clear_now(options, choice, choice.to_circle)


def is_past(choice: LandingChoice) -> bool:
    """Return whether the field lies behind the aircraft, which is high enough to turn back to it."""
    (east, north, up), (to_east, to_north, ground) = choice.direct.begin_enu_m, choice.place.position_enu_m
    heading = choice.direct.heading_rad
    ahead = (to_east - east) * math.sin(heading) + (to_north - north) * math.cos(heading)
    return ahead < 0.0 and up - ground > BACK_MIN_M


def final_is_due(options: GlideOptions, choice: LandingChoice, entry: Begin) -> bool:
    """Return whether the glide straight to the field needs all of the height, and is clear.

    A final whose turn is not clear waits for another place on the circle.

    Parameters
    ----------
    options : GlideOptions
        The glide and the obstacles.
    choice : LandingChoice
        The field, from where the aircraft is now.
    entry : Begin
        Where the turn to the field begins, :data:`TURN_BEGINS_S` later.
    """
    is_below = choice.spare_m <= FINAL_M + FINAL_M_S * min(choice.direct.duration_s, CORRECTED_S)
    if not is_below:
        return False
    ways = likely_ways(as_flown(options.model), entry, choice.place.position_enu_m)
    return all(is_clear_now(options, choice, way) for way in ways or [choice.direct])


def from_now(options: GlideOptions, begin: Begin, choice: LandingChoice) -> LandingChoice:
    """Return a choice from where the aircraft is now, its circle unchanged.

    The turn to the field is as narrow as autopilots fly it: with a wider one a final would arrive too high.
    """
    model = options.model
    direct, to_circle = (
        glide_to(of, begin.position_enu_m, begin.heading_rad, place[:2], begin.wind_enu_m_s)
        for of, place in (
            (as_flown(model), choice.place.position_enu_m),
            (model, choice.approach.centre_enu_m),
        )
    )
    if direct is None:  # The field lies within the circle of a turn: what was last known is lost from here.
        direct = replace(choice.direct, begin_enu_m=begin.position_enu_m, heading_rad=begin.heading_rad)
    return choice._replace(direct=direct, to_circle=to_circle or choice.to_circle)
