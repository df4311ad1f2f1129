"""The Dockerfile and the proof that carries it out keep to each other. ``make image`` runs the proof."""

import json
import re
from pathlib import Path

import pytest

from tests.packaging.tools import loaded

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "Dockerfile").read_text(encoding="utf-8")


proof = loaded("prove_image")
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


def test_nothing_is_installed_without_its_hash_but_the_project_itself():
    installs = re.findall(r"pip install ([^&]+)", " ".join(words("RUN")))
    assert len(installs) == 3
    for rest in installs:
        if "--no-deps --no-build-isolation ." not in rest:
            assert "--only-binary :all: --require-hashes -r requirements/" in rest


def test_the_bill_of_materials_is_where_the_proof_looks_for_it_and_made_when_all_else_is_gone():
    (build,) = (rest for rest in words("RUN") if "cyclonedx-py" in rest)
    assert f"--output-file {proof.SBOM} /opt/companion/bin/python" in build
    assert proof.SBOM.startswith("/opt/companion/")  # all of which is copied into the image
    assert build.index("pip uninstall") < build.index("cyclonedx-py environment")


@pytest.fixture
def image(tmp_path):
    """An image's folder with two packages and the bill of materials of them."""
    packages = tmp_path / "opt/companion/lib/python3.11/site-packages"
    for name, version in (("Some_Thing", "1.2"), ("other", "3")):
        folder = packages / f"{name}-{version}.dist-info"
        folder.mkdir(parents=True)
        text = f"Metadata-Version: 2.4\nName: {name}\nVersion: {version}\n\nName: of something else\n"
        (folder / "METADATA").write_text(text, encoding="utf-8")
    rows = [{"name": "some-thing", "version": "1.2"}, {"name": "other", "version": "3"}]
    bill = tmp_path / proof.SBOM.lstrip("/")
    bill.parent.mkdir()
    bill.write_text(json.dumps({"bomFormat": "CycloneDX", "components": rows}), encoding="utf-8")
    return tmp_path, bill


def test_a_bill_of_materials_of_what_is_installed_passes(image):
    assert proof.prove_contents(image[0]) == 2


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda rows: rows.pop(), "something else: .*other"),
        (lambda rows: rows.append({"name": "pip", "version": "1"}), "something else: .*pip"),
        (lambda rows: rows[0].update(version="1.3"), "something else: .*1.3"),
    ],
)
def test_one_of_something_else_does_not(image, change, told):
    root, bill = image
    document = json.loads(bill.read_text(encoding="utf-8"))
    change(document["components"])
    bill.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(RuntimeError, match=told):
        proof.prove_contents(root)


def test_a_file_of_another_format_is_no_bill_of_materials(image):
    root, bill = image
    bill.write_text('{"components": []}', encoding="utf-8")
    with pytest.raises(ValueError, match="CycloneDX"):
        proof.prove_contents(root)
