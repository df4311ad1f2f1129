"""The section ``terrain`` of a mission file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from companion.config.sections.section_base import Section

HeightOverGround = Annotated[float, Field(gt=0.0, le=10_000.0)]


class GeneratedGround(Section):
    """Ground that is computed from a seed: a place to fly without a map."""

    kind: Literal["ridges", "hills"]
    """`ridges` that lie across the way with passes in them, or round `hills`."""
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 1
    """The same seed gives the same ground."""
    relief_m: Annotated[float, Field(gt=0.0, le=5_000.0)] = 250.0
    """From the lowest to the highest ground."""


class TerrainConfig(Section):
    """The ground. With this section the aircraft keeps its height over ground, ridges hide it from radars,
    and ground vehicles drive on the ground. Give one of `file`, `generated` and `sample`. All other heights
    of the mission file stay heights over the origin."""  # noqa: D205, D209 - A paragraph of the reference page.

    file: Annotated[str, Field(min_length=1, max_length=1_000)] | None = None
    """A raster file of heights, or a folder of such files, beside the mission file: GeoTIFF, SRTM `.hgt`, or
    any other that GDAL reads. This needs the extra `terrain`."""
    generated: GeneratedGround | None = None
    """Ground computed from a seed."""
    sample: Literal["jacksboro_fault"] | None = None
    """Real ground that comes with matplotlib: the Jacksboro fault in Tennessee."""
    datum: Literal["EGM96", "EGM2008", "ellipsoid"] = "EGM96"
    """What heights in the file count from. `EGM96` and `EGM2008` are mean sea level and differ by less than a
    metre in most places; they are not told apart. `ellipsoid` needs `geoid_height_m`."""
    geoid_height_m: Annotated[float, Field(ge=-120.0, le=100.0)] = 0.0
    """Height of mean sea level above the ellipsoid in this area. It is subtracted if `datum` is
    `ellipsoid`."""
    height_min_m: HeightOverGround = 50.0
    """Plans stay at least this high over ground. It is at least `clearance_min_m`."""
    height_max_m: HeightOverGround | None = None
    """Plans stay at most this high over ground; by default only `bounds` limit the height."""
    height_wanted_m: HeightOverGround | None = None
    """Below this height over ground a second costs more, the more the lower (`price_near`); by default 10 m
    above `height_min_m`, since a flight does not keep to its path to the metre."""
    item_frame: Literal["amsl", "terrain"] = "amsl"
    """What heights of uploaded waypoints count from. With `terrain` an ArduPlane keeps heights over ground
    between them, by the heights that it stores (`TERRAIN_ENABLE` 1). A mission that would come too low that
    way is uploaded with `amsl`, and the return path always is. A PX4 takes no such waypoints, and is not
    taken over with `terrain`."""
    drivable_slope_deg: Annotated[float, Field(gt=0.0, lt=90.0)] = 30.0
    """Ground vehicles do not drive over steeper ground."""
    home_tolerance_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 20.0
    """The map and the autopilot's home may differ in height by this much. With more the mission is not taken
    over. In flight the pilot is told if the ground that the autopilot stores or measures differs by more."""
