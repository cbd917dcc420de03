"""What `make repro` looks at first: the folders that params.yaml names."""

from pathlib import Path

import pytest

from dlolib.errors import ParameterError
from dlolib.params import load
from stages import check, number, run

ROOT = Path(__file__).resolve().parents[2]


def test_what_the_file_names_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    check.main()
    assert len(list(check.named(load()))) >= 6


def test_a_log_that_is_not_there_is_said_before_the_pipeline_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (ROOT / "params.yaml").read_text()
    lines = ("  source: lab               # lab, or the name of a folder of", "  source: runs  #")
    assert lines[0] in text
    (tmp_path / "params.yaml").write_text(text.replace(*lines))
    (tmp_path / "data/runs/layout_1").mkdir(parents=True)
    for there in (ROOT / "data").iterdir():
        (tmp_path / "data" / there.name).symlink_to(there)
    (tmp_path / "data/runs/layout_1/log.csv").touch()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match=r"no such file: data/runs/layout_2/log\.csv"):
        check.main()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (("layout_4]", "layuot_4]"), "layouts: no such folder: data/layouts/layuot_4; correct the name"),
        (
            ("data/recordings/captured", "data/hose"),
            "recordings.captured.path: captured is what chain makes of",
        ),
        (("data/wires/wire_white", "data/wires/wire"), "recordings.wire_white.path: no such folder"),
        (
            ("  source: lab               # lab, or the name of a folder of", "  source: logs  #"),
            "execute.source",
        ),
    ],
)
def test_what_is_not_there_is_said_before_the_pipeline_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: tuple[str, str], says: str
) -> None:
    text = (ROOT / "params.yaml").read_text()
    assert line[0] in text
    (tmp_path / "params.yaml").write_text(text.replace(*line))
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match=says):
        check.main()
    # what DVC can bring is as good as there
    if "layuot" in line[1]:
        (tmp_path / "data").unlink()
        for _, folder in check.named(load()):
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.with_name(f"{folder.name}.dvc").touch()
        check.main()


def test_ctrl_c_ends_a_stage_without_a_traceback() -> None:
    def stage() -> None:
        raise KeyboardInterrupt

    with pytest.raises(SystemExit) as ended:
        run(stage)
    assert ended.value.code == 130


def test_a_stage_says_what_it_takes(capsys: pytest.CaptureFixture[str]) -> None:
    def stage(name: str, path: str) -> None:
        raise AssertionError("it is not called")

    with pytest.raises(SystemExit) as ended:
        run(stage, "wire_white")
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"{__name__}: arguments given: 1; give NAME PATH\n"


@pytest.mark.parametrize(("text", "least", "said"), [("0", 1, "from 1 on"), ("-1", 0, "a whole number")])
def test_a_count_that_would_replace_a_result_by_nothing_is_refused(text: str, least: int, said: str) -> None:
    with pytest.raises(ParameterError, match=f"COUNT is {text}; give COUNT as .*{said}"):
        number(text, "COUNT", least)
    assert number("1", "COUNT", 1) == 1
