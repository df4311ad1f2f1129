"""Reads the autopilot parameters that determine how it flies, a few per second, and notices changes."""

from __future__ import annotations

import math
from dataclasses import replace

from companion.link.messages.codec import Codec
from companion.link.wire.decoded_frame import AutopilotVersion, DecodedFrame, ParameterValue
from companion.types.events import Dialect
from companion.types.mavlink_enums import MessageId
from companion.types.state import BY_RETURN_PATH, STRAIGHT_HOME, AutopilotSettings

ASKED_AT_ONCE = 33  # All of an autopilot; one whose buffer is smaller is asked again for the rest.
TRIES = 5  # An autopilot of another version may not have the parameter.
AGAIN_CALLS = 5  # Once all parameters are known, every fifth call of `due` requests one again.


class SettingsReader:
    """Keeps the autopilot's settings up to date.

    Attributes
    ----------
    settings : AutopilotSettings
        Settings received so far.
    """

    def __init__(self) -> None:
        self.settings = AutopilotSettings()
        self._dialect: Dialect | None = None
        self._meanings: dict[str, str] = {}
        self._num_asked: dict[str, int] = {}
        self._known: list[str] = []
        self._calls = 0
        self._version: tuple[int, int, int] | None = None
        self._num_versions_asked = 0

    def begin(self, dialect: Dialect) -> None:
        """Begin with this autopilot; forget the settings of an earlier one."""
        self.settings, self._dialect = AutopilotSettings(), dialect
        names = (*dialect.parameter_names.items(), *dialect.former_parameter_names.items())
        self._meanings = {name: meaning for meaning, name in names}
        self._num_asked = dict.fromkeys(self._meanings, 0)
        self._known = []
        self._version, self._num_versions_asked = None, 0

    def note(self, frame: DecodedFrame) -> None:
        """Take a frame of the autopilot."""
        reply = frame.reply
        if isinstance(reply, AutopilotVersion):
            self._version = reply.numbers
            self.settings = self._as_flown(self.settings)
        if not isinstance(reply, ParameterValue) or self._dialect is None:
            return
        meaning = self._meanings.get(reply.name)
        value = reply.number(is_bytewise=self._dialect.packs_parameters_bytewise)
        if meaning is None or not math.isfinite(value):
            return
        for name, meant in self._meanings.items():
            if meant == meaning:
                self._num_asked.pop(name, None)
        if reply.name not in self._known:
            self._known.append(reply.name)
        self.settings = self._as_flown(replace(self.settings, **{meaning: value}))

    def _as_flown(self, settings: AutopilotSettings) -> AutopilotSettings:
        """Return settings with the kind of return that the autopilot's version flies."""
        is_known = self._dialect is None or self._dialect.knows_return_paths(self._version)
        if settings.return_kind == BY_RETURN_PATH and not is_known:
            return replace(settings, return_kind=STRAIGHT_HOME)
        return settings

    def due(self, codec: Codec) -> bytes:
        """Return the requests to send now; called about once a second."""
        self._calls += 1
        left = [name for name in self._num_asked if self._num_asked[name] < TRIES]
        left.sort(key=self._num_asked.__getitem__)
        names = left[:ASKED_AT_ONCE]
        for name in names:
            self._num_asked[name] += 1
        if not names and self._known and self._calls % AGAIN_CALLS == 0:
            self._known.append(self._known.pop(0))
            names = self._known[-1:]
        requests = [codec.parameter_request(name) for name in names]
        if self._dialect is not None and self._version is None and self._num_versions_asked < TRIES:
            self._num_versions_asked += 1
            requests.append(codec.request_message(MessageId.AUTOPILOT_VERSION))
        return b"".join(requests)
