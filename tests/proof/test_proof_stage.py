"""A shard: noted before it is diagnosed, sealed, resumed, revealed after; and blind."""

import csv
import json
import shlex
import subprocess
import sys
from collections.abc import Callable
from datetime import datetime, tzinfo
from functools import partial
from pathlib import Path

import pytest

from dlolib.errors import ParameterError
from dlolib.proof import book
from stages import proof, proof_next
from tests.pipeline.imports import import_graph, parts_of

SAYS = """
import json, sys
from pathlib import Path
recording, out = Path(sys.argv[1]), Path(sys.argv[2])
assert {path.name for path in Path.cwd().iterdir()} == {recording.name}, "more than the recording"
assert {path.name for path in recording.iterdir()} == {"recording.json", "motion.csv", "points.csv"}
note = Path(sys.argv[3]).read_text()
assert "diagnosing" in note, "not noted yet"
out.mkdir()
stiffness = {"bending_stiffness": {"value": 3e-4, "low": None, "high": None, "unit": "N m^2"}}
part = {"parameters": stiffness}
verdict = {"status": "no_mismatch", "effects": [], "equivalent": [], "baseline": part, "augmented": part}
(out / "verdict.json").write_text(json.dumps(verdict))
"""


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A diagnosis that sees nothing, in a fresh working folder whose shards hold nulls alone."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(proof, "draw_names", lambda seed, size: [()] * size)
    # a secret one may draw ropes on obstacles, which take the laboratory minutes
    monkeypatch.setattr(proof.secrets, "randbits", lambda bits: 1)
    monkeypatch.setattr(proof, "ProcessPoolExecutor", proof.ThreadPoolExecutor)
    (tmp_path / "dlolib/diagnose").mkdir(parents=True)
    (tmp_path / "dlolib/diagnose/diagnose.py").touch()
    for words in (["git", "init", "-q"], ["git", "add", "dlolib"], ["git", "commit", "-q", "-m", "x"]):
        who = ["-c", "user.name=x", "-c", "user.email=x@x"]
        subprocess.run([words[0], *who, *words[1:]], check=True)
    (tmp_path / "says.py").write_text(SAYS)
    noted = tmp_path / "reports/proof/runs.csv"
    return shlex.join([sys.executable, str(tmp_path / "says.py"), "{recording}", "{out}", str(noted)])


def rows() -> list[dict[str, str]]:
    return list(csv.DictReader(Path("reports/proof/runs.csv").open()))


def test_a_shard_is_noted_then_diagnosed_then_revealed(command: str) -> None:
    proof.main("--size", "2", "--command", command)
    (row,) = rows()
    assert row["state"] == "scored"
    shard = Path("data/proof/sealed") / row["shard"]
    assert row["seed"] == str(json.loads((shard / "shard.json").read_text())["seed"])
    assert row["answers_sha256"] == book.seal(shard)
    summary = json.loads(Path("reports/proof/summary.json").read_text())
    assert (summary["recordings"], summary["false_alarms"]["count"]) == (2, 0)
    written = json.loads(Path(f"reports/proof/{row['shard']}.json").read_text())
    assert written["recordings"].keys() == {"000", "001"}


def interrupted(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shard of one recording whose diagnosis broke off."""
    with monkeypatch.context() as broken:
        broken.setattr(proof, "diagnose", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            proof.main("--size", "1", "--command", command)


def test_an_interrupted_shard_stays_in_the_book_and_is_taken_up_again(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(command, monkeypatch)
    (row,) = rows()
    assert (row["state"], row["seed"]) == ("diagnosing", "")
    proof.main("--size", "1", "--command", command)
    (again,) = rows()
    assert again["shard"] == row["shard"]
    assert again["state"] == "scored"


def test_what_a_kill_leaves_behind_does_not_stop_a_shard(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Folders that were being written, and a row that was about to be called scored."""
    with monkeypatch.context() as broken:
        broken.setattr(book, "settle", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            proof.main("--size", "1", "--command", command)
    (row,) = rows()
    (Path("data/proof/sealed") / "shard_20000101T000000").mkdir()
    (Path("data/proof/recordings") / row["shard"] / ".000.cut").mkdir()
    proof.main("--size", "1", "--command", command)
    (again,) = rows()
    assert (again["shard"], again["state"]) == (row["shard"], "scored")
    assert json.loads(Path("reports/proof/summary.json").read_text())["recordings"] == 1


def test_scores_are_there_before_the_book_says_so(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proof, "summarise", lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        proof.main("--size", "1", "--command", command)
    assert rows()[0]["state"] == "diagnosing"


class Later(datetime):
    """A clock that has gone on, so that a second shard has a name of its own."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:
        return datetime(2040, 1, 1, tzinfo=tz)


def test_a_shard_that_another_version_began_to_diagnose_is_aborted(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(command, monkeypatch)
    monkeypatch.setattr(book, "version", lambda: "another")
    monkeypatch.setattr(proof, "datetime", Later)
    proof.main("--size", "1", "--command", command)
    first, second = rows()
    assert (first["state"], second["state"]) == ("aborted", "scored")
    assert first["seed"] and first["version"] != second["version"] == "another"
    assert json.loads(Path("reports/proof/summary.json").read_text())["shards"] == [second["shard"]]


def test_code_that_is_in_no_commit_begins_no_shard(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its row would name a commit that does not diagnose so, and one begun before would be aborted."""
    interrupted(command, monkeypatch)
    Path("dlolib/diagnose/diagnose.py").write_text("changed = True\n")
    with pytest.raises(ParameterError, match="commit them first"):
        proof.main("--size", "1", "--command", command)
    assert [row["state"] for row in rows()] == ["diagnosing"]


def test_changed_answers_are_refused(command: str) -> None:
    proof.main("--size", "1", "--command", command)
    (row,) = rows()
    changed = Path("data/proof/sealed") / row["shard"] / "000.json"
    changed.write_text(changed.read_text() + " ")
    with pytest.raises(ParameterError, match="sealed"):
        book.settle(proof.BOOK, row["shard"], changed.parent, 1)


def test_answers_made_again_may_be_rounded_otherwise_but_not_be_others(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another processor's last digits miss the sealed hash; another laboratory's gains are refused."""
    proof.main("--size", "1", "--command", command)
    (row,) = rows()
    path = Path("data/proof/sealed") / row["shard"] / "000.json"
    told = Path(f"reports/proof/{row['shard']}.json")
    scored = json.loads(told.read_text())
    scored["recordings"]["000"]["elastic_gain"] = 100.0
    told.write_text(json.dumps(scored))

    def made_again(gain: float) -> None:
        path.write_text(json.dumps(json.loads(path.read_text()) | {"elastic_gain": gain}))

    made_again(100.0 * (1.0 + 1e-8))
    assert proof.last_shards().keys() == {row["shard"]}
    made_again(100.01)
    with pytest.raises(ParameterError, match="not those that were sealed"):
        proof.last_shards()


def test_the_laboratory_shares_nothing_with_what_infers() -> None:
    graph = import_graph()
    ours = {"dlolib.sim", "dlolib.identify", "dlolib.learn", "dlolib.chain", "dlolib.diagnose"}
    reached = graph.find_upstream_modules("stages.proof")
    assert not {module for module in reached if ".".join(module.split(".")[:2]) in ours}


def test_what_infers_cannot_reach_the_laboratory() -> None:
    graph = import_graph()
    for package in ("dlolib.sim", "dlolib.identify", "dlolib.diagnose", "dlolib.cli"):
        assert package in graph.modules
        inside = {package} | graph.find_descendants(package)
        for module in inside:
            assert not any(name.startswith("dlolib.proof") for name in graph.find_upstream_modules(module))


def test_the_version_is_of_all_that_diagnoses() -> None:
    made_of = {part for part in parts_of("diagnose") if part.startswith("dlolib/")}
    shown = {"dlolib/cli", "dlolib/report/diagnosis.py"}
    assert made_of - {"dlolib/params"} | shown == set(book.PARTS)


@pytest.mark.parametrize(
    ("result", "told", "count"),
    [
        ("without.json", "owned_up", partial(proof.main, "--without")),
        ("next.json", "told_apart", partial(proof_next.main, "--only")),
    ],
)
def test_what_was_counted_of_other_shards_of_this_version_stays(
    result: str, told: str, count: Callable[..., None], command: str
) -> None:
    proof.main("--size", "1", "--command", command)
    (shard,) = (row["shard"] for row in rows())
    counted = {"shard": "shard_0", "name": "000", "outcome": "right", "owned_up": True}
    path = Path("reports/proof") / result
    for version, left in ((book.version(), [counted]), ("another", [])):
        path.write_text(json.dumps({"version": version, "recordings": [counted]}))
        count(shard, "--command", command)
        found = json.loads(path.read_text())
        assert found["recordings"] == left and found[told]["of"] == len(left)
    with pytest.raises(ParameterError, match=r"there is no shard shard_0"):
        count("shard_0", "--command", command)
