"""Sets up signing from a mission file."""

from __future__ import annotations

import time
from pathlib import Path

from companion.clock import UNSYNCHRONISED, clock_state
from companion.config import MissionConfig
from companion.link.messages.codec import signer_of
from companion.link.wire.key_file import read_key
from companion.link.wire.signing import Signer, Timestamps


def signing_of(mission: MissionConfig, state: Path | None) -> tuple[Timestamps | None, Signer | None]:
    """Return timestamps and signer as in the mission file; None without a key.

    The timestamps are stored next to the key, or in the state folder, since systemd makes the configuration
    read-only.
    """
    signing = mission.link.signing
    if signing is None:
        return None, None
    key_file = Path(signing.key_file)
    base = key_file if state is None else state / key_file.name
    times = signing.timestamp_file or f"{base}.times"
    timestamps = Timestamps(Path(times), time.time, lambda: clock_state() != UNSYNCHRONISED)
    signer = signer_of(
        read_key(key_file), signing.link_id, timestamps, signing.allow_unsigned,
        allow_mavlink1=signing.allow_mavlink1,
    )  # fmt: skip
    return timestamps, signer
