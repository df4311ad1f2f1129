"""Checks of the autopilot's mission list with a mission file, as the service does them on the ground."""

from __future__ import annotations

from collections.abc import Callable

from companion.clock import Clock
from companion.config import MissionConfig
from companion.errors import CompanionError
from companion.flight.exchange.list_reader import adopt
from companion.flight.exchange.protocols import protocols_for
from companion.flight.messages.operator_summary import operator_summary_of
from companion.flight.state.flight_state import (
    StateOwner,
    after_autopilot_known,
    after_settings_reported,
    first_state,
)
from companion.flight.takeover.capability import shortfalls
from companion.link.messages.codec import Codec
from companion.link.missions.autopilot_link import AutopilotLink
from companion.link.wire.decoded_frame import DecodedFrame
from companion.service.doctor.finding import Finding, fail, ok, warn
from companion.tracking.ownship import OwnshipEstimator
from companion.types.mission import MissionItem
from companion.types.state import AutopilotSettings

CHECK = "mission"


class MissionDoctor:
    """Reads and checks the autopilot's list.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    codec : Codec
        Codec of the link.
    clock : Clock
        Clock of the doctor.
    send : callable
        Passes bytes to the transport.

    Attributes
    ----------
    goals : tuple of GoalRegion
        The mission file's goals; once the list was read, the operator's waypoints if those are the goals.
    """

    def __init__(
        self, mission: MissionConfig, codec: Codec, clock: Clock, send: Callable[[bytes], None]
    ) -> None:
        self._mission, self._clock = mission, clock
        self._ownship = OwnshipEstimator(mission.frame)
        self._link = AutopilotLink(codec, clock, send)
        self.goals = first_state(mission, clock.now_s()).goals

    def receive(self, frame: DecodedFrame) -> None:
        """Take a frame of the autopilot."""
        self._link.receive(frame)
        for event in frame.events:
            self._ownship.observe(event)

    async def findings(self, settings: AutopilotSettings) -> list[Finding]:
        """Read the list and return the findings, given the autopilot's parameters."""
        try:
            read = await self._link.download()
        except CompanionError as error:
            return [warn(CHECK, f"not read: {error}", "try again; perhaps the ground station is uploading")]
        finally:
            await self._link.close()
        return self._judged(read, settings)

    def _judged(self, read: tuple[MissionItem, ...], settings: AutopilotSettings) -> list[Finding]:
        mission, now = self._mission, self._clock.now_s()
        flight = StateOwner(first_state(mission, now))
        protocols = protocols_for(flight, self._link, self._ownship, self._clock)
        flight.apply(after_autopilot_known, flies_by=protocols.dialect.flies_by)
        flight.apply(after_settings_reported, settings)
        adopt(flight, protocols, read)
        self.goals = flight.state.goals
        found = operator_summary_of(flight.state, self._ownship.state(now), protocols.dialect.num_home_items)
        returns = found.returns and f"a return to launch {found.returns}"
        texts = (
            (CHECK, found.plan), ("takeover", found.takeover), ("landing", found.landing),
            ("return", returns), ("ground", found.lowest),
        )  # fmt: skip
        findings = [ok(check, text) for check, text in texts if text]
        refused = shortfalls(mission, settings, flight.state.home_enu_m, flies_by=protocols.dialect.flies_by)
        for fault in found.faults:
            if fault in refused:
                advice = "change the mission file or the parameter: the service does not take over with it"
                findings.append(fail(CHECK, fault, advice))
            else:
                findings.append(warn(CHECK, fault, "change the list in the autopilot, or the mission file"))
        return findings
