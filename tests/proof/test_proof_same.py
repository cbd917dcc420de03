"""Versions that give the same verdicts count together, and no others."""

import json
from pathlib import Path

import pytest

from dlolib.errors import ParameterError
from dlolib.proof import book
from stages import proof, proof_same
from tests.proof.test_proof_stage import command, rows  # noqa: F401  (a fixture)


def scored_shard(command: str, size: int = 2) -> dict[str, str]:  # noqa: F811
    """The book's row of a scored shard; what diagnoses no longer asks whether it is noted."""
    proof.main("--size", str(size), "--command", command)
    says = Path("says.py")
    says.write_text(says.read_text().replace('assert "diagnosing" in note', "assert note"))
    (row,) = rows()
    return row


def test_a_version_with_the_same_verdicts_counts_with_the_one_before(
    command: str,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = scored_shard(command)
    monkeypatch.setattr(book, "version", lambda: "later")
    assert book.alike(proof.BOOK, "later") == {"later"}
    proof_same.main(row["shard"], "--command", command)
    assert (
        book.alike(proof.BOOK, "later") == {"later", row["version"]} == book.alike(proof.BOOK, row["version"])
    )
    (found,) = book.compared(proof.BOOK)
    assert (found["recordings"], found["differ"], found["judged_otherwise"]) == (2, [], [])
    assert proof.totals()["shards"] == [row["shard"]] == proof.totals()["shards_of_intervals"]


def test_a_verdict_that_says_something_else_beside_what_is_judged_is_the_same(
    command: str,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = scored_shard(command)
    changed(row, "001", verdict_sha256="0" * 64, stiffness_deviation=0.5)
    monkeypatch.setattr(book, "version", lambda: "later")
    proof_same.main(row["shard"], "--command", command)
    (found,) = book.compared(proof.BOOK)
    assert (found["differ"], found["otherwise"], found["judged_otherwise"]) == (["001"], [], [])
    assert book.alike(proof.BOOK, "later") == {"later", row["version"]}


def test_digits_of_an_error_that_no_figure_tells_do_not_count() -> None:
    row = {"outcome": "right", "stiffness_error": {"baseline": 0.138, "augmented": 0.0026}, "tie": []}
    digits = row | {"stiffness_error": {"baseline": 0.13805, "augmented": 0.0026}}
    assert proof_same._alike(row, digits)
    larger = row | {"stiffness_error": {"baseline": 0.1385, "augmented": 0.0026}}
    for other in (larger, row | {"outcome": "wrong"}, row | {"tie": [["end_angle"]]}, {"outcome": "right"}):
        assert not proof_same._alike(row, other)


def changed(row: dict[str, str], name: str, **values: object) -> None:
    """Write other values into the scored row of a recording."""
    path = proof.BOOK / f"{row['shard']}.json"
    written = json.loads(path.read_text())
    written["recordings"][name] |= values
    path.write_text(json.dumps(written))


def test_versions_that_differ_in_intervals_count_together_but_for_these(
    command: str,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = scored_shard(command)
    changed(row, "001", verdict_sha256="0" * 64, covered={"bending_stiffness": False})
    monkeypatch.setattr(book, "version", lambda: "later")
    proof_same.main(row["shard"], "--command", command)
    (found,) = book.compared(proof.BOOK)
    assert (found["otherwise"], found["judged_otherwise"]) == (["001"], [])
    assert book.alike(proof.BOOK, "later") == {"later"}
    assert book.alike(proof.BOOK, "later", but_intervals=True) == {"later", row["version"]}
    # a shard of the later version brings its own intervals, and no other's count beside them
    proof.main("--size", "1", "--command", command)
    totals = proof.totals()
    assert totals["recordings"] == 3 and len(totals["shards_of_intervals"]) == 1
    assert totals["coverage"]["all"]["of"] == 0


def test_what_is_judged_otherwise_makes_two_versions(command: str, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    row = scored_shard(command)
    changed(row, "001", verdict_sha256="0" * 64, outcome="wrong")
    monkeypatch.setattr(book, "version", lambda: "later")
    proof_same.main(row["shard"], "--command", command)
    assert book.compared(proof.BOOK)[0]["judged_otherwise"] == ["001"]
    assert book.alike(proof.BOOK, "later", but_intervals=True) == {"later"}
    proof.main("--size", "1", "--command", command)
    totals = proof.totals()
    assert [version["recordings"] for version in totals["versions"]] == [2, 1]
    assert totals["recordings"] == 1


def test_sameness_goes_on_from_version_to_version(tmp_path: Path) -> None:
    # what one shard showed alike another tells apart
    pairs = [("b", "a", []), ("c", "b", []), ("d", "c", ["000"]), ("e", "c", []), ("e", "c", ["001"])]
    compared = [{"version": new, "as": old, "differ": differ} for new, old, differ in pairs]
    (tmp_path / book.SAME).write_text(json.dumps({"compared": compared}))
    assert book.alike(tmp_path, "a") == {"a", "b", "c"}
    assert book.alike(tmp_path, "d") == {"d"}
    assert book.alike(tmp_path, "e") == {"e"}


def test_what_is_in_no_commit_is_no_version(command: str) -> None:  # noqa: F811
    row = scored_shard(command, size=1)
    Path("dlolib/diagnose/diagnose.py").write_text("changed = True\n")
    with pytest.raises(ParameterError, match="commit them first"):
        proof_same.main(row["shard"], "--command", command)
