"""What a mission file says of signing, as what signs and verifies."""

from __future__ import annotations

import time
from pathlib import Path

from companion.clock import UNSYNCHRONISED, clock_state
from companion.config import MissionConfig
from companion.link.messages.codec import signer_of
from companion.link.wire.key_file import read_key
from companion.link.wire.signing import Signer, Timestamps


def signing_of(mission: MissionConfig, state: Path | None) -> tuple[Timestamps | None, Signer | None]:
    """What signs and verifies, as the mission file says; nothing without a key.

    The times go beside the key, or to the state folder: configuration is read only under systemd.
    """
    signing = mission.link.signing
    if signing is None:
        return None, None
    key_file = Path(signing.key_file)
    beside = key_file if state is None else state / key_file.name
    times = signing.timestamp_file or f"{beside}.times"
    timestamps = Timestamps(Path(times), time.time, lambda: clock_state() != UNSYNCHRONISED)
    signer = signer_of(
        read_key(key_file), signing.link_id, timestamps, signing.allow_unsigned,
        allow_mavlink1=signing.allow_mavlink1,
    )  # fmt: skip
    return timestamps, signer
