"""A recording as a picture: an MCAP with Foxglove's schemas, and a layout that opens it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from mcap.writer import CompressionType, Writer

from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording import scene_update as scenes
from companion.recording.flight_pictures import LOG, SCENE, TRANSFORM, Pictures
from companion.recording.mcap_reader import messages_of, number, utc_of
from companion.recording.mcap_writer import plain
from companion.safe_files import open_to_write

NAMES = {
    SCENE: "foxglove.SceneUpdate",
    TRANSFORM: "foxglove.FrameTransform",
    LOG: "foxglove.Log",
    channels.LOCATION: "foxglove.LocationFix",
}


def export_flight(flight: Path, target: Path) -> Path:
    """Write a flight's recording as a picture for Foxglove, and beside it a layout.

    What was recorded is in it, too, under its own topics.

    Parameters
    ----------
    flight : Path
        ``flight.mcap``.
    target : Path
        The picture, made anew.

    Returns
    -------
    Path
        The layout, to be imported in Foxglove.

    Raises
    ------
    RecordError
        If there is no message in the recording, or the target cannot be written.
    """
    pictures, layout = Pictures(), target.with_suffix(".layout.json")
    num_messages = 0
    try:
        with open_to_write(target) as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start("", "companion")
            ids = _registered(writer)
            for topic, told in messages_of(flight, Counter()):
                if topic not in ids:
                    continue
                num_messages += 1
                shown = list(pictures.of(topic, told))
                utc_s = utc_of(told)
                if utc_s is None:
                    utc_s = pictures.epoch_s + (number(told.get("stamp_s")) or 0.0)
                for name, stamp_s, message in ((topic, utc_s, told), *shown):
                    stamp = max(0, round(1e9 * stamp_s))
                    data = json.dumps(plain(message), allow_nan=False, separators=(",", ":")).encode("ascii")
                    writer.add_message(ids[name], stamp, data, stamp)
            writer.finish()
        layout.write_text(json.dumps(LAYOUT, indent=1) + "\n", encoding="ascii")
    except OSError as error:
        raise RecordError(f"{target}: {error.strerror or error}") from error
    if not num_messages:
        raise RecordError(f"{flight}: no message in it")
    return layout


def _registered(writer: Writer) -> dict[str, int]:
    """Channels of what was recorded and of the pictures, by topic."""
    schemas = {channel.topic: (channel.name, channel.schema) for channel in channels.CHANNELS}
    schemas |= {
        topic: (name, {"title": name, "type": "object"})
        for topic, name in NAMES.items()
        if topic not in schemas
    }
    return {
        topic: writer.register_channel(
            topic, "json", writer.register_schema(name, "jsonschema", json.dumps(schema).encode("ascii"))
        )
        for topic, (name, schema) in schemas.items()
    }


def _plot(title: str, path: str) -> dict[str, object]:
    return {
        "title": title, "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"}],
        "showXAxisLabels": True, "showYAxisLabels": True, "showLegend": False, "isSynced": True,
        "xAxisVal": "timestamp",
    }  # fmt: skip


LAYOUT: dict[str, object] = {
    "configById": {
        "3D!flight": {
            "followTf": scenes.MAP, "followMode": "follow-none", "topics": {SCENE: {"visible": True}},
            "cameraState": {
                "perspective": True, "distance": 6500.0, "phi": 45.0, "thetaOffset": 0.0, "fovy": 45.0,
                "near": 1.0, "far": 60000.0, "target": [0.0, 0.0, 0.0], "targetOffset": [2500.0, 2500.0, 0.0],
                "targetOrientation": [0.0, 0.0, 0.0, 1.0],
            },
            "layers": {}, "publish": {}, "scene": {}, "transforms": {}, "imageMode": {},
        },
        "map!flight": {"topics": {channels.LOCATION: {"enabled": True}}, "followTopic": channels.LOCATION},
        "RosOut!flight": {"topicToRender": LOG, "searchTerms": [], "minLogLevel": 1},
        "Plot!altitude": _plot("Altitude [m]", f"{channels.OWNSHIP}.position_enu_m[2]"),
        "Plot!threat": _plot("Threat level", f"{channels.THREAT}.level"),
    },
    "globalVariables": {},
    "userNodes": {},
    "playbackConfig": {"speed": 1},
    "layout": {
        "direction": "row", "splitPercentage": 62, "first": "3D!flight",
        "second": {
            "direction": "column", "splitPercentage": 50,
            "first": {"direction": "column", "first": "Plot!altitude", "second": "Plot!threat"},
            "second": {"direction": "column", "first": "RosOut!flight", "second": "map!flight"},
        },
    },
}  # fmt: skip
