"""Makes the stored corpora from the recordings in tests: ``python -m tests.fuzz.seeds``.

Inputs whose names begin with ``regression`` or ``found`` are left alone: they were found, and are kept.
"""

import hashlib
import io
import itertools
import shutil
import zipfile
from pathlib import Path

from companion.link.wire.framing import raw_frame
from companion.link.wire.tlog import read_tlog
from tests.fuzz.file_targets import MAGIC
from tests.fuzz.import_targets import ENDINGS
from tests.fuzz.link_targets import LISTENED
from tests.fuzz.mission_targets import (
    AGAIN,
    ANSWER,
    AS_IT_IS,
    EXCHANGED,
    LONG_WAIT,
    MISSION,
    REFUSAL,
    TELLING,
    VALUES,
    WAITING,
)
from tests.fuzz.scripts import EXTRAS, IDS, V1, record_of
from tests.fuzz.targets import CORPUS

TESTS = Path(__file__).parents[1]
LOGS = (
    TESTS / "data" / "arduplane-4.7dev-replace.tlog",
    TESTS / "data" / "px4-1.17dev-replace.tlog",
    TESTS / "service" / "replay" / "recordings" / "first-flight-ardupilot.tlog",
)
KINDS_MAX = 16
KEPT = ("regression", "found")
MISSION_COUNT = 44


def entries(log):
    return [(round(entry.time_s * 1e6), entry.raw) for entry in read_tlog(log)]


def one_of_each(frames, most):
    """The first frame of each message, the rarest messages first."""
    found = {}
    for raw in frames:
        found.setdefault(raw_frame(raw).message_id, []).append(raw)
    by_number = sorted(found.values(), key=len)
    return [rows[0] for rows in by_number][:most]


def frame_seeds(head, ids):
    """Scripts of frames that were recorded: single ones, several, under both versions, damaged."""
    for log in LOGS:
        frames = [raw for _, raw in entries(log) if raw_frame(raw).message_id in set(ids) & EXTRAS.keys()]
        kinds = one_of_each(frames, KINDS_MAX)
        yield head + b"".join(record_of(raw, ids) for raw in kinds[:6])
        yield head + b"".join(record_of(raw, ids, V1) for raw in kinds[:6])
        yield head + b"".join(bytes((kind,)) + record_of(raw, ids)[1:] for kind, raw in enumerate(kinds[:8]))
        yield from (head + record_of(raw, ids) for raw in kinds)


def exchange_seeds():
    """Whole exchanges of missions that were recorded."""
    for number, log in enumerate(LOGS[:2]):
        frames = [raw for _, raw in entries(log) if raw_frame(raw).message_id in EXCHANGED[:-2]]
        starts = [at for at, raw in enumerate(frames) if raw_frame(raw).message_id == MISSION_COUNT]
        for start, end in itertools.pairwise([*starts, len(frames)]):
            script = b"".join(record_of(raw, EXCHANGED) for raw in frames[start : min(end, start + 40)])
            yield bytes((number + 1,)) + script[:3500]


def mission_seeds():
    """The mission files of this project, and a script for each odd value."""
    for path in sorted((TESTS.parent / "mission_configs").glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        lines = [
            line.partition(" #")[0].rstrip()
            for line in text.splitlines()
            if not line.lstrip().startswith("#")
        ]
        yield bytes((AS_IT_IS,)) + "\n".join(lines).encode()[:2000]
    num_lines = len(MISSION.splitlines())
    for value in range(len(VALUES)):
        yield bytes((0, 1, value * 5 % num_lines, value))
    for place in range(7, num_lines):
        yield bytes((0, 8, place, 250))


def transfer_seeds():
    """Uploads and readings as they should go, and as an autopilot goes astray."""
    upload, reading = bytes((0,)), bytes((128,))
    accepted, out_of_order = bytes((TELLING, 0, 7, 0, 0, 0)), bytes((REFUSAL, 13, 0, 0, 0, 0))
    questions = b"".join(bytes((ANSWER, number, 1)) for number in range(5))
    yield upload + bytes((0, 4, 3)) + questions + accepted
    yield upload + bytes((1, 9, 0)) + bytes((ANSWER, 1, 1, LONG_WAIT, 20, 0)) + questions + accepted
    yield upload + bytes((0, 19, 1)) + out_of_order * 3 + questions + bytes((AGAIN, 0, 1, WAITING, 90, 255))
    for result in (1, 4, 14, 15):
        yield upload + bytes((0, 2, 1)) + bytes((LONG_WAIT, 9, 0, REFUSAL, result, 0, 0, 0, 0)) + questions
    items = b"".join(bytes((ANSWER, number, 16, 1)) for number in range(4))
    yield reading + bytes((5, TELLING, 1, 4, 1)) + items
    yield reading + bytes((1, TELLING, 1, 200, 1, LONG_WAIT, 9, WAITING, 9)) + items[::-1]
    yield reading + bytes((0, TELLING, 1, 0, 1, WAITING, 30))
    yield reading + bytes((7, TELLING, 1, 3, 1)) + items + bytes((REFUSAL, 1, 0))


def signer_seeds():
    """Frames signed in order, repeated, changed, forged, at any time; and our own."""
    for kind in range(8):
        yield bytes((0, 0, 0, 0, 1, 0, 9)) + bytes(9) + bytes((kind, 0, 1, 2, 3, 4, 5, 6, 7, 8)) * 3
    yield b"".join(bytes((kind, 1, 0, 0, 4, 0, 3, 1, 2, 3, 9)) for kind in (0, 2, 0, 3, 3, 2, 6, 7, 0, 6))
    yield bytes((1, 0, 0, 0, 1, 0, 2, 5, 5, 1)) + (2**48 - 3).to_bytes(6, "little") + bytes((6, 1, 2, 3)) * 3


def mcap_seeds():
    """Small files of every kind of record, and the beginning of a recording."""
    document = bytes((3, 2, 0, 4, 1, 2))
    about = bytes((0, 0, 0))
    yield bytes((1,)) + about + bytes((2, 0, 1, 0, 0)) + document
    for compression, size in itertools.product(range(3), (0, 3, 5, 7)):
        inside = about + bytes((2, 0, 5, 0, 0)) + document
        yield bytes((1, 7, 2)) + inside + bytes((compression, 200, size, 0))
    for kind in range(8):
        yield bytes((0,)) + about + bytes((2, 0, 1, 0, 0, kind, 3, 0, 1, 5, 2))
    for choice in range(4):
        yield bytes((0,)) + about[:1] + bytes((1, 0, 10, choice, choice % 2, 2))
    yield bytes((0, 11, 4, 1, 2, 3, 4, 9, 9, 9, 5, 3))
    whole = (TESTS / "service" / "replay" / "recordings" / "first-flight-px4.mcap").read_bytes()
    yield bytes((AS_IT_IS,)) + whole[:3500]
    yield bytes((AS_IT_IS,)) + MAGIC


def tlog_seeds():
    """The beginnings of recordings, and scripts of frames with odd stamps."""
    for log in LOGS:
        rows = entries(log)[:40]
        yield bytes((AS_IT_IS,)) + b"".join(stamp.to_bytes(8, "big") + raw for stamp, raw in rows)[:2500]
        frames = [raw for _, raw in rows if raw_frame(raw).message_id in EXTRAS]
        script = b"".join(record_of(raw, IDS) for raw in one_of_each(frames, 8))
        for stamps in (bytes(8), bytes((0, 250, 0, 251, 252, 0, 253, 254))):
            yield bytes((1,)) + stamps + script
    yield bytes((1,)) + bytes(8) + bytes((4, 20)) + bytes(range(20)) + script


def import_seeds():
    """A small file of each format, and one of each that is broken at a place that matters."""
    place = b"-35.35 149.18 80"
    waypoints = b"QGC WPL 110\n0 1 0 16 0 0 0 0 -35.36 149.16 584 1\n1 0 3 16 0 0 0 0 " + place + b" 1\n"
    fence = b"QGC WPL 110\n" + b"".join(
        b"%d 0 3 5001 3 0 0 0 -35.3%d 149.1 0 1\n" % (n, n) for n in (1, 2, 3)
    )
    point = b"<Point><coordinates>149.18,-35.35</coordinates></Point>"
    kml = b"<kml><Folder><name>Goals</name><Placemark>" + point + b"</Placemark></Folder></kml>"
    gpx = b'<gpx version="1.1"><rte><rtept lat="-35.35" lon="149.18"><ele>700</ele></rtept></rte></gpx>'
    feature = b'{"type":"Feature","properties":{"kind":"goal","up_m":90},"geometry":'
    geojson = feature + b'{"type":"Point","coordinates":[149.18,-35.35]}}'
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as target:
        target.writestr(zipfile.ZipInfo("doc.kml"), kml)
    files = {
        ".plan": [(TESTS.parent / "docs" / "own-mission" / "field.plan").read_bytes()],
        ".waypoints": [waypoints, fence],
        ".kml": [kml, b"<!DOCTYPE kml><kml/>"],
        ".kmz": [archive.getvalue()],
        ".geojson": [geojson, geojson.replace(b"-35.35", b"95")],
        ".gpx": [gpx],
        ".csv": [(TESTS.parent / "docs" / "own-mission" / "radars.csv").read_bytes()],
    }
    for ending, contents in files.items():
        for content in contents:
            text = b" ".join(content.split()) if ending == ".plan" else content
            yield bytes((ENDINGS.index(ending),)) + text


def all_seeds():
    """Inputs by target."""
    return {
        "framer": frame_seeds(bytes((0, 16, 63)), IDS),
        "codec": frame_seeds(bytes((1,)), LISTENED),
        "signer": signer_seeds(),
        "transfer": transfer_seeds(),
        "sniffer": exchange_seeds(),
        "mission_file": mission_seeds(),
        "import": import_seeds(),
        "mcap": mcap_seeds(),
        "tlog": tlog_seeds(),
    }


def name_of(data):
    """A name that an input has wherever it was found."""
    return hashlib.sha256(data).hexdigest()[:16]


def write(folder=CORPUS):
    """Write the corpora anew, but for what was found."""
    for name, seeds in all_seeds().items():
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        for path in place.glob("seed-*"):
            path.unlink()
        for data in seeds:
            (place / f"seed-{name_of(data)}").write_bytes(data)
    for path in folder.iterdir():
        if path.name not in all_seeds():
            shutil.rmtree(path)


if __name__ == "__main__":
    write()
