"""The page of recordings: served until it is interrupted."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from companion.errors import LinkError
from companion.ui.page.access import Access
from companion.ui.page.ground import Ground
from companion.ui.page.page_server import PageServer
from companion.ui.page.playback import Playback


def show_playbacks(
    playbacks: Sequence[Playback], port: int, announce: Callable[[str], None], ground: Ground | None = None
) -> None:
    """Serve recordings to this computer's browsers until interrupted.

    Parameters
    ----------
    playbacks : sequence of Playback
        Recordings, in the order of the page's list.
    port : int
        TCP port; 0 for any that is free.
    announce : callable
        Called with the page's address.
    ground : Ground, optional
        The ground under the map.

    Raises
    ------
    LinkError
        If the port is taken.
    """
    access = Access(port)
    try:
        server = PageServer(access, None, playbacks, ground=ground)
    except OSError as error:
        raise LinkError(f"page on {access.host}:{port}: {error.strerror}") from error
    announce(server.address)
    wait_for_interrupt()
    server.close()


def wait_for_interrupt() -> None:
    """Wait until Ctrl+C."""
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        return
