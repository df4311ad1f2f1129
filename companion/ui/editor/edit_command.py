"""``companion edit``: a mission file in the browser."""

from __future__ import annotations

import secrets
from typing import Annotated

import typer
from rich.console import Console

from companion.cli_options import MissionFile, PageGround, PageListen, PageToken
from companion.errors import LinkError


def register(app: typer.Typer) -> None:
    """Add the command to ``companion``."""
    app.command()(edit)


def edit(
    mission: MissionFile,
    page: Annotated[
        int, typer.Option("--page", min=0, max=65535, help="Port of the page; by default any that is free.")
    ] = 0,
    page_listen: PageListen = "",
    page_token: PageToken = "",
    page_ground: PageGround = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in this computer's browser.")
    ] = True,
) -> None:
    """Edit a mission file on a map in the browser: draw, check, plan, fly in the simulator, save."""
    import hashlib
    import logging
    import webbrowser

    from companion.loopback_server import LOOPBACK
    from companion.ui.editor.edit_server import EditServer
    from companion.ui.editor.edit_session import EditSession
    from companion.ui.page.access import Access
    from companion.ui.page.ground import ground_at
    from companion.ui.page.playback_page import wait_for_interrupt

    # Whoever reaches the page may change the file. So it has a token, which its address brings along.
    access = Access(
        page, page_listen or LOOPBACK, page_token or secrets.token_urlsafe(16),
        cookie=f"companion-edit-{hashlib.sha256(bytes(mission.absolute())).hexdigest()[:8]}",
    )  # fmt: skip
    ground = ground_at(page_ground)
    session = EditSession(mission, ground)
    try:
        server = EditServer(access, session, ground)
    except OSError as error:
        raise LinkError(f"page on {access.host}:{page}: {error.strerror}") from error
    Console().print(f"editing {mission} on {server.address} until Ctrl+C", markup=False, soft_wrap=True)
    for name in (
        "companion.flight.tasks.app",
        "companion.recording.recorder",
    ):  # The page shows what they say.
        logging.getLogger(name).setLevel(logging.WARNING)
    if browser:
        webbrowser.open(server.address)
    wait_for_interrupt()
    server.close()
