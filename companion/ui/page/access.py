"""Access to the page: for users of this computer, and for those who have the token."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import parse_qs

from companion.errors import ConfigError
from companion.loopback_server import LOOPBACK, Answer, Request, head_of

TOKEN_MIN = 8  # Fewest characters of a token.
COOKIE = "companion-page"
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost"})


@dataclass(frozen=True, slots=True)
class Access:
    """The address on which the page is served, and who may look.

    Parameters
    ----------
    port : int
        TCP port; 0 for any that is free.
    host : str
        Address to listen on.
    token : str
        What viewers have to know; '' if only this computer's viewers may look.
    cookie : str
        Name under which a browser keeps the token. Pages of one host share cookies, whatever their port.

    Raises
    ------
    ConfigError
        If the address is invalid, if others may look without a token, or if the token is too short.
    """

    port: int
    host: str = LOOPBACK
    token: str = ""
    cookie: str = COOKIE

    def __post_init__(self) -> None:
        try:
            is_local = ipaddress.IPv4Address(self.host).is_loopback
        except ValueError:
            raise ConfigError(
                "command line", None, "--page-listen", self.host, "an IPv4 address of this computer's"
            ) from None
        if not is_local and not self.token:
            raise ConfigError(
                "command line", None, "--page-listen", self.host,
                "a token beside it, in COMPANION_PAGE_TOKEN or by --page-token: others could look",
            )  # fmt: skip
        if self.token and (len(self.token) < TOKEN_MIN or not self.token.isascii()):
            raise ConfigError(
                "command line", None, "--page-token", f"{len(self.token)} characters",
                f"at least {TOKEN_MIN} characters of ASCII",
            )  # fmt: skip

    @property
    def _key(self) -> str:
        """The value that a browser keeps instead of the token."""
        return hashlib.sha256(b"page " + self.token.encode()).hexdigest()

    def address(self, port: int) -> str:
        """URL to open, without the token."""
        host = LOOPBACK if self.host == "0.0.0.0" else self.host
        return f"http://{host}:{port}/"

    def refusal(self, request: Request) -> bytes | None:
        """Return the answer that refuses a request; None if the request is permitted.

        Without a token the name that was asked must be this computer's: a web site that had itself resolved
        to this address could else read the page through the browser that shows it.
        """
        if not self.token:
            name = request.headers.get("host", "").rpartition(":")[0] or request.headers.get("host", "")
            if name in _LOCAL_NAMES or name == self.host:
                return None
            return _said(HTTPStatus.FORBIDDEN, "Ask for this page by http://127.0.0.1 or localhost.")
        if hmac.compare_digest(_cookie_of(request, self.cookie), self._key):
            return None
        path, _, query = request.target.partition("?")
        given = parse_qs(query, max_num_fields=20).get("token", [""])[0] if len(query) < 2_000 else ""
        if hmac.compare_digest(given.encode(errors="replace"), self.token.encode()):
            answer = Answer(HTTPStatus.SEE_OTHER, "text/plain", b"")
            place = path if path.startswith("/") and not path.startswith("//") else "/"
            cookie = f"Set-Cookie: {self.cookie}={self._key}; Path=/; HttpOnly; SameSite=Strict"
            return head_of(answer, f"Location: {place}", cookie, "Cache-Control: no-store")
        return _said(HTTPStatus.UNAUTHORIZED, "This page needs its token: add ?token=... to its address.")


def _cookie_of(request: Request, cookie: str) -> str:
    parts = (part.partition("=") for part in request.headers.get("cookie", "").split(";"))
    found = next((value for name, _, value in parts if name.strip() == cookie), "")
    return found.strip() if found.isascii() else ""


def _said(status: HTTPStatus, text: str) -> bytes:
    answer = Answer(status, "text/plain; charset=utf-8", f"{text}\n".encode())
    return head_of(answer) + answer.body
