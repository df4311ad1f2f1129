"""A real autopilot as a process, in a folder of its own and on this computer's loopback alone."""

import os
import subprocess
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mavlink

PORT_OPERATOR, PORT_SERVICE, PORT_COMPANION, PORT_RADIO = 21600, 21700, 21800, 21900  # plus the instance


@dataclass(frozen=True)
class Kind:
    """What a flight has to know of a kind of autopilot.

    Parameters
    ----------
    name : str
        As in the table of flights.
    factor : float
        Size of the map, against the paper's, that its aircraft flies.
    vehicle : dict
        Keys of the mission file's ``vehicle`` that its aircraft needs.
    modes : dict
        Parameters of DO_SET_MODE by what the pilot wants.
    loiter_radius_m : float
        Of the circle that a pilot's hold is.
    num_home_items : int
        Items of its list in front of the mission.
    altitude_amsl_m : float
        Of the runway. The PX4 that was measured begins its height reference at the sea and lets it climb at
        5 m/s: from a high runway it dives until that is there.
    """

    name: str
    factor: float
    vehicle: dict
    modes: dict = field(hash=False)
    loiter_radius_m: float
    num_home_items: int
    altitude_amsl_m: float


ARDUPLANE = Kind(
    "arduplane", 1.0,
    {"airspeed_min_m_s": 12.0, "airspeed_max_m_s": 30.0, "airspeed_cruise_m_s": 22.0},
    {"mission": (10, 0), "hold": (12, 0), "return": (11, 0)}, 80.0, 1, 584.0,
)  # fmt: skip
PX4 = Kind(
    "px4", 0.56,
    {"airspeed_min_m_s": 10.0, "airspeed_max_m_s": 20.0, "airspeed_cruise_m_s": 14.0,
     "climb_angle_max_deg": 8, "descent_angle_max_deg": 7},
    {"mission": (4, 4), "hold": (4, 3), "return": (4, 5)}, 80.0, 0, 10.0,
)  # fmt: skip
KINDS = {kind.name: kind for kind in (ARDUPLANE, PX4)}


def is_mission_mode(kind, custom_mode):
    """Whether a heartbeat's mode is the one that flies the mission."""
    main, sub = kind.modes["mission"]
    return custom_mode == (main if kind is ARDUPLANE else sub << 24 | main << 16)


@dataclass
class Autopilot:
    """A running autopilot.

    Parameters
    ----------
    kind : Kind
        Which.
    binary : Path
        The user's own.
    parameters : str
        ArduPlane's files of parameters, with commas between them.
    folder : Path
        Its working directory, made anew.
    instance : int
        Number that its ports and locks follow from.
    home : tuple of float
        Latitude, longitude [deg], altitude [m]; it heads north.
    system_id : int
        Of an ArduPlane. That of a PX4 is its instance and one.
    has_radio : bool
        Whether an ArduPlane has a third link, to other aircraft. A PX4 always has one.
    """

    kind: Kind
    binary: object
    parameters: str
    folder: object
    instance: int
    home: tuple
    system_id: int = 1
    has_radio: bool = False
    process: subprocess.Popen | None = None

    def __post_init__(self):
        if self.kind is PX4:
            self.system_id = self.instance + 1

    @property
    def operator_url(self):
        """Where pymavlink finds it."""
        if self.kind is ARDUPLANE:
            return f"udpin:127.0.0.1:{PORT_OPERATOR + self.instance}"
        return f"udpout:127.0.0.1:{18570 + self.instance}"

    @property
    def companion_port(self):
        """Port to which it sends what a companion computer gets."""
        return (PORT_COMPANION if self.kind is ARDUPLANE else 14540) + self.instance

    @property
    def radio_port(self):
        """Port to which it sends what other aircraft get."""
        return (PORT_RADIO if self.kind is ARDUPLANE else 14030) + self.instance

    def start(self, wind=(0.0, 0.0)):
        """Start it; it runs in real time.

        Parameters
        ----------
        wind : tuple of float
            Speed [m/s], and where it comes from [deg].
        """
        self.folder.mkdir(parents=True)
        begin = self._arduplane if self.kind is ARDUPLANE else self._px4
        command, environment = begin(wind)
        with (self.folder / "console.txt").open("w") as console:
            self.process = subprocess.Popen(
                command, cwd=self.folder, env={**os.environ, **environment}, stdin=subprocess.DEVNULL,
                stdout=console, stderr=subprocess.STDOUT,
            )  # fmt: skip

    def _arduplane(self, wind):
        extra = self.folder / "flight.parm"
        wanted = {"RTL_AUTOLAND": 2, "SIM_WIND_SPD": wind[0], "SIM_WIND_DIR": wind[1], "LOG_DISARMED": 0}
        radio = ()
        if self.has_radio:  # The positions' rate, by its name up to 4.7 and by that of later versions.
            wanted |= {"MAV_SYSID": self.system_id, "SYSID_THISMAV": self.system_id}
            wanted |= {"SERIAL2_PROTOCOL": 2, "SR2_POSITION": 2, "MAV3_POSITION": 2}
            radio = "--serial2", f"udpclient:127.0.0.1:{self.radio_port}"
        extra.write_text("".join(f"{name} {value}\n" for name, value in wanted.items()))
        files = ",".join(filter(None, (self.parameters, str(extra))))
        latitude, longitude, altitude = self.home
        return [
            str(self.binary), "--model", "plane", "--speedup", "1", "--wipe", f"-I{self.instance}",
            "--home", f"{latitude:.7f},{longitude:.7f},{altitude:.1f},0",
            "--serial0", f"udpclient:127.0.0.1:{PORT_OPERATOR + self.instance}",
            "--serial1", f"udpclient:127.0.0.1:{self.companion_port}",
            *radio, "--defaults", files,
        ], {}  # fmt: skip

    def _px4(self, _wind):
        latitude, longitude, altitude = self.home
        etc = self.binary.parents[1] / "etc"
        return [
            str(self.binary), "-d", "-i", str(self.instance), "-w", str(self.folder), str(etc),
        ], {
            "PX4_SIM_MODEL": "sihsim_airplane",
            "PX4_HOME_LAT": f"{latitude:.7f}",
            "PX4_HOME_LON": f"{longitude:.7f}",
            "PX4_HOME_ALT": f"{altitude:.1f}",
        }  # fmt: skip

    def stop(self):
        """End it."""
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(5.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()


def coordinate_frame(item):
    """Frame of an item that is uploaded: its own, relative to home, or none."""
    if item.frame is not None:
        return item.frame
    if item.command == mavlink.MAV_CMD_NAV_RALLY_POINT:  # a PX4 returns by no other
        return mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    return mavlink.MAV_FRAME_MISSION if item.place is None else mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
