"""What the pilot reads of other aircraft; a part of :mod:`companion.types.pilot_texts`."""

from __future__ import annotations

from companion.types.mavlink_enums import Severity
from companion.types.pilot_text import NOTHING, PilotText

OTHER_AIRCRAFT = {
    "traffic": PilotText(
        "traffic",
        Severity.WARNING,
        "Traffic {hour} o'clock, {distance} km, {height}, {time} s",
        "Within 45 s an aircraft that reports itself comes within 610 m, and 76 m of height, if both go on "
        "as they do. Its direction is by the clock from our course; the time is that until it is nearest.",
        "Look for it. The planner keeps well clear where it can.",
    ),
    "team lost": PilotText(
        "team",
        Severity.WARNING,
        "Team: system {member} not received",
        "No message of this member came for `team.lost_after_s`. Its approval is not waited for any more. "
        "Its last known path is kept clear of, and it is handled as any other aircraft.",
        "Watch it: it may fly elsewhere.",
    ),
    "team again": PilotText(
        "team",
        Severity.INFO,
        "Team: system {member} received again",
        "The member's messages are received again, and its approval is needed.",
        NOTHING,
    ),
}
