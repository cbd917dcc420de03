"""Results of every stage, and a report whose figures are not drawn."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure as Canvas
from report.synthetic import write_results


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_results(tmp_path_factory.mktemp("run"))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are composed but not drawn, which takes most of the time."""
    monkeypatch.setattr(Canvas, "get_layout_engine", lambda self: None)
    monkeypatch.setattr(Canvas, "savefig", lambda self, path, **_: Path(path).touch())
