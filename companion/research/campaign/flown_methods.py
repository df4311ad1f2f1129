"""Parts of some kinds of campaign only: methods besides the planner's, and faults of the link."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from companion.config.sections.section_base import Section

PLAN_ONCE, STRAIGHT_LINE = "plan-once", "straight-line"
FLOWN_METHODS = (PLAN_ONCE, STRAIGHT_LINE)
ANYTIME_METHODS = ("ompl-rrt", "ompl-rrt-star", "ompl-bit-star", "ompl-aorrtc")  # Planners of OMPL.
FAULTS = "faults"  # First part of a setting's key that changes the simulator instead of the mission file.

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Delay = Annotated[float, Field(ge=0.0, le=60.0)]


class LinkFaultsConfig(Section):
    """Faults of the link between the service and the autopilot, the same in both directions."""

    loss: Share = 0.0
    """Share of the frames that are lost."""
    duplication: Share = 0.0
    """Share of the frames that come twice."""
    corruption: Share = 0.0
    """Share of the frames that have bits turned."""
    delay_s: Delay = 0.0
    """Of every frame."""
    jitter_s: Delay = 0.0
    """The most that is added to the delay; with it frames overtake each other."""
    schedule: Literal["none", "random"] = "none"
    """Of random ones: spells of every kind of badness, a link cut for up to 12 s, by the run's seed."""

    @property
    def is_none(self) -> bool:
        """Whether the link has no faults."""
        return self == LinkFaultsConfig()


def mission_part(overlay: Mapping[str, object]) -> dict[str, object]:
    """The settings that change the mission file."""
    return {key: value for key, value in overlay.items() if key.partition(".")[0] != FAULTS}


def faults_part(overlay: Mapping[str, object]) -> dict[str, object]:
    """The settings that change the link, by the names of :class:`LinkFaultsConfig`."""
    parts = ((key.partition("."), value) for key, value in overlay.items())
    return {name: value for (first, _, name), value in parts if first == FAULTS}
