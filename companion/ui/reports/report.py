"""The report of a flight: one self-contained HTML file, and its map as a picture."""

from __future__ import annotations

import base64
import math
import statistics
from pathlib import Path

from companion.config.models import MissionConfig
from companion.plain_text import in_page
from companion.safe_files import SHARED, make_folder, replace_file
from companion.types.record import Decision, FlightRecord
from companion.ui.reports import style
from companion.ui.reports.charts import (
    altitude_chart,
    decision_chart,
    encounter_chart,
    energy_chart,
    latency_chart,
    threat_chart,
)
from companion.ui.reports.ground_profile import flown_over_ground, lowest_over_ground
from companion.ui.reports.plots import flight_map, flight_start
from companion.ui.reports.threats_met import encounter_table
from companion.ui.reports.vocabulary import decision_words
from companion.ui.reports.who_flew import who_flew_table
from companion.world.snapshot import Snapshot

UNITS = (
    ("_m_s", "m/s"),
    ("_wh", "Wh"),
    ("_ms", "ms"),
    ("_deg", "°"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_m", "m"),
    ("_s", "s"),
)

STYLE_SHEET = """
:root { color-scheme: light; --ink: #1d2733; --muted: #55616d; --line: #d9dfe5; --soft: #f3f5f8;
        --watch: #8a5a00; --danger: #b3122a; }
* { box-sizing: border-box; }
body { margin: 0; color: var(--ink); background: #fff; line-height: 1.5;
       font-family: system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 1.6rem 1.2rem 4rem; }
h1 { font-size: 1.7rem; margin: 0; line-height: 1.25; }
h2 { font-size: 1.2rem; margin: 2.4rem 0 .7rem; padding-bottom: .3rem; border-bottom: 2px solid var(--line); }
p.lead { color: var(--muted); margin: .2rem 0 0; }
figure { margin: 0 0 1.4rem; }
figure > div { overflow-x: auto; }
figure img, figure svg { display: block; width: 100%; min-width: 44rem; height: auto; }
figcaption { color: var(--muted); font-size: .88rem; margin-top: .35rem; max-width: 75ch; }
table { border-collapse: collapse; width: 100%; font-size: .93rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .38rem .7rem; border-bottom: 1px solid var(--line); }
thead th { position: sticky; top: 0; background: var(--soft); white-space: nowrap; }
td.number, th.number { text-align: right; white-space: nowrap; }
td.kind { min-width: 7rem; font-weight: 600; }
td.kind[data-state="watch"] { color: var(--watch); }
td.kind[data-state="danger"] { color: var(--danger); }
td.text { overflow-wrap: anywhere; min-width: 14rem; }
td.why { color: var(--muted); font-size: .85rem; }
tbody tr:hover { background: var(--soft); }
.scroll { overflow: auto; max-height: 36rem; border: 1px solid var(--line); border-radius: 6px; }
.summary { display: grid; grid-template-columns: repeat(auto-fit, minmax(15rem, 1fr)); gap: 0 2rem;
           align-items: start; }
.summary th { font-weight: 400; color: var(--muted); }
.summary td { text-align: right; font-weight: 600; }
p.lead + .scroll { margin-top: .6rem; }
@media print {
  main { max-width: none; padding: 0; }
  .scroll { max-height: none; overflow: visible; border: 0; }
  figure > div { overflow: visible; }
  figure img, figure svg { min-width: 0; }
  table, td.why { font-size: .74rem; }
  th, td { padding: .2rem .35rem; }
  thead th, th.number { position: static; white-space: normal; }
  td.kind, td.text { min-width: 0; }
  tr, figure { break-inside: avoid; }
  h2 { break-after: avoid; }
}
"""


def write_report(
    folder: Path, mission: MissionConfig, snapshot: Snapshot, record: FlightRecord, name: str = "report"
) -> tuple[Path, Path]:
    """Write a report, page and picture, into a folder, which is created if missing.

    Parameters
    ----------
    folder : Path
        Folder that the page and the picture are written into.
    mission : MissionConfig
        The mission that was to be flown.
    snapshot : Snapshot
        The world, for obstacles, radars and bounds.
    record : FlightRecord
        The record of what was flown and decided.
    name : str
        Name of both files, before ``.html`` and ``.png``.

    Returns
    -------
    tuple of Path
        The page and the picture.
    """
    make_folder(folder)
    page, picture = folder / f"{name}.html", folder / f"{name}.png"
    with style.drawing():
        start_s = flight_start(record)
        drawn = style.write_picture(picture, flight_map(mission, snapshot, record))
        altitude, threat = altitude_chart(mission, snapshot, record, start_s), threat_chart(record, start_s)
        charts = [
            (
                style.inline_svg(
                    decision_chart(record, start_s),
                    "decisions",
                    "Timeline of the decisions, one row a kind, over flight time",
                ),
                "When something was decided; the table below says what and why.",
            ),
            (
                style.inline_svg(
                    altitude, "altitude", "Altitude over flight time, between floor and ceiling"
                ),
                "Height along the flown path."
                if mission.terrain is None
                else "Height along the flown path, the ground below it, and the limits over it.",
            ),
            (
                style.inline_svg(threat, "threat", "Threat level along the flown path over flight time"),
                "How exposed the aircraft was to radars and moving threats together; 0 is unseen.",
            ),
            (
                style.inline_svg(
                    encounter_chart(record, start_s),
                    "encounters",
                    "Distance to each moving threat over flight time, its reach and the closest approach",
                ),
                "How near the moving threats were, at a slant. Light: in reach; dark: in sight, too.",
            ),
            (
                style.inline_svg(
                    latency_chart(record), "latency", "Computing time of every plan in milliseconds"
                ),
                "How long each plan took to compute, in the order they were made.",
            ),
        ]
        if len(record.energy):
            energy = style.inline_svg(energy_chart(record, start_s), "energy", "Energy left over flight time")
            charts.append((energy, "Where the lines meet, what is left is just enough for the way home."))
    replace_file(page, _page(mission, record, drawn, charts, start_s).encode(), SHARED)
    return page, picture


def html_page(title: str, head: str, body: str, style_sheet: str, *, after: str = "") -> str:
    """Return a self-contained HTML page.

    Parameters
    ----------
    title : str
        Title as plain text, and the heading, too.
    head, body : str
        HTML below the heading, and HTML of the rest.
    style_sheet : str
        CSS.
    after : str
        HTML behind the visible content.
    """
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{in_page(title)}</title>
<style>{style_sheet}</style>
</head>
<body>
<main>
<header>
<h1>{in_page(title)}</h1>
{head}
</header>
{body}
</main>
{after}</body>
</html>
"""


def _page(
    mission: MissionConfig,
    record: FlightRecord,
    picture: bytes,
    charts: list[tuple[str, str]],
    start_s: float,
) -> str:
    title = f"Flight report: {mission.name}"
    image = base64.b64encode(picture).decode("ascii")
    figures = "\n".join(
        f"<figure><div>{svg}</div><figcaption>{in_page(text)}</figcaption></figure>" for svg, text in charts
    )
    head = f"""<p class="lead">{in_page(_lead(mission, record, start_s))}</p>
{f'<p class="lead">{in_page(record.note)}</p>' if record.note else ""}"""
    body = f"""<h2>Summary</h2>
{_summary(record)}
<h2>Threats</h2>
{encounter_table(record, start_s)}
<h2>Map</h2>
<figure>
<div><img src="data:image/png;base64,{image}"
 alt="{in_page(_map_text(mission, record))}"></div>
<figcaption>{in_page(_map_caption(mission))}</figcaption>
</figure>
<h2>Over the flight</h2>
{figures}
<h2>Who flew</h2>
{who_flew_table(record.decisions, _end_s(record), start_s)}
<h2>Decisions</h2>
{_decisions(record, start_s)}"""
    return html_page(title, head, body, STYLE_SHEET)


def _lead(mission: MissionConfig, record: FlightRecord, start_s: float) -> str:
    flown_s = float(record.flown[-1, 0]) - start_s if len(record.flown) else 0.0
    sentence = (
        f"{style.clock_text(flown_s)} flown, {len(record.missions)} missions uploaded, "
        f"{len(record.plan_ms)} plans."
    )
    over_ground = flown_over_ground(mission, record.flown)
    if len(over_ground):
        at, height = lowest_over_ground(over_ground[:, 1], over_ground[:, 2])
        when = style.clock_text(float(over_ground[at, 0]) - start_s)
        sentence += f" Lowest: {height:.0f} m over ground, at {when}."
    gaps = [gap for entry in record.decisions if isinstance(gap := entry.why.get("gap"), float)]
    if gaps:
        most = math.ceil(100.0 * statistics.median(gaps))
        sentence += f" A plan costs at most {most} % more than the best there can be (median)."
    return f"{mission.description}. {sentence}" if mission.description else sentence


def _map_text(mission: MissionConfig, record: FlightRecord) -> str:
    return (
        f"Map of {mission.name}, north up: {len(mission.obstacles)} obstacles, {len(mission.radars)} radars "
        f"with the threat they cast, {len(record.dt_paths) or len(record.dt_tracks)} moving threats with "
        f"their paths, {len(record.missions)} uploaded missions, the flown path from start to where the "
        "record ends, and the goals."
    )


def _map_caption(mission: MissionConfig) -> str:
    text = (
        "Times on the paths are minutes and seconds of flight; equal times on two paths are the same moment."
    )
    if mission.dimension == 3:
        text += " The threat is cut at the median height flown; figures in obstacles are their tops [m]."
    if mission.terrain is not None:
        text += " Contours are heights of the ground above the origin [m]."
    return text


def _summary(record: FlightRecord) -> str:
    """Summary as a few tables side by side, so that it is read without scrolling."""
    rows = [
        f'<tr><th scope="row">{in_page(_key_text(key))}</th><td>{_value(key, value)}</td></tr>'
        for key, value in record.summary.items()
    ]
    if not rows:
        return "<p>Nothing was summed up.</p>"
    size = math.ceil(len(rows) / min(3, math.ceil(len(rows) / 3)))
    parts = [rows[first : first + size] for first in range(0, len(rows), size)]
    tables = "\n".join(f"<table><tbody>{''.join(part)}</tbody></table>" for part in parts)
    return f'<div class="summary">{tables}</div>'


def _key_text(key: str) -> str:
    """Return a key as words, without its unit."""
    suffix = next((ending for ending, _ in UNITS if key.endswith(ending)), "")
    return key.removesuffix(suffix).replace("_", " ").strip() or key


def _value(key: str, value: float | int | bool | str) -> str:
    """Return a value with its unit, as HTML."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return in_page(value)
    unit = next((f" {name}" for ending, name in UNITS if key.endswith(ending)), "")
    if isinstance(value, int):
        return f"{value}{unit}"
    return f"{style.number_text(value)}{unit if math.isfinite(value) else ''}"


def _end_s(record: FlightRecord) -> float:
    """Return when the recording ended, as far as that is known [s]."""
    flown = float(record.flown[-1, 0]) if len(record.flown) else 0.0
    return max([flown, *(entry.stamp_s for entry in record.decisions[-1:])])


def _decisions(record: FlightRecord, start_s: float) -> str:
    decisions = record.decisions
    if not decisions:
        return "<p>No decision was recorded.</p>"
    rows = "\n".join(_decision_row(record, entry, start_s) for entry in decisions)
    return f"""<div class="scroll" tabindex="0" role="region" aria-label="Decisions">
<table>
<thead><tr>
<th scope="col" class="number">Time [mm:ss]</th><th scope="col" class="number">UTC</th>
<th scope="col">Kind</th><th scope="col">Decision</th><th scope="col">Why</th>
<th scope="col" class="number">Plan [ms]</th><th scope="col" class="number">Track to mission [ms]</th>
</tr></thead>
<tbody>
{rows}
</tbody>
</table>
</div>"""


def _decision_row(record: FlightRecord, entry: Decision, start_s: float) -> str:
    head, state = decision_words(entry.kind)
    return (
        f'<tr><td class="number">{style.clock_text(entry.stamp_s - start_s)}</td>'
        f'<td class="number">{style.day_time_text(record.epoch_s, entry.stamp_s)}</td>'
        f'<td class="kind" data-state="{state}">{in_page(head)}</td>'
        f'<td class="text">{in_page(entry.text)}</td><td class="text why">{_why(entry)}</td>'
        f'<td class="number">{_milliseconds(entry.plan_ms)}</td>'
        f'<td class="number">{_milliseconds(entry.track_to_mission_ms)}</td></tr>'
    )


def _why(decision: Decision) -> str:
    """Return why a plan was made, and the numbers behind its decision."""
    why = dict(decision.why)
    parts = [in_page(why.pop("occasion"))] if "occasion" in why else []
    for key, value in why.items():
        if isinstance(value, list):
            parts += [in_page(entry) for entry in value]
        elif isinstance(value, bool | int | float | str):
            parts.append(f"{in_page(_key_text(key))} {_value(key, value)}")
    return "; ".join(parts) or "–"


def _milliseconds(value: float | None) -> str:
    return "–" if value is None or not math.isfinite(value) else f"{value:.0f}"
