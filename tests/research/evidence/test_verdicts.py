"""The paper's orderings: as printed, and what made-up runs say of them."""

import pytest

from companion.research.campaign.paper import TABLE_1
from companion.research.evidence.orderings import TABLES, Ordering, orderings
from companion.research.evidence.samples import GROUPS
from companion.research.evidence.verdicts import Verdict, counts_table, judge, judged, verdicts_table
from tests.research.evidence.made_evidence import case, evidence, sample

PC = Ordering(1, 2, "PC", "safe-rrt", "taddrrt", 135.43, 149.94)


def test_every_pair_of_every_column_but_equal_ones():
    # Tables of 4, 2, 3, 3 and 2 methods, 7, 7, 3, 6 and 6 columns, twice; FR of table 5 in 3D is one value.
    every = list(orderings())
    assert len(every) == 2 * (6 * 7 + 7 + 3 * 3 + 3 * 6 + 6) - 1
    assert all(entry.printed_less < entry.printed_more for entry in every)
    assert PC in every
    against_the_text = Ordering(1, 3, "PST", "taddrrt", "safe-rrt", 13.39, 13.57)
    assert against_the_text in every


def test_tables_repeat_each_other():
    for table in TABLES:
        for dimension, rows in table.printed.items():
            for name, value in zip(table.measures, rows["safe-rrt"], strict=True):
                for other in TABLES:
                    if name in other.measures:
                        assert other.printed[dimension]["safe-rrt"][other.measures.index(name)] == value
    methods = "safe-rrt", "taddrrt", "nfz-ddrrt", "rrt-star"
    assert list(TABLE_1) == [(dimension, method) for dimension in (2, 3) for method in methods]
    for (dimension, method), row in TABLE_1.items():
        shown = dict(zip(TABLES[0].measures, TABLES[0].printed[dimension][method], strict=True))
        assert (shown["PST"], shown["NCDC"], shown["ESR"]) == row[:3]
        assert (shown["TSI"], shown["Q"], shown["PC"], shown["FR"]) == row[3:]


def test_every_measure_of_the_paper_is_one_of_ours():
    known = {measure.name for group in GROUPS["plans"] for measure in group.measures} | {"FR"}
    assert {name for table in TABLES for name in table.measures} == known - {"length_m", "duration_s"}


@pytest.mark.parametrize(
    ("difference", "spread", "verdict"),
    [
        (-5.0, 1.0, Verdict.REPRODUCED), (5.0, 1.0, Verdict.NOT_REPRODUCED), (-1.0, 20.0, Verdict.UNDECIDED),
    ],
)  # fmt: skip
def test_verdicts_by_paired_differences(difference, spread, verdict):
    base = [100.0 * seed for seed in range(20)]  # far apart, the same for both: pairs alone tell
    ours = [value + difference + spread * (-1) ** n for n, value in enumerate(base)]
    found = judge(case(safe_rrt=sample("PC", ours), taddrrt=sample("PC", base)), PC)
    assert (found.verdict, found.num_pairs) == (verdict, 20)
    assert found.difference.value == pytest.approx(difference)
    # ((1.960 + 0.8416) · s / 1)², s² = 400 · 20/19: 3304.8
    assert found.remark == ("3,305 runs would decide" if verdict is Verdict.UNDECIDED else "")


def test_few_runs_decide_nothing():
    ours, theirs = sample("PC", [1.0, 2.0, 3.0]), sample("PC", [11.0, 12.5, 13.0])
    found = judge(case(safe_rrt=ours, taddrrt=theirs), PC)
    assert (found.verdict, found.remark) == (Verdict.UNDECIDED, "10 runs would decide")
    one = judge(case(safe_rrt=sample("PC", [1.0]), taddrrt=sample("PC", [2.0])), PC)
    assert (one.verdict, one.remark) == (Verdict.UNDECIDED, "10 runs at least")


def test_runs_that_give_no_pair_are_counted_in():
    successes = [n % 3 == 0 for n in range(30)]  # a third: of 30 runs 10 pairs
    ours = sample("PC", [10.0 + (-1) ** n for n in range(30)])
    theirs = sample("PC", [10.0] * 30, successes=successes)
    found = judge(case(safe_rrt=ours, taddrrt=theirs), PC)
    assert (found.num_pairs, found.difference.value) == (10, 0.0)
    assert found.remark == "the mean difference is zero"
    ours = sample("PC", [10.1 + (-1) ** n for n in range(30)])
    # (2.8016 · 1.0541 / 0.1)² = 872.1 pairs, of three runs each
    assert judge(case(safe_rrt=ours, taddrrt=theirs), PC).remark == "2,619 runs would decide"


def test_no_difference_at_all_is_told():
    found = judge(case(safe_rrt=sample("PC", [1.0] * 20), taddrrt=sample("PC", [1.0] * 20)), PC)
    assert (found.verdict, found.remark) == (Verdict.UNDECIDED, "no difference in any pair")


def test_what_was_not_run_or_never_arrives_was_not_measured():
    ours = sample("PC", [1.0] * 20)
    assert judge(case(safe_rrt=ours), PC).remark == "no runs of taddrrt"
    failed = sample("PC", [1.0] * 20, successes=[False] * 20)
    found = judge(case(safe_rrt=ours, taddrrt=failed), PC)
    assert (found.verdict, found.remark) == (Verdict.NOT_MEASURED, "no seed with PC of both")


def test_failures_count_by_share_and_faults_are_failures():
    rate = Ordering(1, 2, "FR", "safe-rrt", "taddrrt", 0.033, 0.045)
    ours = sample("PC", [1.0] * 40)
    theirs = sample("PC", [1.0] * 40, successes=[n >= 10 for n in range(40)])
    found = judge(case(safe_rrt=ours, taddrrt=theirs), rate)
    assert (found.verdict, found.difference.value) == (Verdict.REPRODUCED, -0.25)
    assert judge(case(safe_rrt=theirs, taddrrt=ours), rate).verdict is Verdict.NOT_REPRODUCED


def test_ours_without_its_additions_is_judged_in_the_papers_place_too():
    every = sample("PC", [1.0, 2.0] * 10)
    known = case(safe_rrt=every, safe_rrt_rs=every, taddrrt=every)
    found = [entry for entry in judged(evidence(known)) if entry.ordering.measure == "PC"]
    pairs = {(entry.ordering.less, entry.ordering.more) for entry in found if entry.ordering.table == 1}
    assert {("safe-rrt", "taddrrt"), ("safe-rrt-rs", "taddrrt"), ("taddrrt", "nfz-ddrrt")} <= pairs
    assert {entry.ordering.dimension for entry in found} == {2}


def test_only_plans_on_the_papers_maps_are_judged():
    known = case(mission="valley", safe_rrt=sample("PC", [1.0]))
    assert list(judged(evidence(known))) == []
    assert list(judged(evidence(case(safe_rrt=sample("PC", [1.0])), kind="flights"))) == []


def test_counts_add_up_and_each_ordering_has_its_line():
    known = case(safe_rrt=sample("PC", [1.0, 2.0] * 10), taddrrt=sample("PC", [5.0, 6.0] * 10))
    every = list(judged(evidence(known)))
    counts = counts_table(every)
    assert sum(cell.value for row in counts.rows for cell in row[4:]) == len(every)
    by_ours = {row[3].text: sum(cell.value for cell in row[4:]) for row in counts.rows if row[1].value == 1.0}
    assert by_ours == {"safe-rrt": 3 * 7, "comparators alone": 3 * 7}
    lines = verdicts_table(every, "all").rows
    assert len(lines) == len(every)
    line = next(row for row in lines if [cell.text for cell in row[1:4]] == ["PC", "safe-rrt", "taddrrt"])
    assert [cell.text for cell in line[4:8]] == ["135.43 < 149.94", "-4 [-4, -4]", "20", "reproduced"]
