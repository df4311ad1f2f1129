"""Runs all checks of ``companion doctor``, first of this computer and then of the link, and shows them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

from companion.clock import WallClock
from companion.config import MissionConfig, load_mission, require_own_system
from companion.errors import LinkError
from companion.link.wire.transport import transport_from_url
from companion.plain_text import printable
from companion.service.doctor.finding import Finding, Verdict, fail
from companion.service.doctor.host_checks import SERIAL_PORT, local_findings
from companion.service.doctor.link_checks import LinkDoctor
from companion.service.process.signing_setup import signing_of

EXIT_FAILED = 1
COLOURS = {Verdict.OK: "green", Verdict.WARN: "yellow", Verdict.FAIL: "red"}


async def run_checks(
    file: Path | None, url: str | None, seconds: float, flights: Path
) -> tuple[list[Finding], int]:
    """Run all checks.

    Returns
    -------
    list of Finding
        All findings, in the order of the checks.
    int
        Exit code: 0, 1 for a failure, 3 without an autopilot.

    Raises
    ------
    CompanionError
        If the mission file or the URL cannot be used.
    """
    clock = WallClock()
    mission = None if file is None else _mission_to_serve(file)
    transport = None if url is None else transport_from_url(url, clock)
    findings = local_findings(mission, url, flights)
    is_silent = False
    if transport is not None and url is not None:
        signer = None if mission is None or _has_failed(findings) else signing_of(mission, None)[1]
        doctor = LinkDoctor(transport, clock, url, mission, signer)
        try:
            if not _has_failed(entry for entry in findings if entry.check == SERIAL_PORT):
                findings += await doctor.examine(seconds)
        except LinkError as error:
            advice = "end what listens there, the service perhaps, or name another"
            findings.append(fail("link", str(error), advice))
        is_silent = not doctor.is_received
    if is_silent:
        return findings, LinkError.exit_code
    return findings, EXIT_FAILED * _has_failed(findings)


def _mission_to_serve(file: Path) -> MissionConfig:
    mission = load_mission(file)
    require_own_system(mission, str(file))
    return mission


def _has_failed(findings: Iterable[Finding]) -> bool:
    return any(entry.verdict is Verdict.FAIL for entry in findings)


def findings_table(findings: Sequence[Finding]) -> Table:
    """Return a table of the findings with advice."""
    table = Table(title="doctor")
    for name in ("", "check", "found", "what to do"):
        table.add_column(name, overflow="fold")
    for entry in findings:
        colour = COLOURS[entry.verdict]
        words = (Text(printable(words)) for words in (entry.check, entry.found, entry.advice))
        table.add_row(Text(entry.verdict.value, style=colour), *words)
    return table
