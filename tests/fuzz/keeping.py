"""Which of the inputs found are worth storing: those that reach lines which no stored one does."""

import hashlib
import sys
from pathlib import Path

from tests.fuzz.targets import corpus_of

LONGEST = 512  # bytes; a longer one is for the folder that is not stored
MOST = 24  # of one target at a time


def steps_of(target, data):
    """Steps from line to line that an input takes in the target's modules."""
    files = {sys.modules[module].__file__ for module in target.modules}
    taken = set()

    def watch(frame, event, _):
        if frame.f_code.co_filename not in files:
            return None
        last = None

        def step(frame, event, _):
            nonlocal last
            if event == "line":
                taken.add((frame.f_code.co_filename, last, frame.f_lineno))
                last = frame.f_lineno
            return step

        return step

    before = sys.gettrace()  # Coverage goes on where it was.
    sys.settrace(watch)
    try:
        target.check(data)
    except Exception:  # an escape is kept by hand, with a name that says what it is
        return set()
    finally:
        sys.settrace(before)
    return taken


def keep(target, found, stored):
    """Store the shortest inputs that reach further; how many."""
    reached, kept = set(), 0
    for path in corpus_of(target.name):
        reached |= steps_of(target, path.read_bytes())
    for path in sorted(found.glob("*"), key=lambda path: (path.stat().st_size, path.name)):
        data = path.read_bytes()
        if kept >= MOST or len(data) > LONGEST:
            break
        new = steps_of(target, data) - reached
        if new:
            reached |= new
            kept += 1
            Path(stored / f"found-{hashlib.sha256(data).hexdigest()[:16]}").write_bytes(data)
    return kept
