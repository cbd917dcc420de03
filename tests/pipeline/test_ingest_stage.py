"""The stage `ingest` makes the capture that the command makes, of recordings of other software too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros

from dlolib.cli import run
from dlolib.errors import DloError
from stages.ingest import main
from tests.pipeline.conftest import ROOT

HELD = {"start": "clamped", "end": "clamped"}
STILL = {"position_m": [0.0, 0.0, 0.0], "quaternion": [0.5, 0.5, 0.5, 0.5]}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data/hose").mkdir(parents=True)
    return tmp_path / "data/hose"


def params(**ingest: Any) -> None:
    content = yaml.safe_load((ROOT / "params.yaml").read_text())
    content["ingest"] |= {"source": "hose", **ingest}
    Path("params.yaml").write_text(yaml.safe_dump(content))


def files(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def same(source: str, *options: str) -> None:
    """The stage's capture is the command's."""
    main()
    assert run(["ingest", source, "--out", "expected", *options]) == 0
    assert files(Path("data/capture")) == files(Path("expected")) != {}


def test_a_bag_with_its_object_beside_it_and_the_motion_of_a_topic(folder: Path) -> None:
    shot = foreign.frames()
    foreign.bag(folder / "rope.bag", shot, Ros(second_depth=True), foreign.motion(shot))
    foreign.given(folder / "rope.json", ends=HELD, start=STILL)
    params(recording="rope.bag", topics={"depth": foreign.DEPTH, "motion": foreign.TOOL})
    topics = [f"--topic=depth={foreign.DEPTH}", f"--topic=motion={foreign.TOOL}"]
    same("data/hose/rope.bag", *topics)


def test_a_folder_of_images_and_a_motion_in_it(folder: Path) -> None:
    shot = foreign.frames()
    foreign.redwood(folder, shot)
    foreign.elsewhere(folder, foreign.motion(shot))
    foreign.given(folder / "about.json", ends=HELD)
    params(motion="robot.csv", object="about.json")
    same("data/hose", "--motion", "data/hose/robot.csv", "--object", "data/hose/about.json")


def test_a_capture_needs_no_more_than_its_name(folder: Path) -> None:
    foreign.own(folder / "own", foreign.frames())
    params(source="hose/own")
    with pytest.raises(DloError, match=r"ingest\.source"):
        main()
    params(recording="own")
    same("data/hose/own")


@pytest.mark.parametrize("name", ["../lab/x.bag", "/etc/hostname", ".hidden", "a//b", "a/../b"])
def test_nothing_outside_the_folder(folder: Path, name: str) -> None:
    params(recording=name)
    with pytest.raises(DloError, match=r"ingest\.recording"):
        main()


def test_a_topic_of_an_unknown_role(folder: Path) -> None:
    params(recording="rope.bag", topics={"smell": "/nose"})
    with pytest.raises(DloError, match=r"ingest\.topics\.smell"):
        main()
