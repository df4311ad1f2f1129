"""What a mutant is, and what is left alone."""

from tests.mutants.changes import mutants_of


def changed(text):
    """The lines of all mutants of a text that are not lines of it."""
    plain = text.splitlines()
    texts = [mutant.text() for mutant in mutants_of("companion/example.py", text)]
    return {line.strip() for each in texts for line in each.splitlines() if line not in plain}


def test_operators_conditions_constants_and_results_are_changed():
    text = "def far(a: float) -> bool:\n    return a + 2 > 0.5 and a < 9\n"
    assert changed(text) == {
        "return a - 2 > 0.5 and a < 9",
        "return a + 3 > 0.5 and a < 9",
        "return a + 2 >= 0.5 and a < 9",
        "return a + 2 > 0.75 and a < 9",
        "return a + 2 > 0.5 or a < 9",
        "return a + 2 > 0.5 and a <= 9",
        "return a + 2 > 0.5 and a < 10",
        "return not (a + 2 > 0.5 and a < 9)",
    }


def test_statements_and_defaults_are_changed():
    text = "def go(self, is_fast=False):\n    self.n = n\n    if is_fast:\n        stop()\n"
    assert changed(text) == {"def go(self, is_fast=True):", "pass", "if not is_fast:"}


def test_words_for_people_and_for_type_checkers_are_left_alone():
    text = (
        '"""Words 1."""\n\nif TYPE_CHECKING:\n    x = 1\n\ndef go(a: "int | 2") -> "3":\n    """Words 4."""\n'
        "    assert a > 5\n    _log.info('six', 6)\n\ndef __repr__(self):\n    return str(7)\n"
    )
    assert changed(text) == set()


def test_a_mutant_knows_its_lines_and_what_it_defines():
    found = list(
        mutants_of("companion/example.py", "LIMIT_M = 5.0\n\ndef go(n=1):\n    x = 2\n    return x\n")
    )
    assert [(each.lines, each.names) for each in found] == [
        ((1, 1), ("LIMIT_M",)), ((4, 5), ()), ((4, 4), ()), ((5, 5), ()),
    ]  # fmt: skip
    assert found[0].name == "companion/example.py: module: 5.0 -> 7.5"
