"""Export of a recording for Foxglove: an MCAP file with Foxglove's schemas, and a layout that shows it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import cast

from mcap.writer import CompressionType, Writer

from companion.config import MissionConfig
from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording import scene_update as scenes
from companion.recording.flight_pictures import LOG, SCENES, TRANSFORM, Pictures, extent_of
from companion.recording.mcap_reader import messages_of, number, utc_of
from companion.recording.mcap_writer import plain, registered
from companion.safe_files import open_to_write

NAMES = {
    **dict.fromkeys(SCENES, "foxglove.SceneUpdate"),
    TRANSFORM: "foxglove.FrameTransform",
    LOG: "foxglove.Log",
    channels.LOCATION: "foxglove.LocationFix",
}
_STAMP_MAX = 2**64 - 1  # Largest timestamp [ns] that a message can have.
_AXES_SHARE = 0.03  # Length of the aircraft's axes in the picture, as a share of the mission's size.


def export_flight(flight: Path, target: Path) -> Path:
    """Write the picture of a recording for Foxglove, and a layout next to it.

    The picture also contains the recorded messages under their own topics.

    Parameters
    ----------
    flight : Path
        ``flight.mcap``.
    target : Path
        The picture; an existing file is replaced.

    Returns
    -------
    Path
        The layout, to be imported in Foxglove.

    Raises
    ------
    RecordError
        If the recording contains no message, or the target cannot be written.
    """
    pictures, layout = Pictures(), target.with_suffix(".layout.json")
    num_messages = 0
    try:
        with open_to_write(target) as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start("", "companion")
            ids = registered(writer, _schemas())
            for topic, document in messages_of(flight, Counter()):
                if topic not in ids:
                    continue
                num_messages += 1
                shown = list(pictures.of(topic, document))
                utc_s = utc_of(document)
                if utc_s is None:
                    utc_s = pictures.epoch_s + (number(document.get("stamp_s")) or 0.0)
                for name, stamp_s, message in ((topic, utc_s, document), *shown):
                    stamp = min(max(0, round(1e9 * stamp_s)), _STAMP_MAX)
                    known = _known(cast("dict[str, object]", plain(message)))
                    data = json.dumps(known, allow_nan=False, separators=(",", ":")).encode("ascii")
                    writer.add_message(ids[name], stamp, data, stamp)
            writer.finish()
        layout.write_text(json.dumps(layout_of(pictures.mission), indent=1) + "\n", encoding="ascii")
    except OSError as error:
        raise RecordError(f"{target}: {error.strerror or error}") from error
    if not num_messages:
        raise RecordError(f"{flight}: no message in it")
    return layout


def readable(schema: channels.Schema) -> channels.Schema:
    """Reduce a channel's schema to what viewers accept: one type per key, no arrays of arrays.

    Viewers refuse topics with any other schema. Messages keep the keys that the schema omits.

    Parameters
    ----------
    schema : dict
        JSON schema of a channel, whose keys may be null.
    """
    keys = cast("dict[str, channels.Schema]", schema["properties"])
    kinds = {key: _one_type(kind) for key, kind in keys.items()}
    return {**schema, "properties": {key: kind for key, kind in kinds.items() if kind is not None}}


def _one_type(kind: channels.Schema) -> channels.Schema | None:
    """Return a key's schema without null; None for arrays of arrays."""
    of_json = kind["type"]
    one = {**kind, "type": of_json[0] if isinstance(of_json, list) else of_json}
    if "items" in one:
        one["items"] = items = _one_type(cast("channels.Schema", one["items"]))
        return None if items is None or items["type"] == "array" else one
    return one


def _known(message: Mapping[str, object]) -> dict[str, object]:
    """Return a message without keys that are null or contain null."""
    return {
        key: value
        for key, value in message.items()
        if value is not None and not (isinstance(value, list) and None in value)
    }


def _schemas() -> dict[str, tuple[str, channels.Schema]]:
    """Name and schema of each topic of the recording and of the pictures."""
    recorded = {channel.topic: (channel.name, readable(channel.schema)) for channel in channels.CHANNELS}
    drawn: dict[str, tuple[str, channels.Schema]] = {
        topic: (name, {"title": name, "type": "object"}) for topic, name in NAMES.items()
    }
    return {**drawn, **recorded}


def _titled(title: str) -> dict[str, object]:
    """Return a panel's title, for Foxglove and Lichtblick."""
    return {"foxglovePanelTitle": title, "lichtblickPanelTitle": title}


def _plot(title: str, path: str) -> dict[str, object]:
    return {
        **_titled(title), "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"}],
        "showXAxisLabels": True, "showYAxisLabels": True, "showLegend": False, "isSynced": True,
        "xAxisVal": "timestamp",
    }  # fmt: skip


def layout_of(mission: MissionConfig | None) -> dict[str, object]:
    """Return a layout that shows a picture: the flight seen from the south, plots, decisions and a map.

    Parameters
    ----------
    mission : MissionConfig, optional
        Mission of the flight; the view covers its bounds.
    """
    east, north, size_m = (0.0, 0.0, 5_000.0) if mission is None else extent_of(mission)
    eye = {
        "perspective": True, "distance": 1.5 * size_m, "phi": 45.0, "thetaOffset": 0.0, "fovy": 45.0,
        "near": 1.0, "far": 12.0 * size_m, "target": [0.0, 0.0, 0.0], "targetOffset": [east, north, 0.0],
        "targetOrientation": [0.0, 0.0, 0.0, 1.0],
    }  # fmt: skip
    axes = {"enablePreloading": True, "axisScale": _AXES_SHARE * size_m, "lineWidth": 0}
    return {
        "configById": {
            "3D!flight": {
                "followTf": scenes.MAP, "followMode": "follow-none",
                "topics": {topic: {"visible": True} for topic in SCENES}, "cameraState": eye,
                "scene": {"transforms": axes}, "layers": {}, "publish": {}, "transforms": {},
                "imageMode": {}, **_titled("Flight"),
            },
            "map!flight": {
                "topics": {channels.LOCATION: {"enabled": True}}, "followTopic": channels.LOCATION,
                **_titled("Map"),
            },
            "RosOut!flight": {
                "topicToRender": LOG, "searchTerms": [], "minLogLevel": 1, **_titled("Decisions")
            },
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
