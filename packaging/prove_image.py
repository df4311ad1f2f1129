#!/usr/bin/env python3
"""Carries out the Dockerfile in a clean Debian, where no image registry can be reached.

A Debian of the release that the Dockerfile's base image is made of stands in for that image. Every
instruction is read from the Dockerfile itself and carried out: an unknown one ends the proof. Then the
image is used as its user would: it plans, it runs, its own health check is asked while it runs and after
it has ended, and it is stopped by its stop signal. Needs root and debootstrap.
"""

from __future__ import annotations

import argparse
import glob
import http.client
import json
import logging
import os
import platform
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).resolve().parents[1]
BASE = re.compile(r"python:3\.11-slim-(?P<release>bookworm)")  # whose python3 is 3.11, too
PACKAGES = "python3,python3-venv,ca-certificates"
KNOWN = ["FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "HEALTHCHECK", "STOPSIGNAL", "ENTRYPOINT", "CMD"]
FROM_OUTSIDE = ("PIP_", "SSL_CERT_", "http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY")
MISSION = "/usr/share/companion/mission_configs/first-flight.yaml"
SBOM = "/opt/companion/share/sbom.cdx.json"
HEALTHY_S = 60.0
# Options of HEALTHCHECK, in seconds, and their names in an image's configuration.
HEALTH_TIMES = {"interval": "Interval", "timeout": "Timeout", "start-period": "StartPeriod"}
COMPILING = "compiling"  # in the status that the service tells until its kernels are there
SIZE_MAX_MB = 390.0  # above the base image

# In a namespace of its own, so that nothing stays mounted, and by exec, so that signals arrive.
ENTER = """set -e
root=$1 user=$2 folder=$3; shift 3
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
while [ "$1" != -- ]; do mkdir -p "$root$2"; mount --bind "$1" "$root$2"; shift 2; done
shift
exec chroot --userspec="$user" "$root" /bin/sh -c 'cd "$0" && exec "$@"' "$folder" "$@"
"""

log = logging.getLogger("image")


@dataclass
class Instruction:
    """One of the Dockerfile's, its continuation lines joined."""

    word: str
    rest: str
    line: int


@dataclass
class Stage:
    """One image being made."""

    root: Path
    environment: dict[str, str] = field(
        default_factory=lambda: {"PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin"}
    )
    user: str = "root"
    folder: str = "/"
    entry: list[str] = field(default_factory=list)
    command: list[str] = field(default_factory=list)
    health: list[str] = field(default_factory=list)
    health_times_s: dict[str, int] = field(default_factory=dict)
    health_retries: int = 3
    stop: signal.Signals = signal.SIGTERM


def instructions(text: str) -> list[Instruction]:
    """Read a Dockerfile; raises ValueError for an instruction that is not carried out here."""
    found: list[Instruction] = []
    joined, first = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("#") or not (line.strip() or joined):
            continue
        first = first if joined else number
        joined += line.strip()
        if joined.endswith("\\"):
            joined = joined[:-1].rstrip() + " "
            continue
        word, _, rest = joined.partition(" ")
        if word not in KNOWN:
            raise ValueError(f"Dockerfile:{first}: {word}: expected one of {', '.join(KNOWN)}")
        found.append(Instruction(word, rest.strip(), first))
        joined = ""
    return found


def mirror(release: str) -> list[str]:
    """Where this computer itself gets its Debian from; nothing leaves it to debootstrap."""
    asked = ["apt-get", "indextargets", "--format", "$(REPO_URI)", f"Codename: {release}"]
    told = subprocess.run(asked, check=False, capture_output=True, text=True).stdout.split()
    return told[:1]


def debian(cache: Path, release: str) -> Path:
    """An archive of a minimal Debian with Python; made once."""
    archive = cache / f"{release}-{platform.machine()}.tar"
    if not archive.exists():
        cache.mkdir(parents=True, exist_ok=True)
        root = cache / "new"
        shutil.rmtree(root, ignore_errors=True)
        subprocess.run(
            ["debootstrap", "--variant=minbase", f"--include={PACKAGES}", release, root, *mirror(release)],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        for name in ("python", "python3"):  # where the base image has them
            (root / "usr/local/bin" / name).symlink_to("/usr/bin/python3")
        part = archive.with_suffix(".part")
        subprocess.run(["tar", "-C", root, "--exclude=./var/cache/apt/*", "-cf", part, "."], check=True)
        part.rename(archive)
        shutil.rmtree(root)
    return archive


class Builder:
    """Carries instructions out, stage by stage."""

    def __init__(self, cache: Path, work: Path, source: Path = SOURCE) -> None:
        self._cache = cache
        self._work = work
        self._source = source
        self._stages: dict[str, Stage] = {}
        self.base_mb = 0.0

    @property
    def stage(self) -> Stage:
        """The one that is being made; the image in the end."""
        return list(self._stages.values())[-1]

    def carry_out(self, step: Instruction) -> None:
        """Do what an instruction says."""
        getattr(self, f"_{step.word.lower()}")(step.rest)

    def _from(self, rest: str) -> None:
        base, _, name = rest.partition(" AS ")
        match = BASE.fullmatch(base)
        if match is None:
            raise ValueError(f"FROM {base}: expected {BASE.pattern}")
        root = self._work / f"stage-{len(self._stages)}"
        root.mkdir()
        subprocess.run(["tar", "-C", root, "-xf", debian(self._cache, match["release"])], check=True)
        self.base_mb = size_mb(root)
        shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
        self._stages[name or str(len(self._stages))] = Stage(root)

    def _workdir(self, rest: str) -> None:
        self.stage.folder = rest
        (self.stage.root / rest.lstrip("/")).mkdir(parents=True, exist_ok=True)

    def _copy(self, rest: str) -> None:
        *options, target = shlex.split(rest)
        origin, sources = self._source, []
        for option in options:
            if option.startswith("--from="):
                origin = self._stages[option.removeprefix("--from=")].root
            elif option.startswith("--"):
                raise ValueError(f"COPY {option}: not known")
            else:
                sources.append(origin / option.lstrip("/"))
        inside = self.stage.root / os.path.join(self.stage.folder, target).lstrip("/")
        is_folder = target.endswith("/") or len(sources) > 1
        for source in sources:
            into = inside / source.name if is_folder else inside
            into.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(
                    source, into, symlinks=True, dirs_exist_ok=True,
                    ignore=None if "--from" in rest else shutil.ignore_patterns("__pycache__"),
                )  # fmt: skip
            else:
                shutil.copy(source, into)

    def _env(self, rest: str) -> None:
        for pair in shlex.split(rest):
            key, _, value = pair.partition("=")
            for name, known in self.stage.environment.items():
                value = value.replace(f"${name}", known)
            self.stage.environment[key] = value

    def _user(self, rest: str) -> None:
        self.stage.user = rest

    def _healthcheck(self, rest: str) -> None:
        options, _, command = rest.partition("CMD ")
        self.stage.health = json.loads(command)
        for option, value in re.findall(r"--(\S+)=(\d+)s?", options):
            if option == "retries":
                self.stage.health_retries = int(value)
            else:
                self.stage.health_times_s[HEALTH_TIMES[option]] = int(value)

    def _stopsignal(self, rest: str) -> None:
        self.stage.stop = signal.Signals[rest]

    def _entrypoint(self, rest: str) -> None:
        self.stage.entry = json.loads(rest)

    def _cmd(self, rest: str) -> None:
        self.stage.command = json.loads(rest)
        self.run([*self.stage.entry, *self.stage.command])

    def _run(self, rest: str) -> None:
        caches = []
        while match := re.match(r"--mount=type=cache,target=(\S+) ", rest):
            kept = self._cache / match[1].strip("/").replace("/", "-")
            kept.mkdir(parents=True, exist_ok=True)
            caches += [str(kept), match[1]]
            rest = rest[match.end() :]
        self.run(["/bin/sh", "-c", rest], mounts=caches, is_building=True)

    def run(self, command: list[str], *, mounts: list[str] | None = None, is_building: bool = False) -> None:
        """Run a command in the stage's root, as its user, to its end."""
        with self.started(command, mounts=mounts, is_building=is_building) as running:
            code = running.wait()
        if code != 0:
            raise RuntimeError(f"exit code {code}: {' '.join(command)}")

    def started(
        self,
        command: list[str],
        *,
        mounts: list[str] | None = None,
        is_building: bool = False,
        environment: dict[str, str] | None = None,
    ) -> subprocess.Popen[bytes]:
        """Start a command in the stage's root, as its user."""
        stage, mounts = self.stage, list(mounts or [])
        home = "/root" if stage.user == "root" else "/var/lib/companion"
        known = {**stage.environment, "HOME": home, **(environment or {})}
        if is_building and stage.user == "root":
            # How this computer reaches package registries; the image has none of it.
            known |= {key: value for key, value in os.environ.items() if key.startswith(FROM_OUTSIDE)}
            outside = ["/etc/ssl/certs", "/etc/pip.conf", *glob.glob("/opt/*/simple"), "/opt/wheels"]
            for path in outside:
                if Path(path).is_dir():
                    mounts += [path, path]
            configuration = Path("/etc/pip.conf")
            if configuration.exists():
                shutil.copy(configuration, stage.root / "etc/pip.conf")
        user = stage.user if stage.user == "root" else self._ids(stage)
        return subprocess.Popen(
            ["unshare", "--mount", "--propagation", "private", "/bin/sh", "-c", ENTER, "enter",
             stage.root, user, stage.folder, *mounts, "--", *command],
            env=known,
        )  # fmt: skip

    @staticmethod
    def _ids(stage: Stage) -> str:
        for line in (stage.root / "etc/passwd").read_text().splitlines():
            name, _, user, group = line.split(":")[:4]
            if name == stage.user:
                return f"{user}:{group}"
        raise ValueError(f"USER {stage.user}: no such user in the image")


def prove_health(builder: Builder) -> None:
    """Run the service without an autopilot; ask the image's health check before, while and after."""
    stage = builder.stage
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        environment = {"COMPANION_METRICS": str(probe.getsockname()[1])}

    def is_healthy() -> bool:
        with builder.started(stage.health, environment=environment) as asked:
            return asked.wait() == 0

    if is_healthy():
        raise RuntimeError("healthy before anything runs")
    command = [*stage.entry, "run", MISSION, "--link", "udpin://127.0.0.1:0"]
    with builder.started(command, environment=environment) as running:
        began = time.monotonic()
        answered_s = None
        while not (answer := _health(environment["COMPANION_METRICS"])) or COMPILING in str(answer["status"]):
            if answer and answered_s is None:
                answered_s = time.monotonic() - began
            if running.poll() is not None or time.monotonic() - began > HEALTHY_S:
                running.kill()
                raise RuntimeError("the service did not become ready to plan")
            time.sleep(0.02)
        warm_s = time.monotonic() - began
        log.info("the service answers after %.2f s and can plan after %.2f s", answered_s or warm_s, warm_s)
        began = time.monotonic()
        if not is_healthy():
            raise RuntimeError("it says that it is healthy, and its health check says that it is not")
        log.info("its health check takes %.2f s", time.monotonic() - began)
        running.send_signal(stage.stop)
        code = running.wait(timeout=30.0)
    if code != 0:
        raise RuntimeError(f"{stage.stop.name} ended the service with exit code {code}")
    if is_healthy():
        raise RuntimeError("healthy after the end")


def installed(packages: Path) -> set[tuple[str, str]]:
    """Name and version of each distribution in a folder of packages, as its own metadata has them."""
    found = set()
    for metadata in packages.glob("*.dist-info/METADATA"):
        head = metadata.read_text(encoding="utf-8").partition("\n\n")[0]
        name, version = (re.search(rf"(?m)^{key}: (.+)$", head) for key in ("Name", "Version"))
        if name is None or version is None:
            raise ValueError(f"{metadata}: no name or version")
        found.add((normal(name[1]), version[1].strip()))
    return found


def listed(bill: dict[str, Any]) -> set[tuple[str, str]]:
    """Name and version of each component of a bill of materials."""
    if bill.get("bomFormat") != "CycloneDX":
        raise ValueError(f"{SBOM}: not of CycloneDX")
    return {(normal(row["name"]), row["version"]) for row in bill["components"]}


def normal(name: str) -> str:
    """A distribution's name as all ways to write it have it."""
    return re.sub(r"[-_.]+", "-", name.strip()).lower()


def prove_contents(root: Path) -> int:
    """See that the image's bill of materials lists what is installed, and nothing else; how much that is."""
    bill = listed(json.loads((root / SBOM.lstrip("/")).read_text(encoding="utf-8")))
    found = set().union(
        *(installed(path) for path in (root / "opt/companion").glob("lib/python3*/site-packages"))
    )
    if not found or found != bill:
        raise RuntimeError(f"the bill of materials is of something else: {sorted(found ^ bill)}")
    return len(bill)


def _health(port: str) -> dict[str, object]:
    """What a healthy service says of itself; asked from here, so that no program's start counts."""
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with direct.open(f"http://127.0.0.1:{port}/healthz", timeout=3.0) as answer:
            told: dict[str, object] = json.load(answer)
            return told
    except (OSError, ValueError, http.client.HTTPException):
        return {}


def size_mb(root: Path) -> float:
    """What lies in a folder, in megabytes."""
    told = subprocess.run(
        ["du", "-sx", "--block-size=10000", root], check=True, capture_output=True, text=True
    )
    return float(told.stdout.split()[0]) / 100.0


def largest(root: Path, number: int = 12) -> str:
    """The folders that take most, by size: where to look when an image has grown."""
    sizes = {path: size_mb(path) for path in root.glob("*/lib/python3*/site-packages/*") if path.is_dir()}
    by_size = sorted(sizes.items(), key=lambda entry: -entry[1])
    return ", ".join(f"{path.name} {size:.0f}" for path, size in by_size[:number])


def main() -> int:
    """Prove it; the exit code says whether it holds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    parser.add_argument("--cache", type=Path, default=Path(home) / "companion-image")
    cache = parser.parse_args().cache.resolve()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    began = time.monotonic()
    steps = instructions((SOURCE / "Dockerfile").read_text(encoding="utf-8"))
    work = cache / f"work-{os.getpid()}"
    work.mkdir(parents=True)
    builder = Builder(cache, work)

    def tell(what: str) -> None:
        log.info("%5.0f s  %.100s", time.monotonic() - began, what)

    try:
        for step in steps:
            tell(f"Dockerfile:{step.line}: {step.word} {step.rest}")
            builder.carry_out(step)
        stage = builder.stage
        if stage.user == "root" or not stage.health:
            raise RuntimeError("the image runs as root, or has no health check")
        above_mb = size_mb(stage.root) - builder.base_mb
        tell(f"{above_mb:.0f} MB above its base, of {SIZE_MAX_MB:.0f}")
        log.info("%s", largest(stage.root / "opt"))
        if above_mb > SIZE_MAX_MB:
            raise RuntimeError(f"{above_mb:.0f} MB above its base: more than {SIZE_MAX_MB:.0f}")
        tell(f"{prove_contents(stage.root)} packages in {SBOM}, as they are installed")
        tell("plan, run, health check, stop")
        builder.run([*stage.entry, "plan", MISSION])
        prove_health(builder)
        tell("proven")
    except (OSError, ValueError, RuntimeError, subprocess.SubprocessError) as error:
        log.error("not proven: %s", error)
        return 1
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
