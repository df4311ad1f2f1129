"""The Dockerfile and the proof that carries it out keep to each other. ``make image`` runs the proof."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def loaded():
    spec = importlib.util.spec_from_file_location("prove_image", ROOT / "packaging" / "prove_image.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["prove_image"] = module
    spec.loader.exec_module(module)
    return module


proof = loaded()
STEPS = proof.instructions(TEXT)


def words(name):
    return [step.rest for step in STEPS if step.word == name]


def test_every_instruction_is_one_that_the_proof_carries_out():
    assert {step.word for step in STEPS} <= set(proof.KNOWN)
    assert all(hasattr(proof.Builder, f"_{word.lower()}") for word in proof.KNOWN)


@pytest.mark.parametrize("added", ["ADD x y", "ARG X", "VOLUME /x", 'SHELL ["sh"]', "run lower"])
def test_an_instruction_that_it_does_not_know_ends_the_proof(added):
    with pytest.raises(ValueError, match=r"Dockerfile:\d+: "):
        proof.instructions(f"{TEXT}\n{added}\n")


def test_continuation_lines_are_joined_and_comments_left_out():
    steps = proof.instructions("# one\nRUN a \\\n  # inside\n    && b\n\nUSER c\n")
    assert [(step.word, step.rest, step.line) for step in steps] == [("RUN", "a && b", 2), ("USER", "c", 6)]


def test_both_stages_begin_with_an_image_that_the_proof_stands_in_for():
    assert len(words("FROM")) == 2
    assert all(proof.BASE.fullmatch(rest.partition(" AS ")[0]) for rest in words("FROM"))


def test_it_runs_as_a_user_of_its_own_with_a_health_check():
    last = {step.word: number for number, step in enumerate(STEPS)}
    assert words("USER") == ["companion"]
    assert last["USER"] < last["ENTRYPOINT"]
    assert '["companion", "health"]' in words("HEALTHCHECK")[0]
    assert words("STOPSIGNAL") == ["SIGTERM"]


def test_nothing_in_it_is_for_one_kind_of_processor():
    code = re.sub(r"(?m)^#.*$", "", TEXT)
    assert not re.search(r"amd64|arm64|aarch64|x86|TARGETARCH|--platform", code)
    assert "NUMBA_CPU_NAME=generic" in code


def test_what_is_copied_is_there_and_gets_past_the_ignore_file():
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert ignored[0] == "*"
    for rest in words("COPY"):
        if "--from" in rest:
            continue
        for source in rest.split()[:-1]:
            assert (ROOT / source).exists()
            assert f"!{source}" in ignored


def test_the_extras_that_are_installed_exist():
    extras = re.search(r"'\.\[([a-z,]+)\]'", TEXT)[1].split(",")
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert all(re.search(rf"(?m)^{extra} = \[", project) for extra in extras)
