"""The simulator on a socket, in real time or a multiple of it, for any MAVLink client.

The only module of the simulator that reads the computer's clock. URLs: ``udpin://host:port`` waits
for clients, ``udpout://host:port`` sends to one, ``tcp://host:port`` accepts clients; each client has
its own channel with its own stream rates.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import cast
from urllib.parse import urlsplit

from companion.clock import WallClock
from companion.errors import LinkError
from .autopilot.channel import Channel
from .simulator import Simulator

_STEP_S = 0.02
_BACKLOG_MAX_BYTES = 1_000_000
_RECEIVE_BYTES = 4096
_CATCH_UP_S = 0.5

Address = tuple[str, int]


class _Clients:
    """Channels of the clients connected now, and how to send to each."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator
        self._senders: dict[Channel, Callable[[bytes], None]] = {}

    def add(self, send: Callable[[bytes], None]) -> Channel:
        channel = self._simulator.open_channel()
        self._senders[channel] = send
        return channel

    def remove(self, channel: Channel) -> None:
        del self._senders[channel]
        self._simulator.close_channel(channel)

    def receive(self, channel: Channel, data: bytes) -> None:
        self._simulator.receive_on(channel, data)
        if self._simulator.autopilot.answers_at_once:
            self._send(channel)

    def flush(self) -> None:
        self._simulator.take_outgoing()  # The simulator's own channel has no client.
        for channel in list(self._senders):
            self._send(channel)

    def _send(self, channel: Channel) -> None:
        if data := channel.take():
            self._senders[channel](data)


class _Datagrams(asyncio.DatagramProtocol):
    """UDP: one channel per address received from, or one to a fixed address."""

    def __init__(self, clients: _Clients, remote: Address | None) -> None:
        self._clients = clients
        self._remote = remote
        self._channels: dict[Address, Channel] = {}
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Open the fixed channel, if there is one."""
        self._transport = cast("asyncio.DatagramTransport", transport)  # asyncio's own is not one by type
        if self._remote is not None:
            self._channel(self._remote)

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Give it to the channel of its sender."""
        key = self._remote or addr
        self._clients.receive(self._channel(key), data)

    def error_received(self, exc: Exception) -> None:
        """Ignore the error: the other side may start later."""

    def _channel(self, address: Address) -> Channel:
        channel = self._channels.get(address)
        if channel is None:
            channel = self._clients.add(lambda data: self._send(data, address))
            self._channels[address] = channel
        return channel

    def _send(self, data: bytes, address: Address) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(data, address)


async def _serve_stream(
    clients: _Clients, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """One TCP client, until it leaves or stops reading."""

    def send(data: bytes) -> None:
        transport = writer.transport
        if transport.get_write_buffer_size() > _BACKLOG_MAX_BYTES:
            transport.abort()
        elif not transport.is_closing():
            writer.write(data)

    channel = clients.add(send)
    try:
        while data := await reader.read(_RECEIVE_BYTES):
            clients.receive(channel, data)
    except (ConnectionError, asyncio.CancelledError):
        pass  # Cancelled at the end: Python 3.11's streams would print a traceback.
    finally:
        clients.remove(channel)
        writer.close()


def address_of(url: str) -> tuple[str, Address]:
    """Scheme and address of a URL.

    Raises
    ------
    LinkError
        If it is none of the three kinds.
    """
    try:
        parts = urlsplit(url)
        scheme, host, port = parts.scheme, parts.hostname, parts.port
    except ValueError:
        scheme, host, port = "", None, None
    if scheme not in ("udpin", "udpout", "tcp") or not host or not port:
        raise LinkError(f"{url}: expected udpin://, udpout:// or tcp://host:port")
    return scheme, (host, port)


@contextlib.asynccontextmanager
async def _listening(clients: _Clients, url: str) -> AsyncIterator[None]:
    scheme, (host, port) = address_of(url)
    loop = asyncio.get_running_loop()
    try:
        if scheme == "tcp":
            server = await asyncio.start_server(
                lambda reader, writer: _serve_stream(clients, reader, writer), host, port
            )
        elif scheme == "udpin":
            transport, _ = await loop.create_datagram_endpoint(
                lambda: _Datagrams(clients, None), local_addr=(host, port)
            )
        else:
            transport, _ = await loop.create_datagram_endpoint(
                lambda: _Datagrams(clients, (host, port)), local_addr=("0.0.0.0", 0)
            )
    except OSError as error:
        raise LinkError(f"{url}: {error.strerror or error}") from error
    try:
        yield
    finally:
        if scheme == "tcp":
            server.close()
        else:
            transport.close()


async def serve(
    simulator: Simulator, url: str, speed: float = 1.0, until: Callable[[], bool] | None = None
) -> None:
    """Fly in step with the clock, while clients connect and leave.

    Parameters
    ----------
    simulator : Simulator
        The simulator.
    url : str
        Address to listen on.
    speed : float
        Simulated seconds for each second. If the computer cannot keep up, it flies as fast as it can.
    until : callable, optional
        Called after every step; True ends the flight.

    Raises
    ------
    LinkError
        If the address cannot be used.
    """
    clock, clients = WallClock(), _Clients(simulator)
    async with _listening(clients, url):
        start_s, offset_s = clock.now_s(), simulator.now_s
        while until is None or not until():
            due_s = start_s + (simulator.now_s + _STEP_S - offset_s) / speed
            if clock.now_s() - due_s > _CATCH_UP_S:
                start_s, offset_s = clock.now_s(), simulator.now_s
            await clock.sleep_until(due_s)
            simulator.step(_STEP_S)
            clients.flush()
