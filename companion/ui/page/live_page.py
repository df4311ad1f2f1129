"""The page of a running flight: what the service or the simulator opens, feeds and closes."""

from __future__ import annotations

from pathlib import Path

from companion.errors import LinkError
from companion.loopback_server import LOOPBACK
from companion.recording.recorder import Recorder
from companion.ui.page.access import Access
from companion.ui.page.feed import Feed
from companion.ui.page.ground import Ground, ground_at
from companion.ui.page.page_server import PageServer


class LivePage:
    """A page, and what feeds it.

    Parameters
    ----------
    access : Access
        Where it listens, and who may look.
    ground : Ground, optional
        What is drawn under the map.

    Raises
    ------
    LinkError
        If the port is taken, or the address none of this computer's.
    """

    def __init__(self, access: Access, ground: Ground | None = None) -> None:
        self._feed = Feed()
        try:
            self._server = PageServer(access, self._feed, ground=ground)
        except OSError as error:
            raise LinkError(f"page on {access.host}:{access.port}: {error.strerror}") from error

    @property
    def address(self) -> str:
        """URL to open in a browser on this computer."""
        return self._server.address

    def follow(self, recorder: Recorder) -> None:
        """Show the flight that a recorder writes down, from its beginning."""
        self._feed.begin_flight()
        recorder.listen(self._feed.tell, self._feed.notice)

    def close(self) -> None:
        """End it."""
        self._server.close()


def page_of(port: int | None, host: str, token: str, ground: Path | None = None) -> LivePage | None:
    """Open the page that options ask for; None where no port is given.

    Parameters
    ----------
    port : int or None
        TCP port; 0 for any that is free.
    host : str
        Address to listen on; '' for this computer alone.
    token : str
        What viewers have to know; '' where only this computer's are let in.
    ground : Path, optional
        File or folder of what is drawn under the map.

    Raises
    ------
    ConfigError
        If they are not to be used together, or a file of the ground cannot be used.
    LinkError
        If it cannot be listened there.
    """
    return None if port is None else LivePage(Access(port, host or LOOPBACK, token), ground_at(ground))
