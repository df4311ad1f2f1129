"""Packs the image that the Dockerfile describes into an archive for ``docker load`` and ``podman load``.

The archive has one layer. Its base is the Debian that stands in for the Dockerfile's base image, see
prove_image.py. Nothing by which this computer reaches its package registries is in it.

References
----------
OCI image specification 1.1, "Image Configuration"; Docker's ``docker save`` for the archive's layout.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import logging
import os
import shutil
import subprocess
import tarfile
import time
from pathlib import Path
from typing import Any

from prove_deb import NAME, Debian, must
from prove_image import MISSION, Stage

LAYER, PACKED_LAYER, MANIFEST = "layer.tar", "layer.tar.gz", "manifest.json"
# What is made anew when a container starts, what belongs to this computer, and what only a build needs.
LEFT_OUT = (
    "proc/*", "sys/*", "dev/*", "run/*", "tmp/*", "etc/pip.conf", "etc/resolv.conf", "root/.cache",
    "var/cache/apt/*", "var/lib/apt/lists/*",
)  # fmt: skip
KEPT_OF_OPT = "companion"
NANOSECONDS = 1_000_000_000

log = logging.getLogger("deb")


def configuration(stage: Stage, architecture: str, layer_digest: str) -> dict[str, Any]:
    """Return an image's configuration.

    Parameters
    ----------
    stage : Stage
        The image.
    architecture : str
        As Debian and OCI both call it, such as ``amd64``.
    layer_digest : str
        SHA-256 of the layer, in hexadecimal digits.
    """
    made = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(float(os.environ["SOURCE_DATE_EPOCH"])))
    return {
        "architecture": architecture,
        "os": "linux",
        "created": made,
        "config": {
            "User": stage.user,
            "Env": [f"{key}={value}" for key, value in stage.environment.items()],
            "Entrypoint": stage.entry,
            "Cmd": stage.command,
            "WorkingDir": stage.folder,
            "StopSignal": stage.stop.name,
            "Healthcheck": {
                "Test": ["CMD", *stage.health],
                **{key: seconds * NANOSECONDS for key, seconds in stage.health_times_s.items()},
                "Retries": stage.health_retries,
            },
        },
        "rootfs": {"type": "layers", "diff_ids": [f"sha256:{layer_digest}"]},
        "history": [{"created": made, "created_by": "the Dockerfile of the repository"}],
    }


def image_archive(stage: Stage, version: str, architecture: str, work: Path) -> Path:
    """Return the archive of an image.

    Parameters
    ----------
    stage : Stage
        The image.
    version : str
        The program's version, which becomes the tag.
    architecture : str
        Of this computer.
    work : Path
        A folder for what is on the way.
    """
    place = work / "image"
    place.mkdir()
    others = [f"opt/{path.name}" for path in (stage.root / "opt").iterdir() if path.name != KEPT_OF_OPT]
    # Times of files stay: compiled kernels are known by those of their sources.
    left_out = [f"--exclude=./{path}" for path in (*LEFT_OUT, *others)]
    packing = [
        "tar",
        "-C",
        stage.root,
        "--sort=name",
        "--numeric-owner",
        *left_out,
        "-cf",
        place / LAYER,
        ".",
    ]
    subprocess.run(packing, check=True)
    with (place / LAYER).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    text = json.dumps(configuration(stage, architecture, digest), indent=1)
    name = f"{hashlib.sha256(text.encode()).hexdigest()}.json"
    (place / name).write_text(text, encoding="ascii")
    manifest = [{"Config": name, "RepoTags": [f"{NAME}:{version}"], "Layers": [PACKED_LAYER]}]
    (place / MANIFEST).write_text(json.dumps(manifest), encoding="ascii")
    subprocess.run(
        ["gzip", "--no-name", place / LAYER], check=True
    )  # podman reads no archive that is packed as a whole.
    made = work / f"{NAME}_{version}_{architecture}.image.tar"
    with tarfile.open(made, mode="w") as archive:
        for part in (MANIFEST, name, PACKED_LAYER):
            archive.add(place / part, arcname=part, filter=_without_owner)
    shutil.rmtree(place)
    log.info("%s: %.0f MB", made.name, made.stat().st_size / 1e6)
    return made


def _without_owner(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    moment = int(os.environ["SOURCE_DATE_EPOCH"])
    return entry.replace(uid=0, gid=0, uname="", gname="", mtime=moment, deep=False)


def prove_image_archive(archive: Path, work: Path) -> None:
    """Unpack an archive as a container engine does, and use the program in it as the image's user.

    Raises
    ------
    RuntimeError
        If its parts do not fit, something of this computer is in it, or the program does not run.
    """
    place, root = work / "loaded", work / "container"
    root.mkdir()
    with tarfile.open(archive) as packed:
        packed.extractall(place, filter="data")
    (entry,) = json.loads((place / MANIFEST).read_text(encoding="ascii"))
    about = json.loads((place / entry["Config"]).read_text(encoding="ascii"))
    (layer,) = entry["Layers"]
    with gzip.open(place / layer) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    must(
        about["rootfs"]["diff_ids"] == [f"sha256:{digest}"],
        "the image's layer is not that of its configuration",
    )
    subprocess.run(["tar", "-C", root, "-xpzf", place / layer], check=True)
    for own in ("etc/pip.conf", "etc/resolv.conf"):
        must(not (root / own).exists(), f"the image has this computer's /{own}")
    must(
        [path.name for path in (root / "opt").iterdir()] == [KEPT_OF_OPT],
        "the image has more than ours in /opt",
    )
    settings = about["config"]
    environment = dict(pair.split("=", 1) for pair in settings["Env"])
    system = Debian(root)
    for command in (["--version"], ["check", MISSION]):
        with system.started(
            *settings["Entrypoint"], *command, user=settings["User"], **environment
        ) as running:
            said, _ = running.communicate()
        must(running.returncode == 0, f"{' '.join(command)} in the image: {said[-600:]}")
    log.info("image: unpacked, the program runs in it as %s", settings["User"])
