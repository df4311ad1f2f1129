"""A text to the pilot, with its cause and what the pilot can do; and those about other aircraft."""

from __future__ import annotations

from dataclasses import dataclass

from companion.types.mavlink_enums import Severity

NOTHING = "Nothing."


@dataclass(frozen=True, slots=True)
class PilotText:
    """One row of the table.

    ``kind`` is that of the decision that it reports, ``template`` the text, in which names in braces are
    replaced by values. ``cause`` says when it is sent, ``action`` what the pilot can do.
    """

    kind: str
    severity: Severity
    template: str
    cause: str
    action: str


@dataclass(frozen=True, slots=True)
class PilotMessage:
    """A text to send, and its subject.

    A text is not repeated for a while unless another text about the same subject was sent in between.
    """

    severity: Severity
    text: str
    subject: str


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
    "barred": PilotText(
        "team",
        Severity.NOTICE,
        "System {member} bars the goal, is asked to move",
        "Nothing has led to the goal for 15 s, and without the circles of these members a path would.",
        "Wait. If they do not move, have their pilots move them, or land.",
    ),
    "moves aside": PilotText(
        "team",
        Severity.NOTICE,
        "Moving aside: system {member} has to pass",
        "The aircraft circles where another member has to pass. It flies its own goals afterwards.",
        "Leave it to the planner, or take over: the other member then waits.",
    ),
    "in the way": PilotText(
        "team",
        Severity.WARNING,
        "In the way of system {member}: move if you can",
        "The aircraft circles where another member has to pass, and the planner may not or cannot move it.",
        "Fly elsewhere, or select the mission mode to leave it to the planner.",
    ),
    "way on taken": PilotText(
        "team",
        Severity.NOTICE,
        "Waiting before the goal: the way on is not free",
        "Behind the last goal the operator's items follow, and other members fly where these lead.",
        "Wait. The planner goes on when the way is free.",
    ),
    "moved aside": PilotText(
        "arrived",
        Severity.NOTICE,
        "Out of the way, planner is done",
        "The aircraft circles at a place where it is in no other member's way.",
        "Land as planned, or take over.",
    ),
}
