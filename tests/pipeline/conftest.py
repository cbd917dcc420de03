"""A small repository with the real dvc.yaml and params.yaml, whose stages a stand-in runs in milliseconds."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent

# Stands in for `python` in a stage's command: notes which stage ran and writes outputs that nobody has
# written before, so that whatever depends on them is stale and must run too.
STAND_IN = """#!{python}
import json, pathlib, sys, uuid
here = pathlib.Path(__file__).parent
name = sys.argv[2].removeprefix("stages.") + "".join("@" + word for word in sys.argv[3:4])
for path in json.loads((here / "outs.json").read_text())[name]:
    target = pathlib.Path(path)
    if not target.suffix:
        target.mkdir(parents=True, exist_ok=True)
        kinds = {{"diagnose": ["verdict.json"], "learn": ["trajectory.csv"]}}
        names = kinds.get(name.split("@")[0], ["content"])
        files = [target / file for file in names]
    else:
        target.parent.mkdir(parents=True, exist_ok=True)
        files = [target]
    for file in files:
        file.write_text(json.dumps({{"token": uuid.uuid4().hex}}))
with open(here / "log", "a") as log:
    log.write(name + "\\n")
"""


def stages_of(dvc_yaml: Path, params_yaml: Path) -> dict[str, dict]:
    """The stages as DVC resolves them: name → {cmd, deps, params, outs, ...}, `foreach` unrolled."""
    from dvc.dvcfile import load_file
    from dvc.repo import Repo

    with Repo(str(dvc_yaml.parent), uninitialized=True) as repo:
        return load_file(repo, str(dvc_yaml)).resolver.resolve()["stages"]


def names(entries: list) -> list[str]:
    """Paths of outs, deps or metrics, whether written alone or with options."""
    return [entry if isinstance(entry, str) else next(iter(entry)) for entry in entries]


@dataclass
class Pipeline:
    """The small repository: its folder, and what to do with it."""

    folder: Path

    @property
    def params(self) -> Path:
        return self.folder / "params.yaml"

    def dvc(self, *words: str) -> str:
        environment = {**os.environ, "PATH": f"{self.folder / '.bin'}:{BIN}:{os.environ['PATH']}"}
        done = subprocess.run(
            [BIN / "dvc", *words],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def repro(self) -> list[str]:
        """Run the pipeline; the stages that ran, in order."""
        log = self.folder / ".bin" / "log"
        log.write_text("")
        self.refresh()
        self.dvc("repro", "--no-run-cache")
        return log.read_text().split()

    def stale(self) -> set[str]:
        """The stages that DVC finds changed, and by its own graph all that depend on them."""
        import networkx
        from dvc.repo import Repo

        with Repo(str(self.folder)) as repo:
            changed = repo.status()
            graph = repo.index.graph.reverse()
            first = [stage for stage in graph if stage.addressing in changed]
            after = {stage for one in first for stage in networkx.descendants(graph, one)}
            return {stage.addressing.rpartition(":")[2] for stage in {*first, *after} if stage.cmd}

    def refresh(self) -> None:
        """Tell the stand-in what each stage has to write."""
        resolved = stages_of(self.folder / "dvc.yaml", self.params)
        outs = {
            name: names(stage.get("outs", [])) + names(stage.get("metrics", []))
            for name, stage in resolved.items()
        }
        (self.folder / ".bin" / "outs.json").write_text(json.dumps(outs))

    def change(self, old: str, new: str) -> None:
        """Replace one line of params.yaml (without its indentation and comment)."""
        text = self.params.read_text()
        changed, count = re.subn(rf"(?m)^( *){re.escape(old)}( *#.*)?$", rf"\g<1>{new}", text)
        assert count == 1, f"{count} lines of params.yaml read {old!r}"
        self.params.write_text(changed)

    def git(self, *words: str) -> str:
        who = ["-c", "user.name=t", "-c", "user.email=t@t"]
        return subprocess.run(
            ["git", *who, *words], cwd=self.folder, capture_output=True, text=True, check=True
        ).stdout


def make_pipeline(folder: Path, layouts: int | None = None) -> Pipeline:
    """Fill an empty folder with the pipeline's real files and the stand-in; only so many layouts if told."""
    for name in ("dvc.yaml", "params.yaml", ".dvcignore", ".gitignore"):
        shutil.copy(ROOT / name, folder / name)
    for name in (".dvc/config", ".dvc/.gitignore"):
        (folder / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    shutil.copytree(ROOT / ".dvc/plots", folder / ".dvc/plots")
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "stages", folder / "stages", ignore=ignore)
    shutil.copytree(ROOT / "dlolib", folder / "dlolib", ignore=ignore)
    shutil.copytree(ROOT / "data/wires", folder / "data/wires")
    for layout in yaml.safe_load((ROOT / "params.yaml").read_text())["layouts"]:
        (folder / "data/layouts" / layout).mkdir(parents=True)
        (folder / "data/layouts" / layout / "layout.json").write_text("{}")
    (folder / "reports/proof").mkdir(parents=True)
    measured = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]["report"]["deps"]
    for name in ("reports/proof/summary.json", *(one for one in measured if one.endswith(".json"))):
        (folder / name).write_text("{}")
    stand_in = folder / ".bin" / "python"
    stand_in.parent.mkdir()
    stand_in.write_text(STAND_IN.format(python=sys.executable))
    stand_in.chmod(0o755)
    with (folder / ".gitignore").open("a") as ignored:
        ignored.write("/.bin/\n")
    pipeline = Pipeline(folder)
    if layouts is not None:
        every = "layout_1, layout_2, layout_3, layout_4"
        pipeline.change(f"layouts: [{every}]", f"layouts: [{', '.join(every.split(', ')[:layouts])}]")
    pipeline.git("init", "-q")
    pipeline.git("add", "-A")
    pipeline.git("commit", "-qm", "start")
    return pipeline


def finished_in(folder: Path, layouts: int | None = None) -> Pipeline:
    """The small repository after a first run, committed."""
    made = make_pipeline(folder, layouts)
    made.repro()
    made.git("add", "-A")
    made.git("commit", "-qm", "run")
    return made


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Pipeline:
    """To look at, not to change."""
    return finished_in(tmp_path_factory.mktemp("finished"))


@pytest.fixture
def pipeline(finished: Pipeline, tmp_path: Path) -> Pipeline:
    """A copy to change."""
    shutil.copytree(finished.folder, tmp_path / "copy", symlinks=True)
    return Pipeline(tmp_path / "copy")
