"""The section ``authority`` of a mission file."""

from __future__ import annotations

from typing import Literal

from companion.config.sections.section_base import Section


class Authority(Section):
    """What the service may do without asking the pilot."""

    resume: Literal["auto", "never"] = "auto"
    """`auto`: the service continues when the pilot returns to the mission mode after leaving it."""
    allow_rtl: bool = False
    """If true, the last emergency step may select return to launch, if the way home is clear."""
    keep_ready: bool = False
    """If true, the autopilot always holds a checked mission for the return to AUTO while the pilot flies."""
    keep_return_path: bool = True
    """If true, the service keeps a checked return path in the list of an ArduPlane with RTL_AUTOLAND 2 or 4.
    A return to launch then joins it, whoever begins the return."""
    set_return: bool = False
    """If true, the service sets RTL_AUTOLAND to 2 if it is neither 2 nor 4, or RTL_TYPE to 2 if the mission
    has a landing, before the aircraft is armed. The value stays after the flight."""
    renew_return: bool = False
    """If true, and a return to launch of an ArduPlane follows the return path, the service plans the rest of
    it like any other path, whoever began the return."""
    turn_back: bool = False
    """If true, the service commands return to launch when all that the battery holds beyond `reserve_wh` is
    needed for the way home, and that way is clear. This needs a section `energy`."""
    glide: bool = False
    """If true, the service flies the aircraft to a field of the section `glide` when thrust is missing."""
