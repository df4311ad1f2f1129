"""A text to the pilot, with its cause and what the pilot can do."""

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
