"""The vehicle's link: frames in and out, requests, answers and their recording."""

from __future__ import annotations

from collections.abc import Callable

from companion.clock import Clock
from companion.config import MissionConfig
from companion.flight.messages.observer import Observer
from companion.flight.messages.send_budgets import SendBudgets
from companion.link.messages.codec import Codec
from companion.link.messages.component import ParameterStore
from companion.link.messages.streams import Streams
from companion.link.missions.autopilot_link import AutopilotLink
from companion.link.wire.framing import frames_in
from companion.link.wire.link_quality import LinkQuality
from companion.link.wire.signing import Signer
from companion.link.wire.source_limits import SourceLimits
from companion.link.wire.transport import Address, Transport, dropped
from companion.recording.recorder import Recorder
from companion.types.events import Event, SettingsReported

LinkKind = Callable[[Codec, Clock, Callable[[bytes], None]], AutopilotLink]


class VehicleLink:
    """The link to one vehicle.

    Parameters
    ----------
    mission : MissionConfig
        The mission file, for its section ``link``.
    transport : Transport
        The transport to the autopilot.
    clock : Clock
        The service's clock.
    recorder : Recorder
        Records every frame of both directions.
    signer : Signer, optional
        Signs what is sent and verifies what is received.
    link_kind : callable
        Makes the object that carries out mission transfers, with the signature of ``AutopilotLink``. Tests
        use one with simulated time, and a replay one that continues if the recorded autopilot does not
        answer.
    observer : Observer, optional
        Is notified of progress in an exchange with the autopilot.

    Attributes
    ----------
    codec : Codec
        Converts frames to events, and messages to bytes.
    autopilot : AutopilotLink
        Calls that the autopilot answers.
    streams : Streams
        The messages that the autopilot is asked for.
    quality : LinkQuality
        The share of the autopilot's frames that arrive.
    members : tuple of int
        System ids of the members of a team.
    """

    def __init__(
        self,
        mission: MissionConfig,
        transport: Transport,
        clock: Clock,
        recorder: Recorder,
        *,
        signer: Signer | None = None,
        link_kind: LinkKind = AutopilotLink,
        observer: Observer | None = None,
    ) -> None:
        settings = mission.link
        limits = SourceLimits(float(settings.source_rate_max_hz), settings.systems)
        self.codec = Codec(settings.vehicle_system_id, settings.track_sources, signer=signer, limits=limits)
        self.transport = transport
        self.streams = Streams(
            float(settings.stream_rate_hz),
            with_battery=mission.energy is not None,
            with_ground=mission.terrain is not None,
            with_clock=mission.team is not None,
        )
        self.quality = LinkQuality()
        self.members = mission.team_members
        self._clock = clock
        self._recorder = recorder
        self._observer = observer or Observer()
        self._take: Callable[[Event, float], None] = _ignore
        self._budgets = SendBudgets(self.codec, transport.bytes_per_s, mission)
        self.autopilot = link_kind(self.codec, clock, self.send)

    @property
    def has_received(self) -> bool:
        """Whether the vehicle has been received."""
        return self.autopilot.dialect is not None

    @property
    def knows_autopilot(self) -> bool:
        """Whether the vehicle has been received, or an autopilot whose next heartbeat confirms it."""
        return self.has_received or self.codec.identity.has_candidate

    async def open(self, take: Callable[[Event, float], None], parameters: ParameterStore) -> None:
        """Open the transport.

        Parameters
        ----------
        take : callable
            Receives each event with its time of arrival by the clock [s].
        parameters : ParameterStore
            The parameters that others may request or set.
        """
        self._take = take
        self._budgets.begin(parameters)
        self.transport.set_receiver(self.receive)
        await self.transport.open()

    def receive(self, data: bytes, address: Address | None = None) -> None:
        """Process received bytes: record, pass on and answer each frame, then deliver its events."""
        now_s, peer = self._clock.now_s(), self.codec.identity.peer
        had_autopilot, had_received = self.knows_autopilot, self.has_received
        frames = self.codec.feed(data, now_s, address)
        if (now_at := self.codec.identity.peer) is not None and now_at != peer:
            self.transport.answer_to(now_at)
        for frame in frames:
            self._recorder.frame(now_s, frame.raw)
            settings = self.streams.settings
            if self.codec.identity.is_autopilot(frame.system_id, frame.component_id):
                self.streams.note(frame, now_s)
                self.quality.note(frame.raw)
            self.autopilot.receive(frame)
            if self.autopilot.is_part_of_exchange(frame):
                self._observer.progress()
            self.send(self._budgets.answer(frame, now_s))
            for event in frame.events:
                self._take(event, now_s)
            if self.streams.settings != settings:
                self._take(SettingsReported(now_s, self.streams.settings), now_s)
        if self.knows_autopilot and not had_autopilot:
            self._observer.received()
        if self.has_received and not had_received:
            self.send(self.streams.due(self.codec, now_s))

    def send(self, data: bytes) -> None:
        """Send packed frames, signed if there is a key, and record them."""
        if self.transport.is_open and data:
            data = self.codec.signed(data)
            self.transport.send(data)
            for raw in frames_in(data):
                self._recorder.frame(self._clock.now_s(), raw)

    def tell(self, severity: int, text: str) -> None:
        """Send the pilot a text with a MAV_SEVERITY; nothing is sent before the vehicle is received."""
        if self.has_received:
            self.send(self._budgets.text(severity, text, self._clock.now_s()))

    def keep_up(self, now_s: float, state: int) -> None:
        """Send what is due every second: the heartbeat with its MAV_STATE, and requests for streams."""
        if self.has_received:
            self.send(self.codec.heartbeat(state))
            self.send(self.streams.due(self.codec, now_s))

    def status(self) -> dict[str, object]:
        """Return the state of the link for the recording."""
        dialect = self.autopilot.dialect
        return {
            "dialect": None if dialect is None else dialect.value,
            "vehicle_system_id": self.codec.vehicle_system_id,
            "counters": {**self.codec.counters, **self.autopilot.counters},
            "missing_streams": self.streams.missing,
        }

    async def close(self) -> None:
        """End the calls under way, and detach from the transport, which its owner closes."""
        await self.autopilot.close()
        self.transport.set_receiver(dropped)


def _ignore(event: Event, now_s: float) -> None:
    """Ignore events before the link is opened."""
