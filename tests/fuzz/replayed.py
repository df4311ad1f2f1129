"""What inputs cost where nothing watches: ``python -m tests.fuzz.replayed NAME FOLDER`` tells it as JSON.

Time is the processor's, of the code under test alone, by the best of several turns, for each byte given.
Streams are repeated until they have 4 KiB, and a file is charged as 4 KiB at least: what counts is what a
flood of such inputs costs, and making a framer or opening a file is no cost of a byte. Memory is the highest
that the process had in use during an input, above what it had before.
"""

import gc
import itertools
import json
import logging
import resource
import sys
import time
from pathlib import Path

from tests.fuzz.targets import HEAVY, all_targets, corpus_of

TURNS, CLOSELY = 7, 8
ENOUGH_S = 1.0
INPUTS_MAX, TRACED_MAX = 1500, 400
ADDRESSES_MAX = 12 * 2**30


def timed_s(start):
    run = start()
    began_s = time.thread_time()
    try:
        run()
    except Exception:  # an escape is counted where it is looked for
        return time.thread_time() - began_s
    return time.thread_time() - began_s


def best_s(start, turns):
    """The best of several turns; of what takes seconds, of fewer."""
    took_s = [timed_s(start)]
    while len(took_s) < turns and sum(took_s) < ENOUGH_S:
        took_s.append(timed_s(start))
    return min(took_s)


def cost_us(target, data, turns):
    """Microseconds a byte, and the bytes that were given."""
    work = target.work(data)
    if not work.num_bytes:
        return 0.0, 0
    took_s = best_s(work.start, turns)
    if work.idle is not None:
        took_s = max(0.0, took_s - best_s(work.idle, turns))
    return 1e6 * took_s / work.num_bytes, work.num_bytes


def memory_mb(key):
    """A figure of this process's memory, as Linux tells it, in MB."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024 / 1e6
    return 0.0


def grown_mb(target, data):
    """How far the memory in use rose while an input was read."""
    run = target.work(data).start()
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the highest begins anew
    before_mb = memory_mb("VmRSS")
    try:
        run()
    except Exception:  # as above
        return memory_mb("VmHWM") - before_mb
    return memory_mb("VmHWM") - before_mb


def inputs_of(name, folder):
    """Stored inputs, then those that were found, the suspicious ones first."""
    found = [sorted((folder / kind).glob("*")) for kind in ("slow", "hungry", "escapes", "corpus")]
    ended = sorted(folder.glob("ended-*"))
    paths = [*corpus_of(name, HEAVY), *corpus_of(name), *ended, *itertools.chain.from_iterable(found)]
    return [path.read_bytes() for path in paths if path.suffix != ".json"][:INPUTS_MAX]


def lines_covered(target, inputs):
    """Lines of the target's modules that the inputs reach, of how many, by Python's own tracing."""
    files = {sys.modules[module].__file__: set() for module in target.modules}

    def watch(frame, event, _):
        lines = files.get(frame.f_code.co_filename)
        if lines is None:
            return None
        if event == "line":
            lines.add(frame.f_lineno)
        return watch

    before = sys.gettrace()  # Coverage goes on where it was.
    for data in inputs:
        sys.settrace(watch)
        try:
            target.check(data)
        except Exception:  # as above
            continue
        finally:
            sys.settrace(before)
    total = sum(len(_lines_in_functions(Path(file))) for file in files)
    return sum(len(files[file] & _lines_in_functions(Path(file))) for file in files), total


def _lines_in_functions(path):
    """Lines of code in functions; those of the module itself ran at its import."""
    waiting, lines = [compile(path.read_text(encoding="utf-8"), str(path), "exec")], set()
    while waiting:
        code = waiting.pop()
        inner = [constant for constant in code.co_consts if hasattr(constant, "co_lines")]
        waiting += inner
        if code.co_flags & 0x02:  # a function, not a module or a class
            lines |= {
                line for *_, line in code.co_lines() if line is not None and line != code.co_firstlineno
            }
    return lines


def main():
    name, folder = sys.argv[1], Path(sys.argv[2])
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES_MAX, ADDRESSES_MAX))
    logging.disable(logging.CRITICAL)
    target, inputs = all_targets()[name], inputs_of(name, folder)
    for data in inputs[:3]:
        timed_s(target.work(data).start)  # what is imported on the way is no cost
    once = sorted(inputs, key=lambda data: cost_us(target, data, 1)[0], reverse=True)
    closely = [(*cost_us(target, data, TURNS), data) for data in once[:CLOSELY]]
    worst_us, num_bytes, slowest = max(closely, default=(0.0, 0, b""))
    gc.freeze()  # what was made until now is not looked through again
    memory = [(grown_mb(target, data), data) for data in inputs]
    peak_mb, hungriest = max(memory, default=(0.0, b""))
    covered, total = lines_covered(target, inputs[len(corpus_of(name, HEAVY)) :][:TRACED_MAX])
    (folder / "slowest").write_bytes(slowest)
    (folder / "hungriest").write_bytes(hungriest)
    told = {
        "inputs": len(inputs), "worst_us": worst_us, "worst_of_bytes": num_bytes, "peak_mb": peak_mb,
        "lines": covered, "lines_total": total,
    }  # fmt: skip
    sys.stdout.write(json.dumps(told) + "\n")


if __name__ == "__main__":
    main()
