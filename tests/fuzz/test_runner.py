"""What ``make fuzz`` makes of what was found, and what an input costs."""

import itertools
import json
import sys

import pytest

from tests.fuzz import __main__ as runner
from tests.fuzz import keeping, replayed
from tests.fuzz.targets import BrokenPromiseError, Target, Work, all_targets, promise

CHEAP = {"inputs": 3, "worst_us": 0.5, "worst_of_bytes": 4096, "peak_mb": 1.0, "lines": 5, "lines_total": 9}
MEBIBYTE = 2**20


def ran(monkeypatch, tmp_path, told, escapes=()):
    """One target's row and what is wrong with it, where the fuzzer and the measuring are stood in for."""
    folder = tmp_path / "framer"

    def fuzzed(name, folder, seconds):
        (folder / "escapes").mkdir()
        for number, kind in enumerate(escapes):
            told = json.dumps({"kind": kind, "trace": []})
            (folder / "escapes" / f"{number}.json").write_text(told, encoding="utf-8")
        return 1_000, 50.0, 77

    monkeypatch.setattr(runner, "fuzzed", fuzzed)
    monkeypatch.setattr(runner, "measured", lambda name, folder: CHEAP | told)
    return runner.one("framer", folder, 1.0, is_fuzzing=True)


def test_a_run_that_found_nothing_is_a_row(monkeypatch, tmp_path):
    row, wrong = ran(monkeypatch, tmp_path, {})
    assert wrong == []
    lines = runner.table([row]).splitlines()
    assert lines[0].split() == list(runner.COLUMNS)
    assert lines[1].split() == ["framer", "1000", "50", "77", "5/9", "3", "0.50", "1.0", "0"]


@pytest.mark.parametrize(
    ("told", "escapes", "words"),
    [
        ({"worst_us": 2.01}, (), "2.01 µs a byte, at most 2"),
        ({"peak_mb": 100.5}, (), "MB, at most 100"),
        ({}, ("KeyError in feed", "a frame twice"), "escaped: KeyError in feed"),
    ],
)
def test_whatever_is_beyond_a_limit_is_told(monkeypatch, tmp_path, told, escapes, words):
    _, wrong = ran(monkeypatch, tmp_path, told, escapes)
    assert len(wrong) == max(1, len(escapes))
    assert words in wrong[0]


def test_what_ended_the_fuzzer_is_an_escape(tmp_path):
    (tmp_path / "ended-timeout-1").write_bytes(b"x")
    assert runner.escapes_of(tmp_path) == ["ended-timeout-1"]


def run_main(monkeypatch, tmp_path, capsys, wrong, *, is_there=True):
    monkeypatch.setattr(sys, "argv", ["fuzz", "--found", str(tmp_path), "framer", "codec"])
    monkeypatch.setattr(runner.importlib.util, "find_spec", lambda name: "there" if is_there else None)
    row = ("x", *[0] * 8)
    monkeypatch.setattr(runner, "one", lambda name, folder, seconds, *, is_fuzzing, cost_max_us: (row, wrong))
    return runner.main(), capsys.readouterr().out


def test_the_exit_code_says_whether_anything_was_found(monkeypatch, tmp_path, capsys):
    assert run_main(monkeypatch, tmp_path, capsys, [])[0] == 0
    code, told = run_main(monkeypatch, tmp_path, capsys, ["framer: escaped"])
    assert code == 1
    assert told.count("framer: escaped\n") == 2


def test_without_the_fuzzer_it_says_so_and_does_not_pass(monkeypatch, tmp_path, capsys):
    code, told = run_main(monkeypatch, tmp_path, capsys, [], is_there=False)
    assert code == runner.NOT_THERE != 0
    assert "NOT FUZZED" in told


def spending(megabytes=0):
    """A target of the test's own, whose code takes that much memory."""

    def run():
        bytearray(megabytes * MEBIBYTE)

    return Target("spender", lambda data: None, lambda data: Work(1_000, lambda: run), (replayed.__name__,))


def test_time_is_told_for_each_byte_that_was_given(monkeypatch):
    turns = itertools.count(0.0, 0.002)  # each look at the clock takes 2 ms
    monkeypatch.setattr(replayed.time, "thread_time", lambda: next(turns))
    assert replayed.cost_us(spending(), b"", 3) == (pytest.approx(2.0), 1_000)


def test_memory_is_the_highest_above_what_there_was():
    assert replayed.grown_mb(spending(megabytes=64), b"") >= 60.0
    assert replayed.grown_mb(spending(), b"") < 60.0


def test_inputs_that_reach_no_further_are_not_kept(tmp_path):
    target = all_targets()["signer"]
    found, stored = tmp_path / "found", tmp_path / "stored"
    found.mkdir()
    stored.mkdir()
    first = keeping.corpus_of("signer")[0]
    (found / "again").write_bytes(first.read_bytes())
    assert keeping.keep(target, found, stored) == 0
    assert list(stored.iterdir()) == []


def test_those_that_do_are_the_shortest_first(tmp_path, monkeypatch):
    target = all_targets()["signer"]
    monkeypatch.setattr(keeping, "corpus_of", lambda name: [])
    script = b"\0\0\0\0\1\0\2\5\5\1"
    found, stored = tmp_path / "found", tmp_path / "stored"
    found.mkdir()
    stored.mkdir()
    for name, data in {"long": script * 2, "short": script}.items():
        (found / name).write_bytes(data)
    assert keeping.keep(target, found, stored) >= 1
    assert script in [path.read_bytes() for path in stored.iterdir()]


def test_a_promise_that_does_not_hold_is_broken():
    promise(True, "sums")
    with pytest.raises(BrokenPromiseError, match="sums"):
        promise(False, "sums")
