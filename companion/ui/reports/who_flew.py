"""Periods in which the service, the pilot or a failsafe flew, from a recording's decisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from companion.plain_text import in_page
from companion.types.record import Decision
from companion.ui.reports import style

# The texts of a change of the service's mode, and who flies then.
WHO = {
    "waiting for the autopilot": "not known: the autopilot was not heard",
    "standing by": "the pilot: on the ground, or in a mode of his own",
    "the operator's mission": "the operator's mission, up to the takeover",
    "planning": "the service",
    "another mode": "the pilot",
    "other mission or item": "another mission or item of the operator's",
    "at the last goal": "the operator's items behind the goal",
}
CHANGES_MAX = 1_000  # Most changes of a flight that are listed.
CHANGES = frozenset({"mode", "suspended", "arrived"})
WORTH_TELLING = frozenset(
    {"mission", "takeover", "fault", "ready", "handback", "landed", "restart", "stopped"}
)


@dataclass(frozen=True, slots=True)
class Watch:
    """A part of a flight with one pilot: the service, a person or the autopilot.

    Parameters
    ----------
    from_s, to_s : float
        Clock readings of the recording [s].
    who : str
        Who flew.
    why : str
        The decision at its beginning.
    texts : tuple of str
        The texts that the pilot got, without repetitions.
    """

    from_s: float
    to_s: float
    who: str
    why: str
    texts: tuple[str, ...]


def watches(decisions: Sequence[Decision], ends_s: float) -> list[Watch]:
    """Return the parts of a flight, one after the other.

    Parameters
    ----------
    decisions : sequence of Decision
        All of one flight, in order.
    ends_s : float
        When the recording ended [s].
    """
    changes = [entry for entry in decisions if entry.kind in CHANGES][:CHANGES_MAX]
    found = []
    for number, entry in enumerate(changes):
        to_s = changes[number + 1].stamp_s if number + 1 < len(changes) else max(ends_s, entry.stamp_s)
        texts = dict.fromkeys(
            f"{other.kind}: {other.text}"
            for other in decisions
            if entry.stamp_s <= other.stamp_s < to_s and other.kind in WORTH_TELLING
        )
        found.append(Watch(entry.stamp_s, to_s, who_of(entry.text), entry.text, tuple(texts)))
    return found


def who_of(text: str) -> str:
    """Return who flies after a change, by its text; the text itself if it is unknown."""
    return next((who for words, who in WHO.items() if text.startswith(words)), text)


def who_flew_table(decisions: Sequence[Decision], ends_s: float, start_s: float) -> str:
    """HTML of the parts; '' if no change was recorded.

    Parameters
    ----------
    decisions : sequence of Decision
        All of one flight, in order.
    ends_s : float
        When the recording ended [s].
    start_s : float
        Begin of the flight's time [s].
    """
    rows = "\n".join(
        f'<tr><td class="number">{style.clock_text(watch.from_s - start_s)}</td>'
        f'<td class="number">{style.clock_text(watch.to_s - start_s)}</td>'
        f'<td class="text">{in_page(watch.who)}</td><td class="text">{in_page(watch.why)}</td>'
        f'<td class="text why">{"<br>".join(map(in_page, watch.texts)) or "–"}</td></tr>'
        for watch in watches(decisions, ends_s)
    )
    if not rows:
        return "<p>No change of who flies was recorded.</p>"
    return f"""<div class="scroll" tabindex="0" role="region" aria-label="Who flew">
<table>
<thead><tr>
<th scope="col" class="number">From [mm:ss]</th><th scope="col" class="number">To [mm:ss]</th>
<th scope="col">Who flew</th><th scope="col">Why</th><th scope="col">What the pilot was told</th>
</tr></thead>
<tbody>
{rows}
</tbody>
</table>
</div>"""
