"""Bytes over memory, UDP, TCP and a pseudo-terminal."""

import asyncio
import itertools
import os
import pty
import socket

import pytest

from companion.clock import ManualClock, WallClock
from companion.errors import ConfigError, LinkError
from companion.link.wire.memory_transport import MemoryTransport
from companion.link.wire.transport import (
    SerialTransport,
    TcpTransport,
    UdpInTransport,
    UdpOutTransport,
    transport_from_url,
)


class Heard:
    def __init__(self):
        self.data = b""
        self.address = None
        self.changed = asyncio.Event()

    def __call__(self, data, address=None):
        self.data += data
        self.address = address
        self.changed.set()

    async def until(self, data):
        while self.data != data:
            self.changed.clear()
            await self.changed.wait()


async def rounds(number=20):
    for _ in range(number):
        await asyncio.sleep(0)


async def up(transport):
    while not transport.is_open:  # noqa: ASYNC110 the kernel tells no event for it
        await asyncio.sleep(0.001)


async def refused(transport):
    while not transport.trouble:  # noqa: ASYNC110 a port is opened in a thread, which tells no event
        await asyncio.sleep(0.001)


async def test_memory():
    one, other = MemoryTransport.pair()
    heard = Heard()
    other.set_receiver(heard)
    one.send(b"early")
    await one.open()
    await other.open()
    assert one.is_open
    one.send(b"abc")
    assert heard.data == b"abc"
    await other.close()
    one.send(b"late")
    assert heard.data == b"abc"
    assert one.dropped_bytes == len(b"early") + len(b"late")


async def test_udp_both_ways():
    inward = UdpInTransport("127.0.0.1", 0)
    heard_in, heard_out = Heard(), Heard()
    inward.set_receiver(heard_in)
    inward.send(b"nobody there yet")
    await inward.open()
    assert not inward.is_open
    outward = transport_from_url(f"udpout://127.0.0.1:{inward.port}", WallClock())
    outward.set_receiver(heard_out)
    await outward.open()
    outward.send(b"ping")
    await heard_in.until(b"ping")
    assert not inward.is_open  # who that is has yet to be seen
    inward.answer_to(heard_in.address)
    assert inward.is_open
    inward.send(b"pong")
    await heard_out.until(b"pong")
    assert inward.dropped_bytes == len(b"nobody there yet")
    await outward.close()
    await inward.close()
    outward.send(b"late")
    assert outward.dropped_bytes == 4


async def test_udp_errors():
    inward = UdpInTransport("127.0.0.1", 0)
    await inward.open()
    taken = UdpInTransport("127.0.0.1", inward.port)
    with pytest.raises(LinkError, match="udpin://127"):
        await taken.open()
    await inward.close()


async def unknown(*_arguments, **_names):
    raise socket.gaierror(-2, "Name or service not known")


async def test_a_name_that_is_not_known_yet_is_asked_for_again():
    clock, loop = ManualClock(), asyncio.get_running_loop()
    known, loop.getaddrinfo = loop.getaddrinfo, unknown
    outward = UdpOutTransport("localhost", 1, clock)
    await outward.open()
    assert not outward.is_open
    assert outward.trouble == "Name or service not known"
    clock.advance_to(1.0)
    await rounds()
    assert not outward.is_open
    loop.getaddrinfo = known
    clock.advance_to(3.0)
    await up(outward)
    assert outward.trouble == ""
    await outward.close()
    assert not outward.is_open


async def test_an_address_that_no_interface_has_yet_is_tried_again_until_closed():
    clock = ManualClock()
    inward = UdpInTransport("192.0.2.1", 14540, clock)  # of documentation, nobody's
    await inward.open()
    for now_s in range(1, 40):
        clock.advance_to(float(now_s))
        await rounds(5)
    assert inward.trouble == "Cannot assign requested address"
    assert not inward.is_open
    await inward.close()


async def test_a_datagram_of_a_stranger_takes_nothing_over():
    """One byte was enough: answers went to whoever spoke last."""
    inward = UdpInTransport("127.0.0.1", 0)
    heard, heard_back = Heard(), Heard()
    inward.set_receiver(heard)
    await inward.open()
    url = f"udpout://127.0.0.1:{inward.port}"
    vehicle, stranger = transport_from_url(url, WallClock()), transport_from_url(url, WallClock())
    vehicle.set_receiver(heard_back)
    await vehicle.open()
    await stranger.open()
    vehicle.send(b"a")
    await heard.until(b"a")
    inward.answer_to(heard.address)
    stranger.send(b"b")
    await heard.until(b"ab")
    inward.send(b"still to the vehicle")
    await heard_back.until(b"still to the vehicle")
    for transport in (stranger, vehicle, inward):
        await transport.close()


async def test_what_others_send_to_an_outgoing_socket_is_not_heard():
    peer, stranger = UdpInTransport("127.0.0.1", 0), UdpInTransport("127.0.0.1", 0)
    heard_by_peer, heard = Heard(), Heard()
    peer.set_receiver(heard_by_peer)
    await peer.open()
    await stranger.open()
    outward = UdpOutTransport("127.0.0.1", peer.port)
    outward.set_receiver(heard)
    await outward.open()
    outward.send(b"hello")
    await heard_by_peer.until(b"hello")
    stranger.answer_to(heard_by_peer.address)
    stranger.send(b"forged")
    peer.answer_to(heard_by_peer.address)
    peer.send(b"true")
    await heard.until(b"true")
    for transport in (outward, stranger, peer):
        await transport.close()


async def test_udp_survives_a_peer_that_is_not_there():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    outward = UdpOutTransport("127.0.0.1", port)
    await outward.open()
    for _ in range(3):
        outward.send(b"hello")
        await asyncio.sleep(0.01)
    assert outward.is_open
    await outward.close()


async def listen(port=0):
    """A server that echoes; returns it, its port and its open lines."""
    lines = []

    async def serve(reader, writer):
        lines.append(writer)
        while data := await reader.read(1_000):
            writer.write(data)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", port)
    return server, server.sockets[0].getsockname()[1], lines


async def test_tcp_connects_again():
    server, port, lines = await listen()
    clock = ManualClock()
    transport = TcpTransport("127.0.0.1", port, clock)
    heard = Heard()
    transport.set_receiver(heard)
    transport.send(b"early")
    await transport.open()
    await up(transport)
    transport.send(b"abc")
    await heard.until(b"abc")
    lines[0].close()
    while transport.is_open:  # noqa: ASYNC110 nothing tells the loss
        await asyncio.sleep(0.001)
    await asyncio.sleep(0.02)
    assert transport.connections == 1  # the pause goes by the clock, which stands still
    clock.advance_to(0.5)
    await up(transport)
    assert transport.connections == 2
    transport.send(b"def")
    await heard.until(b"abcdef")
    await transport.close()
    assert not transport.is_open
    assert transport.dropped_bytes == len(b"early")
    server.close()
    for line in lines:  # not all ends of lines are closed with the server, in every Python
        line.close()
        await line.wait_closed()


async def test_pauses_between_attempts_grow():
    clock = ManualClock()
    transport = TcpTransport("127.0.0.1", 1, clock)
    attempts = []

    async def refused(_protocol):
        attempts.append(clock.now_s())
        raise ConnectionRefusedError

    transport._connect = refused
    await transport.open()
    for tick in range(1, 80):
        await rounds(5)
        clock.advance_to(tick * 0.5)
    await transport.close()
    pauses = [later - earlier for earlier, later in itertools.pairwise(attempts)]
    assert pauses == [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]


async def test_closing_while_connecting_and_twice():
    transport = TcpTransport("127.0.0.1", 1, ManualClock())
    await transport.open()
    await transport.open()
    await rounds()
    await transport.close()
    await transport.close()


async def test_serial():
    leader, follower = pty.openpty()
    transport = transport_from_url(f"serial://{os.ttyname(follower)}:57600", WallClock())
    heard = Heard()
    transport.set_receiver(heard)
    await transport.open()
    await up(transport)
    os.write(leader, b"\xfd\x00\xff")
    await heard.until(b"\xfd\x00\xff")
    transport.send(b"\x01\x02")
    assert await asyncio.to_thread(os.read, leader, 2) == b"\x01\x02"
    await transport.close()
    os.close(leader)
    os.close(follower)


async def test_a_serial_line_has_one_reader():
    leader, follower = pty.openpty()
    first, second = (SerialTransport(os.ttyname(follower), 57_600, WallClock()) for _ in range(2))
    await first.open()
    await up(first)
    await second.open()
    await refused(second)
    assert not second.is_open
    assert second.trouble == "another program has the port: the service?"
    await first.close()
    await up(second)
    assert second.trouble == ""
    await second.close()
    os.close(leader)
    os.close(follower)


async def test_why_nobody_answers_is_told():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    transport = TcpTransport("127.0.0.1", port, ManualClock())
    await transport.open()
    while not transport.trouble:  # noqa: ASYNC110 the kernel's answer comes by itself
        await asyncio.sleep(0)
    assert transport.trouble == "Connection refused"
    await transport.close()


async def test_serial_line_that_is_not_there():
    transport = SerialTransport("/dev/no-such-line", 57_600, ManualClock())
    await transport.open()
    await refused(transport)
    assert not transport.is_open
    assert "/dev/no-such-line" in transport.trouble
    await transport.close()


@pytest.mark.parametrize(
    ("url", "kind"),
    [
        ("serial:///dev/ttyAMA0:921600", SerialTransport),
        ("udpin://0.0.0.0:14540", UdpInTransport),
        ("udpout://gcs.local:14550", UdpOutTransport),
        ("tcp://127.0.0.1:5760", TcpTransport),
        ("tcp://[::1]:5760", TcpTransport),
    ],
)
def test_urls(url, kind):
    assert type(transport_from_url(url, WallClock())) is kind


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("", "serial:///dev/ttyAMA0:921600, udpin://"),
        ("udp://:14540", "serial:///dev/ttyAMA0:921600, udpin://"),
        ("/dev/ttyAMA0", "serial:///dev/ttyAMA0:921600, udpin://"),
        ("serial:///dev/ttyAMA0", "a device and a baud rate"),
        ("serial:///dev/ttyAMA0:fast", "a device and a baud rate"),
        ("serial:///dev/ttyAMA0:0", "a device and a baud rate"),
        ("serial://:57600", "a device and a baud rate"),
        ("tcp://127.0.0.1", "a host and a port"),
        ("tcp://127.0.0.1:99999", "a host and a port"),
        ("tcp://127.0.0.1:abc", "a host and a port"),
        (f"tcp://{'x' * 70}:5760", "a host and a port"),
        ("tcp://:5760", "a host and a port"),
        ("udpin://0.0.0.0:14540/x", "a host and a port"),
        ("udpout://user@host:1", "a host and a port"),
    ],
)
def test_urls_that_name_no_link(url, expected):
    with pytest.raises(ConfigError) as caught:
        transport_from_url(url, WallClock())
    assert caught.value.key == "--link"
    assert caught.value.expected.startswith(expected)
