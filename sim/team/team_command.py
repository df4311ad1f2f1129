"""``companion sitl --aircraft N``: a flight of a team, with a table, a picture and recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from companion.config import MissionConfig
from companion.config.compose import world_of
from companion.ui.reports import style
from companion.ui.reports.basemap import new_sheet
from .team_flight import TeamFlight, fly_team

COLOURS = ("#0057b8", "#c8102e", "#00843d", "#ff8200", "#6a1b9a", "#00a3ad", "#8d6e63", "#5d737e")


def fly_and_show(team: TeamFlight, console: Console) -> bool:
    """Fly a team, print its table and draw its picture; return whether all arrived apart and unhurt.

    Parameters
    ----------
    team : TeamFlight
        The team, before its flight.
    console : Console
        Where the table goes.
    """
    fly_team(team)
    console.print(_table(team))
    if team.folder is not None:
        picture = team.folder / "team.png"
        draw_team(picture, team.mission, team)
        console.print(f"picture: {picture}\nrecordings: {team.folder}/*/flight.tlog", markup=False)
    return team.is_separate and not team.hit_s and len(team.arrived_s) == len(team.flights)


def _table(team: TeamFlight) -> Table:
    """Return the members, and which two were nearest."""
    summary = team.summary()
    words = "apart" if summary["is_separate"] else "TOO CLOSE"
    table = Table(
        title=f"{team.mission.name}, {len(team.flights)} aircraft, seed {team.seed}: {words}",
        caption=f"nearest: {summary['nearest_m']} m and {summary['nearest_up_m']} m of height, "
        f"at {summary['nearest_at_s']} s",
    )
    for head in ("system", "arrived [s]", "missions flown", "not entered", "plans", "team messages [B/s]"):
        table.add_column(head, justify="right")
    rates = [
        sent / max(flight.now_s, 1.0)
        for sent, flight in zip(team.radio.bytes_sent, team.flights, strict=True)
    ]
    for number, (flight, rate) in enumerate(zip(team.flights, rates, strict=True), 1):
        arrived = f"{team.arrived_s[number]:.0f}" if number in team.arrived_s else "never"
        flown, refused = flight.app.num_swaps, flight.recorder.num_rejected
        table.add_row(
            str(number), arrived, str(flown), str(refused), str(len(flight.recorder.plan_ms)), f"{rate:.0f}"
        )
    return table


def draw_team(path: Path, mission: MissionConfig, team: TeamFlight) -> None:
    """Draw the flown paths of all members, and where the two nearest were then, as a PNG.

    Parameters
    ----------
    path : Path
        The picture's file.
    mission : MissionConfig
        The mission, whose obstacles are drawn.
    team : TeamFlight
        The team after its flight.
    """
    with style.drawing():
        sheet = new_sheet(mission, world_of(mission), float(mission.start.up_m), f"{mission.name}: a team")
        pair, (flat, up, at_s) = min(team.least_m.items(), key=lambda item: item[1][0])
        for number, flight in enumerate(team.flights, 1):
            rows, colour = np.array(flight.simulator.truth.path), COLOURS[(number - 1) % len(COLOURS)]
            sheet.axes.plot(rows[:, 1], rows[:, 2], color=colour, lw=2.0, zorder=8)
            sheet.axes.plot(rows[0, 1], rows[0, 2], "o", color=colour, ms=7, zorder=9)
            goal = flight.mission.goals[-1]
            sheet.axes.plot(goal.east_m, goal.north_m, "*", color=colour, ms=13, zorder=9)
            sheet.entry(f"system {number}", color=colour, lw=2.0)
            if number in pair:
                then = rows[np.searchsorted(rows[:, 0], at_s).clip(max=len(rows) - 1)]
                sheet.axes.plot(then[1], then[2], "D", mfc="white", mec=colour, ms=8, mew=2.0, zorder=10)
        words = f"nearest: {flat:.0f} m, {up:.0f} m of height"
        sheet.entry(words, ls="", marker="D", markerfacecolor="white", markeredgecolor="black")
        sheet.finish()
        style.write_picture(path, sheet.figure)
