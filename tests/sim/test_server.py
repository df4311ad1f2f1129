"""The simulator on real sockets, with MAVSDK as its client."""

from __future__ import annotations

import asyncio
import math
import socket

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.errors import LinkError
from companion.types.events import Dialect
from sim.server import address_of, serve
from sim.simulator import Simulator
from tests.sim.client import plain_mission


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def raw_items(simulator: Simulator, number: int, kind: int = 0, command: int = 16) -> list[RawItem]:
    items = []
    for sequence in range(number):
        latitude, longitude = simulator.autopilot.projection.degrees(800.0 + 200.0 * sequence, 100.0)
        items.append(
            RawItem(
                seq=sequence,
                frame=3,
                command=command,
                current=int(sequence == 0 and kind == 0),
                autocontinue=1,
                param1=3.0 if kind else 0.0,
                x=round(latitude * 1e7),
                y=round(longitude * 1e7),
                z=100.0,
                mission_type=kind,
            )
        )
    return items


async def mavsdk_session(simulator: Simulator, url: str) -> None:
    """Upload and download a mission and a fence, and move on in the mission."""
    configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=10.0)
        assert system is not None
        missions = MissionRawAsync(system)
        sent = raw_items(simulator, 12)
        await missions.upload_mission(sent)
        found = await missions.download_mission()
        assert [(i.x, i.y, i.command) for i in found[1:]] == [(i.x, i.y, 16) for i in sent[1:]]
        await missions.set_current_mission_item(3)
        assert simulator.autopilot.current_sequence == 3
        fence = raw_items(simulator, 4, kind=1, command=5002)
        await missions.upload_geofence(fence)
        assert len(await missions.download_geofence()) == 4


@pytest.mark.parametrize(
    ("listen", "connect", "kind"),
    [
        ("tcp://127.0.0.1:{}", "tcpout://127.0.0.1:{}", socket.SOCK_STREAM),
        ("udpin://127.0.0.1:{}", "udpout://127.0.0.1:{}", socket.SOCK_DGRAM),
        ("udpout://127.0.0.1:{}", "udpin://127.0.0.1:{}", socket.SOCK_DGRAM),
    ],
)
def test_mavsdk_uploads_and_downloads_missions_and_fences(listen, connect, kind):
    simulator = Simulator(plain_mission(), seed=1)
    port = free_port(kind)

    async def session() -> None:
        server = asyncio.create_task(serve(simulator, listen.format(port), speed=4.0))
        try:
            async with asyncio.timeout(20.0):
                await mavsdk_session(simulator, connect.format(port))
        finally:
            server.cancel()
            await asyncio.gather(server, return_exceptions=True)

    asyncio.run(session())
    assert [entry.command for entry in simulator.autopilot.mission_items] == [16] * 12


async def heartbeats(reader: asyncio.StreamReader, number: int) -> list[mavlink.MAVLink_heartbeat_message]:
    mav = mavlink.MAVLink(None)
    mav.robust_parsing = True
    found = []
    while len(found) < number:
        messages = mav.parse_buffer(await reader.read(4096)) or []
        found += [message for message in messages if message.get_type() == "HEARTBEAT"]
    return found


def test_tcp_clients_come_and_go_and_bring_no_harm():
    simulator = Simulator(plain_mission(), seed=1)
    port = free_port(socket.SOCK_STREAM)

    async def session() -> None:
        server = asyncio.create_task(serve(simulator, f"tcp://127.0.0.1:{port}", speed=20.0))
        await asyncio.sleep(0.1)
        for _ in range(2):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(b"\xfd\xff\x00 this is no MAVLink \xfe")
            (beat, _) = await heartbeats(reader, 2)
            assert (beat.get_srcSystem(), beat.custom_mode) == (1, 10)
            writer.close()
            await writer.wait_closed()
        server.cancel()
        await asyncio.gather(server, return_exceptions=True)

    asyncio.run(session())
    assert len(simulator.autopilot.channels) <= 2


def test_serving_ends_when_told_to():
    simulator = Simulator(plain_mission(), seed=1)
    port = free_port(socket.SOCK_DGRAM)
    asyncio.run(serve(simulator, f"udpin://127.0.0.1:{port}", 50.0, lambda: simulator.now_s >= 5.0))
    assert simulator.now_s == pytest.approx(5.0, abs=0.03)
    assert math.isfinite(simulator.truth.path[-1][1])


def test_its_end_is_quiet_while_a_client_is_there():
    simulator, said = Simulator(plain_mission(), seed=1), []
    port = free_port(socket.SOCK_STREAM)

    async def session() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: said.append(context))
        server = asyncio.create_task(serve(simulator, f"tcp://127.0.0.1:{port}", speed=20.0))
        await asyncio.sleep(0.1)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        await heartbeats(reader, 1)
        server.cancel()
        await asyncio.gather(server, return_exceptions=True)
        (task,) = asyncio.all_tasks() - {asyncio.current_task()}  # what serves this client
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        writer.close()
        await writer.wait_closed()

    asyncio.run(session())
    assert said == []


@pytest.mark.parametrize("url", ["serial:///dev/ttyS0:57600", "tcp://127.0.0.1", "udpin://:x", "nonsense"])
def test_an_address_that_cannot_be_listened_on_is_said_so(url):
    with pytest.raises(LinkError, match="expected udpin://"):
        address_of(url)


def test_a_port_in_use_is_a_link_error():
    simulator = Simulator(plain_mission(), seed=1)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(LinkError):
            asyncio.run(serve(simulator, f"tcp://127.0.0.1:{taken.getsockname()[1]}"))


@pytest.mark.parametrize(("dialect", "is_at_once"), [(Dialect.PX4, True), (Dialect.ARDUPILOT, False)])
def test_a_px4_answers_at_once_and_an_arduplane_in_its_next_turn(dialect, is_at_once):
    """The real ones ask for the next item after 2.2 ms and 20 ms; here no turn comes within a minute."""
    simulator = Simulator(plain_mission(), seed=1, dialect=dialect)
    port = free_port(socket.SOCK_STREAM)
    mav = mavlink.MAVLink(None, srcSystem=255)
    count = mavlink.MAVLink_mission_count_message(1, 1, 3).pack(mav)

    async def session() -> bool:
        server = asyncio.create_task(serve(simulator, f"tcp://127.0.0.1:{port}", speed=1.0 / 3000.0))
        await asyncio.sleep(0.1)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(count)
        try:
            async with asyncio.timeout(20.0 if is_at_once else 0.2):
                messages = mavlink.MAVLink(None).parse_buffer(await reader.read(4096))
            return [message.get_type() for message in messages] == ["MISSION_REQUEST_INT"]
        except TimeoutError:
            return False
        finally:
            writer.close()
            server.cancel()
            await asyncio.gather(server, return_exceptions=True)

    assert asyncio.run(session()) is is_at_once
