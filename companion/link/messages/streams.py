"""Which messages and parameters the autopilot is asked for, at which rate, and when it is asked again.

A request may be lost, refused, or forgotten by an autopilot that rebooted; so what counts is what
arrives. Without any I/O: the caller passes frames and time in, and sends what ``due`` returns.
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


@dataclass(slots=True)
class _Stream:
    rate_hz: float
    is_vital: bool
    received_s: float
    asked_s: float | None = None

    def ask(self, now_s: float) -> None:
        self.asked_s = now_s

    def hear(self, now_s: float) -> None:
        self.received_s = now_s

    def is_due(self, now_s: float) -> bool:
        if self.asked_s is None:
            return True
        if not self.is_vital or now_s - self.asked_s < _ASK_AGAIN_S:
            return False
        return now_s - self.received_s > max(_LATE_PERIODS / self.rate_hz, _FIRST_WAIT_S)


class Streams:
    """Keeps the wanted messages coming.

    Parameters
    ----------
    rate_hz : float
        Rate at which positions are asked for [Hz]; what changes slower is asked for more rarely.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._reader = SettingsReader()
        self._streams: dict[int, _Stream] = {}
        self._autopilot: Dialect | None = None

    @property
    def missing(self) -> tuple[int, ...]:
        """Vital messages asked for and not heard since, for the health report."""
        return tuple(
            number
            for number, stream in self._streams.items()
            if stream.is_vital and stream.asked_s is not None and stream.received_s <= stream.asked_s
        )

    @property
    def settings(self) -> AutopilotSettings:
        """What the autopilot has told of how it flies."""
        return self._reader.settings

    @property
    def wanted(self) -> dict[int, float]:
        """Rates that the vital messages are asked for at [Hz]."""
        return {number: stream.rate_hz for number, stream in self._streams.items() if stream.is_vital}

    def note(self, frame: DecodedFrame, stamp_s: float) -> None:
        """Take note of a frame of the vehicle's; what others send says nothing of its streams."""
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
            stream.hear(stamp_s)

    def due(self, codec: Codec, now_s: float) -> bytes:
        """Return the requests to send now; call it about once a second."""
        requests = []
        for number, stream in self._streams.items():
            if stream.is_due(now_s):
                stream.ask(now_s)
                requests.append(codec.set_message_interval(number, stream.rate_hz))
                if (
                    number == MessageId.HOME_POSITION
                ):  # It is sent on change only, so an interval is not enough.
                    requests.append(codec.request_message(MessageId.HOME_POSITION))
        return b"".join(requests) + self._reader.due(codec)

    def _wanted(self, dialect: Dialect, now_s: float) -> dict[int, _Stream]:
        fast, slow = self._rate_hz, 1.0
        wind = MessageId.WIND_COV if dialect.tells_covariances else MessageId.WIND
        rates = {
            MessageId.GLOBAL_POSITION_INT: (fast, True),
            MessageId.ATTITUDE: (fast, False),
            MessageId.VFR_HUD: (min(fast, 5.0), True),
            MessageId.MISSION_CURRENT: (min(fast, 5.0), True),
            wind: (slow, False),
            MessageId.EXTENDED_SYS_STATE: (slow, False),
            MessageId.GPS_RAW_INT: (slow, False),
            MessageId.SCALED_PRESSURE: (0.2, False),
            MessageId.HOME_POSITION: (0.5, False),
            MessageId.ADSB_VEHICLE: (min(fast, 5.0), False),
        }
        health = MessageId.ESTIMATOR_STATUS if dialect.tells_covariances else MessageId.EKF_STATUS_REPORT
        rates[health] = (slow, False)
        return {number: _Stream(rate, is_vital, now_s) for number, (rate, is_vital) in rates.items()}
