"""Checks of the autopilot's link for ``companion doctor --link``."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

from companion.clock import Clock
from companion.config import MissionConfig
from companion.link.messages.codec import Codec
from companion.link.messages.streams import Streams
from companion.link.wire.decoded_frame import AutopilotVersion, ParameterValue
from companion.link.wire.link_quality import LinkQuality
from companion.link.wire.signing import Signer
from companion.link.wire.transport import Address, Transport
from companion.service.doctor.energy_checks import EnergyDoctor
from companion.service.doctor.failsafe_checks import failsafe_findings, failsafe_names
from companion.service.doctor.finding import Finding, fail, ok, warn
from companion.service.doctor.mission_checks import MissionDoctor
from companion.service.doctor.parameter_checks import (
    FAILSAFES,
    parameter_findings,
    parameter_names,
    return_findings,
    version,
)
from companion.types.events import Dialect, Heartbeat
from companion.types.mavlink_enums import MessageId

FIRST_HEARTBEAT_S = 10.0  # Time to wait for the first heartbeat.
REQUEST_INTERVAL_S = 0.5  # Interval of repeated requests.
REQUESTS_MAX_S = 6.0
SETTLE_S = 1.0  # Time until requested rates take effect.
PX4_CURRENT_HZ = 1.0  # PX4 sends MISSION_CURRENT at this rate, whatever rate is requested.
RATE_SHARE = 0.8
LOSS_WARN, LOSS_FAIL = 0.01, 0.1
RATE_HZ = 10.0


class LinkDoctor:
    """Receives, requests and checks.

    Parameters
    ----------
    transport : Transport
        Transport that :meth:`examine` opens and closes.
    clock : Clock
        Clock of the doctor.
    url : str
        URL of the transport, for the advice.
    mission : MissionConfig, optional
        Mission file, whose speeds and rates the autopilot should match.
    signer : Signer, optional
        Signs sent frames and verifies received ones, as in the service.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        url: str,
        mission: MissionConfig | None = None,
        signer: Signer | None = None,
    ) -> None:
        self.is_received = False
        self._transport = transport
        self._clock = clock
        self._url = url
        self._mission = mission
        named = None if mission is None else mission.link.vehicle_system_id
        self._codec = Codec(named, signer=signer)
        self._streams = Streams(
            RATE_HZ if mission is None else float(mission.link.stream_rate_hz),
            with_battery=mission is not None and mission.energy is not None,
            with_ground=mission is not None and mission.terrain is not None,
        )
        self._quality = LinkQuality()
        self._num_bytes = 0
        self._heartbeat: Heartbeat | None = None
        self._version: AutopilotVersion | None = None
        self._values: dict[str, ParameterValue] = {}
        self._counts: Counter[int] = Counter()
        self._of_mission = None if mission is None else MissionDoctor(mission, self._codec, clock, self._send)
        self._of_energy = None if mission is None else EnergyDoctor(mission)

    async def examine(self, seconds: float) -> list[Finding]:
        """Check the link, for about the given time after the first heartbeat.

        Raises
        ------
        LinkError
            If the address cannot be used.
        """
        self._transport.set_receiver(self._receive)
        await self._transport.open()
        try:
            await self._until(lambda: self._heartbeat is not None, FIRST_HEARTBEAT_S)
            if self._heartbeat is None:
                return [self._silence()]
            self.is_received = True
            dialect = self._heartbeat.dialect
            needed = parameter_names(dialect)
            names = needed + failsafe_names(FAILSAFES[dialect])  # An autopilot need not have each failsafe.
            await self._until(
                lambda: self._version is not None and self._values.keys() >= set(needed),
                REQUESTS_MAX_S,
                names,
            )
            await self._until(lambda: False, SETTLE_S)
            self._counts.clear()
            began = self._clock.now_s()
            await self._until(lambda: False, seconds)
            rates = self._rates(dialect, self._clock.now_s() - began)
            of_mission = await self._mission_findings()
        finally:
            await self._transport.close()
        values = {name: _number(parameter, dialect) for name, parameter in self._values.items()}
        return [
            version(dialect, self._version),
            self._loss(),
            *rates,
            *parameter_findings(dialect, values, self._mission, self._baud_rate()),
            *return_findings(dialect, values, self._version),
            *failsafe_findings(FAILSAFES[dialect], values),
            *of_mission,
        ]

    async def _mission_findings(self) -> list[Finding]:
        """Check the autopilot's list and the energy on board with the mission file, if there is one."""
        if self._of_mission is None or self._of_energy is None:
            return []
        findings = await self._of_mission.findings(self._streams.settings)
        return findings + self._of_energy.findings(self._of_mission.goals, self._clock.now_s())

    def _send(self, data: bytes) -> None:
        if self._transport.is_open:
            self._transport.send(self._codec.signed(data))

    def _receive(self, data: bytes, address: Address | None = None) -> None:
        now, identity = self._clock.now_s(), self._codec.identity
        self._num_bytes += len(data)
        for frame in self._codec.feed(data, now, address):
            if not identity.is_autopilot(frame.system_id, frame.component_id):
                continue
            if identity.peer is not None:
                self._transport.answer_to(identity.peer)
            self._streams.note(frame, now)
            if self._of_mission is not None:
                self._of_mission.receive(frame)
            self._quality.note(frame.raw)
            self._counts[frame.message_id] += 1
            for event in frame.events:
                if isinstance(event, Heartbeat):
                    self._heartbeat = event
                elif self._of_energy is not None:
                    self._of_energy.observe(event)
            if isinstance(frame.reply, AutopilotVersion):
                self._version = frame.reply
            elif isinstance(frame.reply, ParameterValue):
                self._values[frame.reply.name] = frame.reply

    async def _until(self, is_done: Callable[[], bool], seconds: float, names: tuple[str, ...] = ()) -> None:
        """Wait, and repeat requests for what is missing."""
        until = self._clock.now_s() + seconds
        while not is_done() and (now := self._clock.now_s()) < until:
            if self._heartbeat is not None and self._transport.is_open:
                questions = self._codec.heartbeat() + self._streams.due(self._codec, now)
                if names and self._version is None:
                    questions += self._codec.request_message(MessageId.AUTOPILOT_VERSION)
                for name in names:
                    if name not in self._values:
                        questions += self._codec.parameter_request(name)
                self._transport.send(self._codec.signed(questions))
            await self._clock.sleep_until(min(now + REQUEST_INTERVAL_S, until))

    def _silence(self) -> Finding:
        """Return why no autopilot is received."""
        check, counters = "link", self._codec.counters
        if self._transport.trouble:
            return fail(
                check, f"{self._url}: {self._transport.trouble}", "check the device, cable or address"
            )
        if self._num_bytes == 0:
            advice = {
                "serial": "is it powered, are RX and TX crossed, does SERIALn_PROTOCOL of that port say 2?",
                "udpin": "does the autopilot or its router send to this address and port?",
            }.get(self._url.partition("://")[0], "does a program listen at this address?")
            return fail(check, f"nothing comes from {self._url}", advice)
        if counters["accepted"] == 0 and counters["unsigned"] + counters["bad_signature"] == 0:
            found = f"{self._num_bytes} bytes came, and no message of MAVLink"
            is_serial = self._url.startswith("serial")
            advice = "the speed differs from the autopilot's: see SERIALn_BAUD"
            return fail(
                check, found, advice if is_serial else "another protocol is used there: check the address"
            )
        refused = ", ".join(f"{name} {number}" for name, number in sorted(counters.items()))
        return fail(check, f"messages came, and no autopilot's heartbeat ({refused})",
                    "is the autopilot behind a router that filters, or signed with another key?")  # fmt: skip

    def _loss(self) -> Finding:
        quality = self._quality
        found = f"{100.0 * quality.loss:.1f} % of {quality.received + quality.lost} messages lost"
        advice = "raise the speed, use flow control, shorten the cable, or ask for fewer messages"
        if quality.loss > LOSS_FAIL:
            return fail("link loss", found, advice)
        return warn("link loss", found, advice) if quality.loss > LOSS_WARN else ok("link loss", found)

    def _rates(self, dialect: Dialect, seconds: float) -> list[Finding]:
        findings = []
        for number, asked in self._streams.wanted.items():
            name, rate = MessageId(number).name, self._counts[number] / max(seconds, 1e-3)
            is_slow = number == MessageId.MISSION_CURRENT and dialect.tells_mission_slowly
            wanted = min(asked, PX4_CURRENT_HZ) if is_slow else asked
            found = f"{rate:.1f} Hz, {wanted:g} wanted"
            if rate >= RATE_SHARE * wanted:
                findings.append(ok(name, found))
            else:
                advice = "raise the line's speed, or lower link.stream_rate_hz and other streams' rates"
                findings.append((warn if rate > 0.0 else fail)(name, found, advice))
        return findings

    def _baud_rate(self) -> int | None:
        kind, _, rest = self._url.partition("://")
        return int(rest.rpartition(":")[2]) if kind == "serial" else None


def _number(parameter: ParameterValue, dialect: Dialect) -> float:
    """Return the value, as the autopilot's dialect encodes it."""
    value = parameter.number(is_bytewise=dialect.packs_parameters_bytewise)
    return value if math.isfinite(value) else math.nan
