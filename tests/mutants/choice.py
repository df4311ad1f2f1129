"""Which tests are run for a mutant."""

import functools
import hashlib
import json
import re
from pathlib import Path

from coverage import CoverageData

ROOT = Path(__file__).parents[2]
KERNELS = "companion/kernels/"
WORD = re.compile(r"\w+")
TESTS_MAX_S = 60.0  # Of the tests of a line, the shortest that take so long together are run.


def stored_for(texts):
    """The folder of what was measured with a program, whose files' texts these are."""
    digest = hashlib.sha256(json.dumps(texts).encode()).hexdigest()
    return ROOT / ".mutants" / digest[:16]


@functools.cache
def is_shared(file):
    """Whether tests of a file share what is made once."""
    return 'scope="module"' in (ROOT / file).read_text(encoding="utf-8")


def _file_of(test):
    return test.partition("::")[0]


class Choice:
    """Tests by the lines that they reach.

    Attributes
    ----------
    seconds : dict
        How long each test takes.
    """

    def __init__(self, folder, texts):
        self.seconds = json.loads((folder / "durations.json").read_text(encoding="utf-8"))
        measured_s = (folder / "durations.json").stat().st_mtime
        tests = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "tests").rglob("test_*.py")}
        self._newer = {name for name, path in tests.items() if path.stat().st_mtime > measured_s}
        self._words = {name: set(WORD.findall(path.read_text("utf-8"))) for name, path in tests.items()}
        self._lines = {path: text.splitlines() for path, text in texts.items()}
        data = CoverageData(str(folder / "coverage"))
        data.read()
        self._contexts = functools.cache(data.contexts_by_lineno)

    def tests_of(self, mutant):
        """The tests that reach a mutant, and files that are run as a whole.

        Where no test reaches a line, one may do so in another process: the tests of its file are run.
        What runs when a module is imported is reached by tests that reach a line with a name that it defines,
        and by the files of tests that name a constant or a class of it.
        Compiled kernels hide their lines: they have the tests of their folder, of planning and of flights.
        Files of tests of the same room that are newer than what was measured are run as a whole.
        """
        inside = Path(*Path(mutant.path).parts[1:-1])
        mirrored = Path("tests", inside, f"test_{Path(mutant.path).name}").as_posix()
        files = {mirrored} if (ROOT / mirrored).exists() else set()
        wanted = self._reaching(mutant.path, range(mutant.lines[0], mutant.lines[1] + 1))
        if mutant.names:
            told = {name for name in mutant.names if name[:1].isupper()}
            files |= {name for name, words in self._words.items() if told & words}
            word = re.compile(rf"\b({'|'.join(mutant.names)})\b")
            for path, lines in self._lines.items():
                wanted |= self._reaching(path, [n for n, line in enumerate(lines, 1) if word.search(line)])
        parts = [wanted or self._reaching(mutant.path, range(len(self._lines[mutant.path]) + 1))]
        if mutant.path.startswith(KERNELS):
            folders = f"tests/{inside}/", "tests/planning/", "tests/flight/"
            parts += [{test for test in self.seconds if test.startswith(folder)} for folder in folders]
        room = Path("tests", *inside.parts[:1]).as_posix()
        files |= {name for name in self._newer if name.startswith(f"{room}/")}
        whole_s = sum(took_s for test, took_s in self.seconds.items() if _file_of(test) in files)
        return self._shortest(parts, whole_s), files

    def _shortest(self, parts, total_s):
        chosen = set()
        for test in (test for part in parts for test in sorted(part, key=self.seconds.get)):
            total_s += self.seconds[test]
            if total_s > TESTS_MAX_S and chosen:
                break
            chosen.add(test)
        return chosen

    def _reaching(self, path, lines):
        """Tests that run one of the lines; all of a file where what they share runs it."""
        contexts, found = self._contexts(path), set()
        for context in {name for line in lines for name in contexts.get(line, ())}:
            test, _, phase = context.rpartition("|")
            found.add(test)
            if phase == "setup" and is_shared(_file_of(test)):
                found |= {other for other in self.seconds if _file_of(other) == _file_of(test)}
        return found & self.seconds.keys()
