"""Reasons that people wrote: of which orderings they are, and the tables that they stand in."""

import pytest

from companion.errors import ConfigError
from companion.research.evidence.document.flown_tables import best_text, flown_table
from companion.research.evidence.document.paper_tables import counts_table, ordering_tables, value_tables
from companion.research.evidence.document.reasons import Reason, Reasons, load_reasons
from companion.research.evidence.orderings import Ordering
from companion.research.evidence.verdicts import judge, judged
from tests.research.evidence.made_evidence import case, evidence, sample

PC = Ordering(1, 2, "PC", "safe-rrt", "taddrrt", 135.43, 149.94)


def against_the_paper():
    ours = sample("PC", [100.0 + n for n in range(12)])
    return case(safe_rrt=ours, taddrrt=sample("PC", [50.0 + n + n % 2 for n in range(12)]))


def test_a_reason_is_of_what_it_names_and_the_first_counts():
    entry = judge(against_the_paper(), PC)
    assert Reason(why="all").is_of(entry)
    assert Reason(why="either", methods=("taddrrt", "rrt")).is_of(entry)
    assert not Reason(why="neither", methods=("edbm", "rrt")).is_of(entry)
    assert Reason(why="these", tables=(1,), measures=("PC",), less=("safe-rrt",)).is_of(entry)
    for other in (
        {"tables": (2, 3)}, {"measures": ("Q",)}, {"less": ("taddrrt",)}, {"more": ("rrt-star",)},
        {"missions": ("paper-3d",)}, {"settings": ("noisy",)},
    ):  # fmt: skip
        assert not Reason(why="other", **other).is_of(entry)
    reasons = Reasons(orderings=(Reason(why="no", measures=("Q",)), Reason(why="a"), Reason(why="b")))
    assert reasons.of(entry) == 2
    assert Reasons().of(entry) is None


def test_a_file_of_reasons_and_what_is_wrong_with_one(tmp_path):
    file = tmp_path / "reasons.yaml"
    file.write_text("orderings:\n  - {tables: [1], why: so}\nnotes: {flights: fine}\n", encoding="utf-8")
    known = load_reasons(file)
    assert (known.orderings[0].why, known.notes) == ("so", {"flights": "fine"})
    for text, words in (
        ("orderings:\n  - {tables: [6], why: so}\n", r":2: orderings\.0\.tables\.0: got 6"),
        ("orderings:\n  - {table: [1], why: so}\n", r":2: orderings\.0\.table: got a key that is not known"),
        ("orderings:\n  - {tables: [1]}\n", r"why"),
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigError, match=r"reasons\.yaml" + words if words[0] == ":" else words):
            load_reasons(file)


def row_of(tables, measure, number=1):
    (table,) = [table for of, table in tables if of == number]
    return [[cell.text for cell in row] for row in table.rows if row[1].text == measure]


def test_an_ordering_has_its_verdict_and_the_number_of_its_reason():
    made = evidence(against_the_paper())
    verdicts = list(judged(made))
    (told, *_) = row_of(
        ordering_tables(verdicts, Reasons(orderings=(Reason(why="so", measures=("PC",)),))), "PC"
    )
    assert told[:5] == ["paper-2d", "PC", "safe-rrt", "taddrrt", "135 < 150"]
    assert told[5].startswith("not reproduced 49.5 [49.")
    assert told[-1] == "1"
    (told, *_) = row_of(ordering_tables(verdicts, Reasons()), "PC")
    assert told[-1] == "not found"


def test_tables_have_the_papers_values_and_ours():
    (number, table), *_ = value_tables(evidence(against_the_paper()))
    assert number == 1
    rows = [[cell.text for cell in row] for row in table.rows]
    place = [head for head, _ in table.columns].index("PC")
    assert rows[0][place] == "135"
    assert rows[1][place].startswith("106 [10")  # of 100 to 111
    assert [row[:3] for row in rows[:2]] == [["safe-rrt", "the paper", ""], ["safe-rrt", "shifted", "12"]]


def test_verdicts_are_counted_by_who_stands_for_the_papers_method():
    made = against_the_paper()
    printed = case(safe_rrt=made.samples["safe-rrt"], taddrrt=made.samples["taddrrt"],
                   safe_rrt_printed=made.samples["taddrrt"])  # fmt: skip
    rows = [[cell.text for cell in row] for row in counts_table(list(judged(evidence(printed)))).rows]
    known = {row[1]: row[2:] for row in rows}
    assert known["safe-rrt"][1] == "1"
    assert known["safe-rrt-printed"][1] == "0"  # no difference: undecided


def test_who_flies_better_is_told_with_how_sure_that_is():
    def flown(successes):
        return sample("flight_s", [100.0] * len(successes), successes=successes)

    ours = flown([True] * 10 + [False] * 10)
    made = case(
        mission="somewhere", safe_rrt=ours, rrt=flown([True] * 11 + [False] * 9), edbm=flown([True] * 20)
    )
    told = best_text(made, "success", "arrives")
    assert told == "By success (arrives) more than safe-rrt: rrt, edbm; surely so edbm."
    assert best_text(case(safe_rrt=ours, rrt=flown([False] * 20)), "success", "arrives").endswith(
        "no method does better than safe-rrt."
    )
    rows = [[cell.text for cell in row] for row in flown_table(made).rows]
    # Wilson's of 10 of 20; 0 and 10 pairs differ: middle 10/22, (10 + 1 - 100/22)/22².
    assert rows[0][:4] == ["safe-rrt", "20", "0.5 [0.299, 0.701]", "–"]
    assert rows[2][3] == "+0.50 [+0.23, +0.68]"
