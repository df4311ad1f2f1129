"""Budgets for what the service sends: answers to requests, and texts to the pilot."""

from __future__ import annotations

import math

from companion.config import MissionConfig
from companion.config.sections.terrain_map import served_heights_of
from companion.link.messages.codec import Codec
from companion.link.messages.component import ParameterStore, answer
from companion.link.messages.file_server import FileServer
from companion.link.messages.terrain_server import TerrainServer
from companion.link.wire.decoded_frame import DecodedFrame
from companion.token_bucket import TokenBucket, get_or_create

# Budgets of answers and of texts: a share of the line's capacity, if that is known, and never more than this.
ANSWER_BYTES_PER_S, TEXT_BYTES_PER_S = 2_000.0, 1_000.0
LINE_SHARE = 0.1  # Each budget is at most this share of the line's capacity.
SOURCE_SHARE = 0.5  # One source gets at most this share of the answers.
CHANGES_HZ = 2.0  # Parameter changes are limited to this rate, since each is announced, logged and applied.
BURST_S = 4.0  # A budget may be saved up for this time.
SOURCES_MAX = 64  # Budgets of at most this many sources are kept.


class SendBudgets:
    """Answers and texts, within their budgets.

    Parameters
    ----------
    codec : Codec
        The link's codec, which counts what is not sent as ``unanswered`` and ``untold``.
    line_bytes_per_s : float or None
        Capacity of the line; None if not known.
    mission : MissionConfig, optional
        If it has a map of heights, an autopilot that asks is answered.
    """

    def __init__(
        self, codec: Codec, line_bytes_per_s: float | None, mission: MissionConfig | None = None
    ) -> None:
        self._codec = codec
        heights = None if mission is None else served_heights_of(mission)
        self._terrain = None if heights is None else TerrainServer(heights)
        share_rate = math.inf if line_bytes_per_s is None else LINE_SHARE * line_bytes_per_s
        answer_rate, text_rate = min(ANSWER_BYTES_PER_S, share_rate), min(TEXT_BYTES_PER_S, share_rate)
        self._answers = TokenBucket(answer_rate, BURST_S * answer_rate)
        self._answers_to: dict[tuple[int, int], TokenBucket] = {}
        self._changes = TokenBucket(CHANGES_HZ, BURST_S * CHANGES_HZ)
        self._texts = TokenBucket(text_rate, BURST_S * text_rate)
        self._parameters: ParameterStore | None = None
        self._files: FileServer | None = None

    def begin(self, parameters: ParameterStore) -> None:
        """Answer requests for these parameters from now on."""
        self._parameters = parameters
        self._files = FileServer(lambda: parameters.files, self._codec.counters)

    def answer(self, frame: DecodedFrame, now_s: float) -> bytes:
        """Return the answer to a frame, within the budgets of its sender and of all."""
        if frame.request is None or (frame.request.kind == "terrain" and not self._serves(frame)):
            return b""
        sender = frame.system_id, frame.component_id
        budget = get_or_create(self._answers_to, sender, self._share, SOURCES_MAX)
        is_change = frame.request.kind == "parameter_set"
        if not (budget.has_any(now_s) and self._answers.has_any(now_s)) or (
            is_change and not self._changes.takes(now_s)
        ):
            self._codec.counters["unanswered"] += 1
            return b""
        if frame.request.kind == "terrain" and self._terrain is not None:
            said = self._terrain.answer(frame.request, self._codec)
        else:
            said = answer(frame, self._codec, self._parameters, self._files, now_s)
        budget.owe(len(said))
        self._answers.owe(len(said))
        return said

    def _serves(self, frame: DecodedFrame) -> bool:
        """Return whether heights of the ground are sent: to our autopilot only, if there is a map."""
        is_autopilot = self._codec.identity.is_autopilot(frame.system_id, frame.component_id)
        return self._terrain is not None and is_autopilot

    def _share(self) -> TokenBucket:
        rate = SOURCE_SHARE * self._answers.rate
        return TokenBucket(rate, BURST_S * rate)

    def text(self, severity: int, words: str, now_s: float) -> bytes:
        """Return a text to the pilot, within the budget."""
        said = self._codec.status_text(severity, words)
        if self._texts.takes(now_s, len(said)):
            return said
        self._codec.counters["untold"] += 1
        return b""
