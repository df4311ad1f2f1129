"""Requests of messages and parameters from the autopilot, at their rates, repeated where needed.

A request may be lost, refused or forgotten by a rebooted autopilot. Therefore a request is repeated if the
message does not arrive. There is no I/O: the caller passes in frames and time, and sends what ``due``
returns.
"""

from __future__ import annotations

from dataclasses import dataclass

from companion.link.messages.codec import Codec
from companion.link.messages.settings_reader import SettingsReader
from companion.link.wire.decoded_frame import DecodedFrame
from companion.types.events import Dialect, Heartbeat, Rebooted
from companion.types.mavlink_enums import ComponentId, MessageId
from companion.types.state import AutopilotSettings

_ASK_AGAIN_S = 5.0
_FIRST_WAIT_S = 2.0
_LATE_PERIODS = 5.0
_BATTERY_HZ = 0.5
_GROUND_HZ = 1.0


@dataclass(slots=True)
class _Stream:
    rate_hz: float
    is_vital: bool
    received_s: float
    requested_s: float | None = None

    def note_requested(self, now_s: float) -> None:
        self.requested_s = now_s

    def note_received(self, now_s: float) -> None:
        self.received_s = now_s

    def is_due(self, now_s: float) -> bool:
        if self.requested_s is None:
            return True
        if not self.is_vital or now_s - self.requested_s < _ASK_AGAIN_S:
            return False
        return now_s - self.received_s > max(_LATE_PERIODS / self.rate_hz, _FIRST_WAIT_S)


class Streams:
    """Keeps the required messages arriving.

    Parameters
    ----------
    rate_hz : float
        Requested rate of positions [Hz]; messages that change more slowly are requested at lower rates.
    with_battery : bool
        Whether the messages of the battery monitor are requested, too.
    with_ground : bool
        Whether the messages about the ground below the aircraft are requested, too.
    with_clock : bool
        Whether the autopilot's UTC time is requested, too.
    """

    def __init__(
        self, rate_hz: float, *, with_battery: bool = False, with_ground: bool = False,
        with_clock: bool = False,
    ) -> None:  # fmt: skip
        self._with_clock = with_clock
        self._rate_hz = rate_hz
        self._with_ground = with_ground
        self._with_battery = with_battery
        self._reader = SettingsReader()
        self._streams: dict[int, _Stream] = {}
        self._autopilot: Dialect | None = None

    @property
    def missing(self) -> tuple[int, ...]:
        """Vital messages that were requested and have not arrived since, for the health report."""
        return tuple(
            number
            for number, stream in self._streams.items()
            if stream.is_vital and stream.requested_s is not None and stream.received_s <= stream.requested_s
        )

    @property
    def settings(self) -> AutopilotSettings:
        """Autopilot settings received so far."""
        return self._reader.settings

    @property
    def wanted(self) -> dict[int, float]:
        """Requested rates of the vital messages [Hz]."""
        return {number: stream.rate_hz for number, stream in self._streams.items() if stream.is_vital}

    def note(self, frame: DecodedFrame, stamp_s: float) -> None:
        """Take a frame of the vehicle; only frames of its autopilot count."""
        for event in frame.events:
            if isinstance(event, Heartbeat) and event.dialect is not self._autopilot:
                self._autopilot = event.dialect
                self._streams = self._wanted(event.dialect, stamp_s)
                self._reader.begin(event.dialect)
            elif isinstance(event, Rebooted) and self._autopilot is not None:
                self._streams = self._wanted(self._autopilot, stamp_s)
        stream = self._streams.get(frame.message_id)
        if frame.component_id != ComponentId.AUTOPILOT1:
            return
        self._reader.note(frame)
        if stream is not None:
            stream.note_received(stamp_s)

    def due(self, codec: Codec, now_s: float) -> bytes:
        """Return the requests to send now; call it about once a second."""
        requests = []
        for number, stream in self._streams.items():
            if stream.is_due(now_s):
                stream.note_requested(now_s)
                requests.append(codec.set_message_interval(number, stream.rate_hz))
                if (
                    number == MessageId.HOME_POSITION
                ):  # It is sent on change only, so an interval is not enough.
                    requests.append(codec.request_message(MessageId.HOME_POSITION))
        return b"".join(requests) + self._reader.due(codec)

    def _wanted(self, dialect: Dialect, now_s: float) -> dict[int, _Stream]:
        fast, slow = self._rate_hz, 1.0
        wind = MessageId.WIND_COV if dialect.sends_covariances else MessageId.WIND
        rates = {
            MessageId.GLOBAL_POSITION_INT: (fast, True),
            MessageId.ATTITUDE: (fast, False),
            MessageId.VFR_HUD: (min(fast, 5.0), True),
            MessageId.MISSION_CURRENT: (min(fast, 5.0), True),
            wind: (slow, False),
            MessageId.EXTENDED_SYS_STATE: (slow, False),
            MessageId.POSITION_TARGET_GLOBAL_INT: (min(fast, 2.0), False),
            MessageId.GPS_RAW_INT: (slow, False),
            MessageId.SCALED_PRESSURE: (0.2, False),
            MessageId.HOME_POSITION: (0.5, False),
            MessageId.ADSB_VEHICLE: (min(fast, 5.0), False),
        }
        health = MessageId.ESTIMATOR_STATUS if dialect.sends_covariances else MessageId.EKF_STATUS_REPORT
        rates[health] = (slow, False)
        if not dialect.sends_covariances:
            rates[MessageId.ESC_TELEMETRY_1_TO_4] = (min(fast, 2.0), False)
        if self._with_battery:
            rates |= dict.fromkeys((MessageId.BATTERY_STATUS, MessageId.SYS_STATUS), (_BATTERY_HZ, False))
        if self._with_ground:
            stored = MessageId.ALTITUDE if dialect.sends_covariances else MessageId.TERRAIN_REPORT
            rates |= dict.fromkeys((stored, MessageId.DISTANCE_SENSOR), (_GROUND_HZ, False))
        if self._with_clock:
            rates[MessageId.SYSTEM_TIME] = (slow, False)
        return {number: _Stream(rate, is_vital, now_s) for number, (rate, is_vital) in rates.items()}
