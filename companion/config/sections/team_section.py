"""The section ``team`` of a mission file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from companion.config.sections.section_base import Section

SystemId = Annotated[int, Field(ge=1, le=255)]
Metres = Annotated[float, Field(gt=0.0, le=5_000.0)]


class TeamConfig(Section):
    """Several aircraft that share their plans, each with its own service. All members have the same section.
    A mission is entered only when every other member has approved its path. No leader is needed: see
    [A team](team.md)."""  # noqa: D205, D209 - A paragraph of the reference page.

    members: Annotated[tuple[SystemId, ...], Field(min_length=2, max_length=128)]
    """MAVLink system ids of all members' autopilots."""
    apart_m: Metres = 40.0
    """Horizontal distance between two members, besides what both tolerances take."""
    apart_up_m: Metres = 20.0
    """Vertical distance that suffices where the horizontal one is not kept."""
    tolerance_m: Metres = 50.0
    """Each member promises to be this close to its told path at every time, horizontally."""
    tolerance_up_m: Metres = 10.0
    """The same vertically."""
    lost_after_s: Annotated[float, Field(ge=10.0, le=3_600.0)] = 60.0
    """A member that is not received for this time counts as lost: its approval is not waited for."""
    share_goals: bool = False
    """The goals belong to the team: each is flown by one member, and by another one if that is lost or turns
    home. All members have the same goals in their mission files. See [Shared goals](team.md#shared-goals)."""

    @property
    def paths_apart_up_m(self) -> float:
        """The vertical distance of two announced paths that keeps members apart, for all tolerances [m]."""
        return float(self.apart_up_m + 2.0 * self.tolerance_up_m)
