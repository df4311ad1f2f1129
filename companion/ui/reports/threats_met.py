"""The threats that a flight met, in words and numbers; the numbers are the record's."""

from __future__ import annotations

import math

from companion.assurance.encounters import aggregated_threat, total_duration_s, total_threat
from companion.plain_text import in_page
from companion.types.encounter import Closest, Encounter
from companion.types.record import FlightRecord
from companion.ui.reports import style

NUMBERS = (
    *("Reach [m]", "In reach [s]", "In sight, too [s]", "First so", "Closest [m]", "At", "TDTA, TTA"),
    "ADTP, ATP",
)


def nearest_first(record: FlightRecord) -> list[tuple[Encounter, Closest]]:
    """Encounters with moving threats, the closest approach first."""
    known = [(entry, entry.closest) for entry in record.encounters if entry.is_moving and entry.closest]
    return sorted(known, key=lambda pair: pair[1].distance_m)


def words_of(record: FlightRecord) -> str:
    """Return the source of the paths that encounters are measured on, in words."""
    return "by the true paths" if record.dt_paths else "as known on board"


def closest_text(closest: Closest, start_s: float) -> str:
    """Return how near a threat came, at a slant, and when: the same words in map and chart."""
    return f"{style.number_text(closest.distance_m)} m at {style.clock_text(closest.stamp_s - start_s)}"


def seconds_text(entry: Encounter) -> str:
    """Return how long a threat had the aircraft in reach, and in sight, too."""
    reached, seen = (
        style.number_text(total_duration_s(stretches)) for stretches in (entry.in_reach_s, entry.in_sight_s)
    )
    return f"{reached} s in reach, {seen} s in sight"


def encounter_table(record: FlightRecord, start_s: float) -> str:
    """HTML table of the flight's encounters with each threat, moving ones first.

    Parameters
    ----------
    record : FlightRecord
        The flight.
    start_s : float
        Begin of the flight's time [s].
    """
    entries = [entry for entry, _ in nearest_first(record)]
    entries += [entry for entry in record.encounters if not entry.is_moving]
    if not entries:
        return "<p>No threat was met.</p>"
    head = "".join(f'<th scope="col" class="number">{text}</th>' for text in NUMBERS)
    rows = "\n".join(_row(entry, start_s) for entry in entries)
    return f"""<p class="lead">{in_page(_lead(record))}</p>
<div class="scroll" tabindex="0" role="region" aria-label="Threats">
<table>
<thead><tr><th scope="col">Threat</th>{head}</tr></thead>
<tbody>
{rows}
</tbody>
</table>
</div>"""


def _lead(record: FlightRecord) -> str:
    return (
        f"{words_of(record).capitalize()}. In reach is by slant distance; in sight, where no obstacle cuts "
        "the straight line. The sums and means are the paper's, of moving threats and of radars."
    )


def _row(entry: Encounter, start_s: float) -> str:
    closest = entry.closest
    first = float(entry.in_sight_s[0, 0]) - start_s if len(entry.in_sight_s) else math.nan
    cells = (
        style.number_text(entry.reach_m),
        style.number_text(total_duration_s(entry.in_reach_s)),
        style.number_text(total_duration_s(entry.in_sight_s)),
        style.clock_text(first),
        style.number_text(closest.distance_m if closest else math.nan),
        style.clock_text(closest.stamp_s - start_s if closest else math.nan),
        style.number_text(total_threat([entry]) if len(entry.levels) else math.nan),
        style.number_text(aggregated_threat([entry]) if len(entry.levels) else math.nan),
    )
    numbers = "".join(f'<td class="number">{text}</td>' for text in cells)
    return f'<tr><td class="text">{in_page(entry.name)}</td>{numbers}</tr>'
