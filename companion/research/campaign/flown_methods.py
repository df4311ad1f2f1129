"""Parts of some kinds of campaign only: faults of the link, and encounters."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from companion.config.sections.section_base import Section

FAULTS, ENCOUNTER = "faults", "encounter"  # First parts of keys that do not change the mission file.

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


class EncounterConfig(Section):
    """The aircraft that pass."""

    model: str = ""
    """An encounter model in the format of MIT Lincoln Laboratory, or a scenario (.daa), from here on.

    Environment variables, such as ``$MODELS``, are replaced by their values."""
    spread: Annotated[float, Field(ge=0.1, le=10.0)] = 1.5
    """Largest miss distances of the flight alone, over those of the well clear volume of ASTM F3442."""
    source: Literal["adsb", "remote_id", "utm"] = "adsb"
    """How the aircraft are reported."""


PARTS: Mapping[str, tuple[type[Section], str]] = MappingProxyType(
    {
        FAULTS: (LinkFaultsConfig, "flights"),
        ENCOUNTER: (EncounterConfig, "encounters"),
    }
)
"""Sections of settings that do not change the mission file, and the kind of campaign that takes each."""


def mission_part(overlay: Mapping[str, object]) -> dict[str, object]:
    """Return the settings that change the mission file."""
    return {key: value for key, value in overlay.items() if key.partition(".")[0] not in PARTS}


def part_of(overlay: Mapping[str, object], wanted: str) -> dict[str, object]:
    """Return the settings of one of :data:`PARTS`, by the names of its section."""
    parts = ((key.partition("."), value) for key, value in overlay.items())
    return {name: value for (first, _, name), value in parts if first == wanted}
