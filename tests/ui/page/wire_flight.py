"""A flight in real time, as processes of their own: the simulator, the service with its page, and a relay.

The relay, in this process, passes datagrams on between the two, and notes by the computer's clock when the
service was told of another mode.
"""

import contextlib
import random
import re
import socket
import threading
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.wire.framing import frames_in
from tests.hostile.real_time import Relay
from tests.service.process.processes import Manager, free_port, process

ORIGIN_DEG = (-35.363261, 149.165230)
METRES_A_DEGREE = 111_194.9  # of latitude
AUTO, FBWA = 10, 5  # ArduPlane's modes
CHANGED_EVERY = 6  # tracks, some five seconds: a mode that changes more often is not believed
# Nothing on the way to a goal 220 s away: what is decided hangs on nobody's luck.
MISSION = """
name: long-way
dimension: 2
unit_m: 25
origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}
bounds: {east_m: [-500, 6500], north_m: [-2000, 3000], up_m: [60, 160]}
start: {east_m: 0, north_m: 0, up_m: 100, course_deg: 90}
goals:
  - {east_m: 5600, north_m: 500, up_m: 100}
vehicle:
  airspeed_min_m_s: 12.5
  airspeed_max_m_s: 37.5
  airspeed_cruise_m_s: 25
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: 125
  straight_length_min_m: 125
  penetration_speed_m_s: 25
planning: {sensing_horizon_m: 825, time_horizon_s: 15, total_planning_time_s: 400}
authority: {resume: auto}
"""


class WatchedRelay(Relay):
    """Notes when the service was first told each change of the autopilot's mode, and tells it of tracks."""

    def __init__(self, service_port):
        super().__init__(service_port)
        self.modes = []  # (UTC seconds, is it the mission's)
        self._theirs = mavlink.MAVLink(None)
        self._theirs.robust_parsing = True
        self._own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def _pass_on(self, line):
        if line is self.outer:
            data = line.recvfrom(65_536, socket.MSG_PEEK)[0]
            for raw in frames_in(data):
                self._watch(raw)
        super()._pass_on(line)

    def _watch(self, raw):
        for message in self._theirs.parse_buffer(raw) or []:
            if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1:
                is_mission = message.custom_mode == AUTO
                if not self.modes or self.modes[-1][1] is not is_mission:
                    self.modes.append((time.time(), is_mission))

    def select(self, mode):
        """The pilot's switch: the simulator tells it with its next heartbeat."""
        pilot = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        told = mavlink.MAVLink_set_mode_message(1, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)
        self.outer.sendto(told.pack(pilot), self._simulator)

    def report(self, address, east_m, north_m):
        """Tell the service of an aircraft; the instant at which that was done [s of UTC]."""
        latitude = ORIGIN_DEG[0] + north_m / METRES_A_DEGREE
        # A hundredth of a degree of longitude is 907 m here.
        longitude = ORIGIN_DEG[1] + east_m / 90_693.0
        told = mavlink.MAVLink_adsb_vehicle_message(
            address, round(1e7 * latitude), round(1e7 * longitude), 1, 700_000, 9_000, 500, 0, b"TEST", 1, 0,
            mavlink.ADSB_FLAGS_VALID_COORDS | mavlink.ADSB_FLAGS_VALID_ALTITUDE
            | mavlink.ADSB_FLAGS_VALID_HEADING | mavlink.ADSB_FLAGS_VALID_VELOCITY,
            1200,
        )  # fmt: skip
        data = told.pack(self._own)
        stamp_s = time.time()
        self.inner.sendto(data, self._service)
        return stamp_s


class WireFlight:
    """The processes; a context. ``page`` says whether the service has one."""

    def __init__(self, folder, *, page=True, mission=MISSION):
        self._folder = folder
        self._mission = mission
        self.page_port = free_port() if page else None
        self._parts = contextlib.ExitStack()

    def __enter__(self):
        file = self._folder / "long-way.yaml"
        file.write_text(self._mission, encoding="utf-8")
        port = free_port(socket.SOCK_DGRAM)
        self.relay = WatchedRelay(port)
        self.relay.start()
        self._parts.callback(self.relay.end)
        manager = Manager()
        self._parts.callback(manager.close)
        paged = ("--page", self.page_port) if self.page_port else ()
        self.service = self._parts.enter_context(
            process(
                "-m", "companion", "run", file, "--link", f"udpin://127.0.0.1:{port}",
                "--record", self._folder / "flights", *paged, environment=manager.environment,
            )
        )  # fmt: skip
        threading.Thread(target=self.service.stdout.read, daemon=True).start()
        manager.hear_until(lambda words: "waiting for the first" in words.get("STATUS", ""))
        self._parts.enter_context(
            process("-m", "sim", file, "--listen", f"udpout://127.0.0.1:{self.relay.port}")
        )
        manager.hear_until(lambda words: "READY" in words)
        return self

    def __exit__(self, *_):
        self._parts.close()


# Notes, in the page, when each moving threat, and each answer to what the pilot can do, was to be seen: at
# the beginning of the picture after the one in which it was drawn, so not before that is handed over.
WATCH = """
const {page} = window.companionPage;
const seen = (window.seenOnPage = {tracks: {}, words: []});
const wall = () => (performance.timeOrigin + performance.now()) / 1e3;
const place = (track) => {
  const [x, y] = page.map.pixelOf(track.position_enu_m);
  const at = page.map.canvas.getContext("2d").getImageData(x * page.map.ratio, y * page.map.ratio, 1, 1);
  return [...at.data].slice(0, 3).join();
};
const drawn = page.noteFrame.bind(page);
page.noteFrame = (took) => {
  drawn(took);
  const fresh = page.store.tracks.filter((track) => !(track.identity in seen.tracks));
  for (const track of fresh) seen.tracks[track.identity] = null;
  const colours = fresh.map(place);
  requestAnimationFrame(() => {
    fresh.forEach((track, i) => (seen.tracks[track.identity] = [wall(), colours[i]]));
  });
};
const word = document.querySelector("#pilot");
new MutationObserver(() => {
  const text = word.innerText;
  requestAnimationFrame(() => seen.words.push([wall(), text]));
}).observe(word, {childList: true, characterData: true, subtree: true});
"""


def measured(flight, window, num_tracks=60, seed=1):
    """Milliseconds from the wire to the pixel: of tracks, and of the pilot's taking over and handing back.

    Returns
    -------
    tracks, modes : list of float
        [ms], of each.
    colours : set of str
        What the pixel was where each track was drawn.
    """
    rng = random.Random(seed)
    sent, mode = {}, AUTO
    before = len(flight.relay.modes)
    for number in range(num_tracks):
        time.sleep(rng.uniform(0.6, 1.1))  # at any phase of what the service does
        address = 0xA00000 + number
        sent[f"icao:{address:06X}"] = flight.relay.report(
            address, 500.0 + 500.0 * (number % 10), 1_000.0 + 300.0 * (number // 10)
        )
        if number % CHANGED_EVERY == 0:
            mode = FBWA if mode == AUTO else AUTO
            flight.relay.select(mode)
    window.until("arguments[0].every((name) => window.seenOnPage.tracks[name])", list(sent))
    seen = window.run("return window.seenOnPage")
    tracks = [1e3 * (seen["tracks"][name][0] - stamp) for name, stamp in sent.items()]
    colours = {seen["tracks"][name][1] for name in sent}
    return tracks, _mode_changes(flight.relay.modes[before:], seen["words"]), colours


def _mode_changes(modes, words):
    """From each change of the mode to the words that tell it."""
    found = []
    for stamp, is_mission in modes:
        told = (
            at
            for at, text in words
            if at >= stamp and bool(re.match("Hand back|You fly", text)) is not is_mission
        )
        found.append(1e3 * (next(told) - stamp))
    return found
