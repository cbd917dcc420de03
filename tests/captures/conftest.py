"""What the tests of refused recordings share."""

from __future__ import annotations

from pathlib import Path

import pytest
from captures.refusals import Refusals


@pytest.fixture
def refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> Refusals:
    return Refusals(tmp_path, capfd)
