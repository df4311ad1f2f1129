"""The archive of an image: what its configuration says, what is in its layer, and what is left out."""

import gzip
import hashlib
import io
import json
import signal
import tarfile

import pytest

from tests.packaging.tools import loaded

image_archive = loaded("image_archive")
prove_image = loaded("prove_image")


@pytest.fixture
def stage(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1795860000")
    root = tmp_path / "root"
    for name, text in {
        "opt/companion/bin/companion": "the program", "opt/wheels/one.whl": "of this computer",
        "etc/pip.conf": "of this computer", "etc/resolv.conf": "of this computer", "etc/passwd": "users",
        "tmp/rest": "of a build", "root/.cache/pip": "of a build", "var/lib/companion/.keep": "",
    }.items():  # fmt: skip
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return prove_image.Stage(
        root, {"PATH": "/opt/companion/bin"}, "companion", "/var/lib/companion", ["companion"], ["--help"],
        ["companion", "health"], {"Interval": 10, "StartPeriod": 60}, 3, signal.SIGTERM,
    )  # fmt: skip


def parts_of(archive):
    with tarfile.open(archive) as packed:
        return {entry.name: packed.extractfile(entry).read() for entry in packed.getmembers()}


def test_the_archive_is_as_docker_saves_one(stage, tmp_path):
    archive = image_archive.image_archive(stage, "1.2.3", "amd64", tmp_path)
    assert archive.name == "safe-rrt-companion_1.2.3_amd64.image.tar"
    parts = parts_of(archive)
    (entry,) = json.loads(parts["manifest.json"])
    assert entry["RepoTags"] == ["safe-rrt-companion:1.2.3"]
    text = parts[entry["Config"]]
    assert entry["Config"] == f"{hashlib.sha256(text).hexdigest()}.json"
    about = json.loads(text)
    (layer,) = entry["Layers"]
    unpacked = gzip.decompress(parts[layer])
    assert about["rootfs"]["diff_ids"] == [f"sha256:{hashlib.sha256(unpacked).hexdigest()}"]
    assert (about["architecture"], about["os"], about["created"]) == (
        "amd64",
        "linux",
        "2026-11-28T10:00:00Z",
    )
    assert about["config"] == {
        "User": "companion", "Env": ["PATH=/opt/companion/bin"], "Entrypoint": ["companion"],
        "Cmd": ["--help"], "WorkingDir": "/var/lib/companion", "StopSignal": "SIGTERM",
        "Healthcheck": {
            "Test": ["CMD", "companion", "health"], "Interval": 10_000_000_000, "StartPeriod": 60_000_000_000,
            "Retries": 3,
        },
    }  # fmt: skip


def test_nothing_of_this_computer_is_in_the_layer(stage, tmp_path):
    parts = parts_of(image_archive.image_archive(stage, "1.2.3", "amd64", tmp_path))
    with tarfile.open(fileobj=io.BytesIO(gzip.decompress(parts["layer.tar.gz"]))) as layer:
        files = sorted(entry.name for entry in layer.getmembers() if entry.isfile())
    assert files == ["./etc/passwd", "./opt/companion/bin/companion", "./var/lib/companion/.keep"]


def test_the_health_check_of_the_dockerfile_is_read_with_its_times(tmp_path):
    builder = prove_image.Builder(tmp_path, tmp_path)
    builder._stages["it"] = prove_image.Stage(tmp_path)
    builder._healthcheck(
        '--interval=10s --timeout=5s --start-period=60s --retries=4 CMD ["companion", "health"]'
    )
    assert builder.stage.health == ["companion", "health"]
    assert builder.stage.health_times_s == {"Interval": 10, "Timeout": 5, "StartPeriod": 60}
    assert builder.stage.health_retries == 4
