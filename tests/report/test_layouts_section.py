"""The layouts' picture is taken from the side on which they are seen."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from dlolib.report.sections.layouts import _sides


def along(*direction: float) -> Any:
    return SimpleNamespace(layout=SimpleNamespace(goal_m=np.linspace([0.1, 0.2, 0.0], direction, 20)))


def test_a_layout_is_seen_from_where_it_extends() -> None:
    assert _sides([along(0.5, 0.2, -0.1)]) == ("x-z", "x-y")
    assert _sides([along(0.1, 0.6, -0.1)]) == ("y-z", "y-x")
    assert _sides([along(0.1, 0.3, -0.1), along(0.5, 0.2, -0.1)]) == ("x-z", "x-y")
