"""Reads the parameters that say how the autopilot flies, a few a second, and notes when one is changed."""

from __future__ import annotations

import math
from dataclasses import replace

from companion.link.messages.codec import Codec
from companion.link.wire.decoded_frame import DecodedFrame, ParameterTold
from companion.types.events import Dialect
from companion.types.state import AutopilotSettings

ASKED_AT_ONCE = 4
TRIES = 5  # an autopilot of another version may have no parameter of that name
AGAIN_CALLS = 5  # calls of :meth:`SettingsReader.due` between two that ask again for what is known


class SettingsReader:
    """Keeps the settings up to date.

    Attributes
    ----------
    settings : AutopilotSettings
        What was told so far.
    """

    def __init__(self) -> None:
        self.settings = AutopilotSettings()
        self._dialect: Dialect | None = None
        self._meanings: dict[str, str] = {}
        self._num_asked: dict[str, int] = {}
        self._known: list[str] = []
        self._calls = 0

    def begin(self, dialect: Dialect) -> None:
        """Ask this autopilot from now on; what another one told is forgotten."""
        self.settings, self._dialect = AutopilotSettings(), dialect
        self._meanings = {name: meaning for meaning, name in dialect.parameter_names.items()}
        self._num_asked = dict.fromkeys(self._meanings, 0)
        self._known = []

    def note(self, frame: DecodedFrame) -> None:
        """Take note of a frame of the autopilot's."""
        told = frame.reply
        if not isinstance(told, ParameterTold) or self._dialect is None:
            return
        meaning = self._meanings.get(told.name)
        value = told.number(is_bytewise=self._dialect.packs_parameters_bytewise)
        if meaning is None or not math.isfinite(value):
            return
        self._num_asked.pop(told.name, None)
        if told.name not in self._known:
            self._known.append(told.name)
        self.settings = replace(self.settings, **{meaning: value})

    def due(self, codec: Codec) -> bytes:
        """The questions to send now; called about once a second."""
        self._calls += 1
        names = [name for name, count in self._num_asked.items() if count < TRIES][:ASKED_AT_ONCE]
        for name in names:
            self._num_asked[name] += 1
        if not names and self._known and self._calls % AGAIN_CALLS == 0:
            self._known.append(self._known.pop(0))
            names = self._known[-1:]
        return b"".join(codec.parameter_question(name) for name in names)
