"""Fuzzes one target with Atheris: ``python -m tests.fuzz.one_target NAME FOLDER SECONDS``.

What escapes does not end it: of each kind the shortest input is kept. So are inputs that took long for
their length, and such as made the process grow, to be measured where nothing watches.
"""

import hashlib
import json
import pkgutil
import resource
import sys
import time
import traceback
from pathlib import Path

import atheris

WATCHED = ["companion", *{"mission_file": ["yaml"], "mcap": ["mcap"]}.get(sys.argv[1], [])]
KERNELS = Path(__file__).parents[2] / "companion" / "kernels"
SLOW_KEPT, LEAST_BYTES = 24, 256
GROWTH_MB = 1.0
INPUT_S_MAX = 60  # one that takes longer ends the process, and is kept
ADDRESSES_MAX = 12 * 2**30  # what is asked for beyond is refused: the computer is others', too


def compiled_modules():
    """Modules that numba compiles, which nothing may be written into."""
    names = [module.name for module in pkgutil.walk_packages([str(KERNELS)], "companion.kernels.")]
    return ["companion.kernels", *names]


with atheris.instrument_imports(include=WATCHED, exclude=compiled_modules()):
    from tests.fuzz.targets import BrokenPromiseError, all_targets, corpus_of

    TARGETS = all_targets()  # which imports what is watched


def kind_of(error):
    """What an escape is called: its type and where it came from, or the promise that was broken."""
    if isinstance(error, BrokenPromiseError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    ours = next((frame.name for frame in reversed(frames) if "/companion/" in frame.filename), "")
    return f"{type(error).__name__} in {ours}, from {Path(frames[-1].filename).name} {frames[-1].name}"


class Fuzzed:
    """One target, and what is kept of its inputs."""

    def __init__(self, target, folder):
        self._target, self._folder = target, folder
        self._escapes, self._slow, self._peak_mb = {}, {}, None
        for name in ("corpus", "escapes", "slow", "hungry"):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def __call__(self, data):
        """Try one input."""
        began_s = time.perf_counter()
        try:
            self._target.check(data)
        except Exception as error:  # whatever it is, it is what is looked for
            self._escaped(data, error)
        self._note_cost((time.perf_counter() - began_s) / max(len(data), LEAST_BYTES), data)
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        if self._peak_mb is not None and peak_mb > self._peak_mb + GROWTH_MB:
            self._keep("hungry", data)
        self._peak_mb = peak_mb

    def _escaped(self, data, error):
        kind = kind_of(error)
        if kind in self._escapes and len(self._escapes[kind]) <= len(data):
            return
        self._escapes[kind] = data
        name = hashlib.sha256(kind.encode()).hexdigest()[:16]
        (self._folder / "escapes" / name).write_bytes(data)
        told = {"kind": kind, "trace": traceback.format_exception(error)[-6:]}
        (self._folder / "escapes" / f"{name}.json").write_text(json.dumps(told, indent=1), encoding="utf-8")

    def _note_cost(self, cost_s, data):
        if len(self._slow) >= SLOW_KEPT:
            least = min(self._slow, key=self._slow.get)
            if cost_s < 1.1 * self._slow[least]:
                return
            del self._slow[least]
            (self._folder / "slow" / least).unlink(missing_ok=True)
        self._slow[self._keep("slow", data)] = cost_s

    def _keep(self, why, data):
        name = hashlib.sha256(data).hexdigest()[:16]
        (self._folder / why / name).write_bytes(data)
        return name


def main():
    name, folder, seconds = sys.argv[1], Path(sys.argv[2]), sys.argv[3]
    target = TARGETS[name]
    fuzzed = Fuzzed(target, folder)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES_MAX, ADDRESSES_MAX))
    arguments = [
        sys.argv[0], str(folder / "corpus"), *{str(path.parent) for path in corpus_of(name)},
        f"-max_total_time={seconds}", f"-max_len={target.length_max}", f"-artifact_prefix={folder}/ended-",
        f"-timeout={INPUT_S_MAX}", "-rss_limit_mb=8192", "-print_final_stats=1", "-use_value_profile=1",
    ]  # fmt: skip
    if target.words:
        words = folder / "words"
        words.write_text("".join(f'"{_escaped(word)}"\n' for word in target.words), encoding="ascii")
        arguments.append(f"-dict={words}")
    atheris.Setup(arguments, fuzzed)
    atheris.Fuzz()


def _escaped(word):
    return "".join(chr(byte) if chr(byte).isalnum() else f"\\x{byte:02x}" for byte in word)


if __name__ == "__main__":
    main()
