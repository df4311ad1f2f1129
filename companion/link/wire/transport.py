"""Transports for the bytes of a link: serial line, UDP, TCP and memory.

An open transport reconnects by itself: it reopens a lost line with growing pauses. Data sent meanwhile is
dropped, as by a radio link.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import os
import socket
from collections.abc import Callable
from urllib.parse import SplitResult, urlsplit

from companion.clock import Clock, WallClock
from companion.errors import ConfigError, LinkError

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 10.0
_PENDING_BYTES_MAX = 64 * 1024  # Bytes that may wait for sending on a line of unknown speed.
_PENDING_MAX_S = 2.0  # Time that data may wait on a line of known speed; older data is useless.
_BITS_A_BYTE = 10  # A serial line adds a start bit and a stop bit.
# Errors that may disappear by themselves: an interface that is not up yet has no address.
_TRANSIENT_ERRORS = frozenset({errno.EADDRNOTAVAIL, errno.ENETDOWN, errno.ENETUNREACH, errno.EHOSTUNREACH})
_URL_KINDS = "serial:///dev/ttyAMA0:921600, udpin://0.0.0.0:14540, udpout://host:port or tcp://host:port"

Address = tuple[str, int]  # Host and port.
Receiver = Callable[..., None]  # Takes bytes and, except on a line, the sender's address.


_log = logging.getLogger(__name__)


def dropped(_data: bytes, _address: Address | None = None) -> None:
    """Drop received bytes."""


class Transport:
    """One link to the autopilot; the base of all transports.

    Attributes
    ----------
    bytes_per_s : float or None
        Capacity of the line; None if it is unknown.
    trouble : str
        Why the line is down, as far as known; '' while it is up.
    """

    bytes_per_s: float | None = None

    def __init__(self) -> None:
        self._receiver: Receiver = dropped
        self.dropped_bytes = 0
        self.trouble = ""

    @property
    def is_open(self) -> bool:
        """Whether bytes can be sent now."""
        raise NotImplementedError

    @property
    def pending_bytes(self) -> int:
        """Number of bytes queued for sending."""
        return 0

    async def open(self) -> None:
        """Open the transport; returns when the line is up, or at once if it comes up by itself later."""
        raise NotImplementedError

    def answer_to(self, address: Address) -> None:
        """Send to this address from now on, if the transport can choose one."""

    async def close(self) -> None:
        """Close the transport for good."""
        raise NotImplementedError

    def send(self, data: bytes) -> None:
        """Send data; drops it while the line is down."""
        raise NotImplementedError

    def set_receiver(self, receiver: Receiver) -> None:
        """Set the function that takes arriving bytes, in the event loop."""
        self._receiver = receiver


class _DatagramProtocol(asyncio.DatagramProtocol):
    def __init__(self, on_data: Receiver) -> None:
        self._on_data = on_data

    def datagram_received(self, data: bytes, addr: Address) -> None:
        self._on_data(data, (addr[0], addr[1]))

    def error_received(self, exc: Exception) -> None:
        _log.debug("datagram refused: %s", exc)  # No program listens at that address yet.


class _UdpTransport(Transport):
    """Base of both kinds of UDP; if the network is not up yet, the socket is created once it is."""

    kind = ""

    def __init__(self, host: str, port: int, clock: Clock | None = None) -> None:
        super().__init__()
        self._address = (host, port)
        self._clock = clock or WallClock()
        self._task: asyncio.Task[None] | None = None
        self._peer: Address | None = None
        self._destination: Address | None = None  # None for a connected socket.
        self._socket: asyncio.DatagramTransport | None = None

    @property
    def is_open(self) -> bool:
        """Whether the socket is open and an address to send to is known."""
        return self._socket is not None and self._peer is not None

    async def open(self) -> None:
        """Create the socket, or begin trying to; does nothing if an earlier user opened it.

        Raises
        ------
        LinkError
            If the address cannot be used, and waiting would not help.
        """
        if self._socket is not None or self._task is not None:
            return
        try:
            await self._create_socket()
        except OSError as error:
            if not isinstance(error, socket.gaierror) and error.errno not in _TRANSIENT_ERRORS:
                host, port = self._address
                raise LinkError(f"{self.kind}://{host}:{port}: {_error_text(error)}") from error
            self.trouble = _error_text(error)
            self._task = asyncio.create_task(self._try_again(), name="transport")

    async def _create_socket(self) -> None:
        raise NotImplementedError

    async def _try_again(self) -> None:
        pause_s = FIRST_PAUSE_S
        while True:
            await self._clock.sleep_until(self._clock.now_s() + pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
            try:
                await self._create_socket()
            except OSError as error:
                self.trouble = _error_text(error)
            else:
                self.trouble = ""
                return

    async def close(self) -> None:
        """Close the socket."""
        task, self._task = self._task, None
        if task is not None:
            await _cancelled(task)
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()
            await asyncio.sleep(0)  # The event loop closes it in its next iteration.

    def send(self, data: bytes) -> None:
        """Send one datagram to the peer."""
        if self._socket is None or self._peer is None:
            self.dropped_bytes += len(data)
        else:
            self._socket.sendto(data, self._destination)

    def _received(self, data: bytes, address: Address | None = None) -> None:
        self._receiver(data, address)  # Looked up at each call, since it may be set after opening.


class UdpInTransport(_UdpTransport):
    """Listens on a port; sends to the address given to :meth:`answer_to`, and to nobody before."""

    kind = "udpin"

    @property
    def port(self) -> int | None:
        """Port that the open socket listens on."""
        return None if self._socket is None else int(self._socket.get_extra_info("sockname")[1])

    def answer_to(self, address: Address) -> None:
        """Send to this address from now on."""
        self._peer = self._destination = address

    async def _create_socket(self) -> None:
        self._socket, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: _DatagramProtocol(self._received), local_addr=self._address
        )


class UdpOutTransport(_UdpTransport):
    """Sends to a fixed address and receives from that address only."""

    kind = "udpout"

    async def _create_socket(self) -> None:
        host, port = self._address
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        family, _, _, _, address = found[0]
        self._peer = (str(address[0]), int(address[1]))
        self._socket, _ = await loop.create_datagram_endpoint(
            lambda: _DatagramProtocol(self._received), family=family, remote_addr=self._peer
        )


class _StreamProtocol(asyncio.Protocol):
    def __init__(self, on_data: Receiver) -> None:
        self._on_data = on_data
        self.lost: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def data_received(self, data: bytes) -> None:
        self._on_data(data)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - as asyncio calls it
        if not self.lost.done():
            self.lost.set_result(None)


class _StreamTransport(Transport):
    """Base of serial line and TCP: connects, waits for the loss, pauses and connects again."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self._line: asyncio.WriteTransport | None = None
        self._task: asyncio.Task[None] | None = None
        self.connections = 0

    @property
    def is_open(self) -> bool:
        """Whether the line is up."""
        return self._line is not None and not self._line.is_closing()

    @property
    def pending_bytes(self) -> int:
        """Number of bytes queued for sending."""
        return 0 if self._line is None else self._line.get_write_buffer_size()

    async def open(self) -> None:
        """Begin connecting; the line may come up later."""
        if self._task is None:
            self._task = asyncio.create_task(self._run(), name="transport")
            await asyncio.sleep(0)

    async def close(self) -> None:
        """Close the line and stop connecting."""
        task, self._task = self._task, None
        if task is not None:
            await _cancelled(task)

    def send(self, data: bytes) -> None:
        """Send data; drops it while the line is down or its buffer is full."""
        line = self._line
        most = _PENDING_BYTES_MAX if self.bytes_per_s is None else _PENDING_MAX_S * self.bytes_per_s
        if line is None or line.is_closing() or line.get_write_buffer_size() > most:
            self.dropped_bytes += len(data)
        else:
            line.write(data)

    async def _connect(self, protocol: _StreamProtocol) -> asyncio.WriteTransport:
        raise NotImplementedError

    async def _run(self) -> None:
        pause_s = FIRST_PAUSE_S
        while True:
            protocol = _StreamProtocol(self._received)
            try:
                self._line = await self._connect(protocol)
            except OSError as error:
                _log.debug("no connection: %s", error)
                self.trouble = _error_text(error)
            else:
                self.connections += 1
                self.trouble = ""
                pause_s = FIRST_PAUSE_S
                try:
                    await protocol.lost
                finally:
                    line, self._line = self._line, None
                    line.abort()
                    self.trouble = "the connection was lost"
            await self._clock.sleep_until(self._clock.now_s() + pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)

    def _received(self, data: bytes, _address: Address | None = None) -> None:
        self._receiver(data)  # Looked up at each call, since it may be set after connecting.


class TcpTransport(_StreamTransport):
    """TCP client."""

    def __init__(self, host: str, port: int, clock: Clock) -> None:
        super().__init__(clock)
        self._address = (host, port)

    async def _connect(self, protocol: _StreamProtocol) -> asyncio.WriteTransport:
        line, _ = await asyncio.get_running_loop().create_connection(lambda: protocol, *self._address)
        line.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return line


class SerialTransport(_StreamTransport):
    """Serial line; an unplugged device is reopened when it is back."""

    def __init__(self, device: str, baud_rate: int, clock: Clock) -> None:
        super().__init__(clock)
        self.bytes_per_s = baud_rate / _BITS_A_BYTE
        self._device = device
        self._baud_rate = baud_rate

    async def _connect(self, protocol: _StreamProtocol) -> asyncio.WriteTransport:
        import serialx  # Only serial lines need it.  # noqa: PLC0415

        try:
            line, _ = await serialx.create_serial_connection(
                asyncio.get_running_loop(), lambda: protocol, self._device, baudrate=self._baud_rate,
                exclusive=True,  # Two readers would get half of each frame each.
            )  # fmt: skip
        except serialx.SerialException as error:
            raise OSError(str(error)) from error  # For example a baud rate that the device does not support.
        return line


def transport_from_url(url: str, clock: Clock) -> Transport:
    """Create the transport that a URL describes, without opening it.

    Parameters
    ----------
    url : str
        ``serial:///dev/ttyAMA0:921600``, ``udpin://0.0.0.0:14540``, ``udpout://host:port`` or
        ``tcp://host:port``.
    clock : Clock
        Clock for the pauses between attempts to connect.

    Raises
    ------
    ConfigError
        For any other URL.
    """
    kind, _, rest = url.partition("://")
    if kind == "serial":
        device, _, baud_rate = rest.rpartition(":")
        if not device.startswith("/") or not baud_rate.isdecimal() or not 0 < int(baud_rate) <= 10_000_000:
            raise _url_error(url, "a device and a baud rate, as in serial:///dev/ttyAMA0:921600")
        return SerialTransport(device, int(baud_rate), clock)
    if kind not in ("udpin", "udpout", "tcp"):
        raise _url_error(url, _URL_KINDS)
    host, port = _address(url)
    if kind == "udpin":
        return UdpInTransport(host, port, clock)
    return UdpOutTransport(host, port, clock) if kind == "udpout" else TcpTransport(host, port, clock)


async def _cancelled(task: asyncio.Task[None]) -> None:
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


def _error_text(error: OSError) -> str:
    """Describe an error of an address; the event loop's own text would repeat the address."""
    if error.errno in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY):
        return "another program has the port: the service?"
    if isinstance(error, socket.gaierror) or not error.errno:
        return error.strerror or str(error)
    words = os.strerror(error.errno)
    return f"{words}: {error.filename}" if error.filename else words


def _address(url: str) -> tuple[str, int]:
    try:
        parts: SplitResult = urlsplit(url)
        host, port = parts.hostname, parts.port
        (host or "").encode("idna")  # The name resolver would raise for names that this refuses.
    except ValueError:
        host, port = None, None
    is_plain = host is not None and port is not None and url.count("/") == 2 and "@" not in url
    if not is_plain or host is None or port is None:
        raise _url_error(url, "a host and a port from 0 to 65535, as in tcp://127.0.0.1:5760")
    return host, port


def _url_error(url: str, expected: str) -> ConfigError:
    return ConfigError("command line", None, "--link", url or "nothing", expected)
