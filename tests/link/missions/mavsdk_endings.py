"""Readers that are cancelled and closed at any moment.

``python -m tests.link.missions.mavsdk_endings KIND NUMBER`` does it NUMBER times.

In a process of its own: what goes wrong in MAVSDK's threads ends the whole process.
"""

import asyncio
import sys
from collections import Counter

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.missions import mavsdk_reader
from companion.link.missions.mavsdk_reader import MavsdkReader

DELAYS_MS = (0, 1, 2, 4, 6, 8, 11, 14, 17, 20)
REQUEST_LIST = 43


def messages(packer, *made):
    return b"".join(message.pack(packer) for message in made)


async def ended(kind, number):
    """Begin a call, cancel it a little later, close."""
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    codec, has_asked = Codec(1), asyncio.Event()

    def take(data):
        for frame in codec.feed(data, 0.0):
            reader.receive(frame)

    def send(data):
        has_asked.set()
        if kind == "answered" and data[7] == REQUEST_LIST:
            take(messages(packer, packer.mission_count_encode(1, 195, 0)))

    reader = MavsdkReader(codec, send, Counter(), 5.0)
    take(messages(packer, packer.heartbeat_encode(1, 3, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 5, 4)))
    download = reader.download_rally_points if kind == "rally points" else reader.download
    call = asyncio.create_task(download())
    if kind == "discovery":
        await asyncio.sleep(0)
    else:
        await has_asked.wait()
    await asyncio.sleep(1e-3 * DELAYS_MS[number % len(DELAYS_MS)])
    call.cancel()
    await asyncio.gather(call, return_exceptions=True)
    if not call.cancelled() and call.exception() is not None:
        raise call.exception()
    await reader.close()


async def main():
    kind, count = sys.argv[1], int(sys.argv[2])
    for number in range(count):
        await ended(kind, number)
    sys.stdout.write(f"{count} ended, {len(mavsdk_reader._UNDESTROYED)} left alone\n")


if __name__ == "__main__":
    asyncio.run(main())
