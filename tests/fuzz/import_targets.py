"""Files that ``companion import`` reads: the first byte chooses the format, the rest is the file."""

import io
import zipfile

from companion.config import mission_from_text
from companion.config.conversion.exchange_files import READERS
from companion.config.conversion.formats.foreign_file import BYTES_MAX
from companion.config.conversion.found_places import Importer
from companion.config.conversion.mission_composition import Wishes, composed
from companion.config.conversion.mission_text import text_of_mission
from companion.errors import ConfigError
from tests.fuzz.targets import Target, Work, promise

ENDINGS = tuple(READERS)
FILE_MIN = 4096  # bytes: a shorter file is charged as the block that it takes on a disk
HOME = (-35.363261, 149.16523, 584.0)
WISHES = Wishes("fuzzed", home=HOME)


def taken_from(data):
    """What a file has."""
    ending = ENDINGS[data[0] % len(ENDINGS)] if data else ENDINGS[0]
    importer = Importer(f"fuzzed{ending}")
    READERS[ending](importer, data[1:])
    return importer


def check_import(data):
    try:
        importer = taken_from(data)
        text = text_of_mission(composed([importer], WISHES), WISHES, "fuzzed")
    except ConfigError as error:
        promise(error.key and error.expected, "an error that says nothing")
        return
    for remark in importer.remarks:
        promise(remark.startswith(importer.file), "a remark that does not name its file")
    try:
        mission = mission_from_text(text, "fuzzed.yaml")
    except ConfigError as error:
        promise(error.key not in ("syntax", "file"), f"a file that is not a mission file: {error}")
        return
    promise(mission.name == "fuzzed", "a value became a key")


def unpacked_size(data):
    """Bytes that an archive says it unpacks to, as far as a reader reads; 0 for other files."""
    try:
        with zipfile.ZipFile(io.BytesIO(data[1:])) as archive:
            return min(sum(member.file_size for member in archive.infolist()), BYTES_MAX)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, OSError, ValueError):
        return 0


def work_import(data):
    def start():
        def run():
            try:
                taken_from(data)
            except ConfigError:
                return

        return run

    return Work(max(FILE_MIN, len(data), unpacked_size(data)), start)


WORDS = (
    b'"type"', b'"features"', b'"coordinates"', b'"params"', b'"frame"', b'"command"', b"null", b"NaN",
    b"1e400", b"<!DOCTYPE", b"<kml>", b"<Placemark>", b"<coordinates>", b"<gpx", b"QGC WPL 110\n",
    b"latitude,longitude,radius\n",
)  # fmt: skip

MODULES = (
    "foreign_file", "geojson_file", "gpx_file", "item_places", "kml_file", "plan_file", "radar_table",
    "waypoint_file",
)  # fmt: skip
IMPORT_TARGETS = (
    Target(
        "import",
        check_import,
        work_import,
        tuple(f"companion.config.conversion.formats.{name}" for name in MODULES),
        words=WORDS,
    ),
)
