"""fit.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from formats import samples

from dlolib.errors import FormatError
from dlolib.formats import read_fit, write_fit
from dlolib.types import Estimate, Fit, Rope

FIT = Fit(
    {"bending_stiffness": Estimate(3e-4, 2.9e-4, None, "N m^2")},
    0.0012,
    40,
    1200,
    {"small": {"end_angle.start_1": Estimate(0.01, None, None, "rad")}},
    Rope("wire", 0.4, diameter_m=0.008),
)


def test_round_trip_from_file_and_folder(tmp_path: Path) -> None:
    write_fit(FIT, tmp_path)
    assert read_fit(tmp_path) == read_fit(tmp_path / "fit.json") == FIT


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("format", "dlo-verdict/1", "format: says 'dlo-verdict/1'"),
        ("rmse_m", None, "rmse_m: Input should be a valid number"),
        (
            "parameters.bending_stiffness",
            {"unit": "N m^2"},
            "parameters.bending_stiffness.value: Field required",
        ),
        (
            "parameters.bending_stiffness.high",
            1e-4,
            "parameters.bending_stiffness: low = 0.00029 is above high = 0.0001; swap them",
        ),
        (
            "parameters.bending_stiffness",
            {"value": 0.0, "low": None, "high": None, "unit": "N m^2"},
            "the whole: bending_stiffness = 0 is not positive; give a value above 0",
        ),
        ("frames", 1.5, "frames: Input should be a valid integer"),
    ],
)
def test_a_bad_key_is_named(tmp_path: Path, key: str, value: Any, says: str) -> None:
    write_fit(FIT, tmp_path)
    samples.set_key(tmp_path / "fit.json", key, value)
    with pytest.raises(FormatError) as caught:
        read_fit(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'fit.json'}: {says}")


def test_unknown_keys_are_ignored(tmp_path: Path) -> None:
    write_fit(FIT, tmp_path)
    content = json.loads((tmp_path / "fit.json").read_text())
    (tmp_path / "fit.json").write_text(json.dumps(content | {"seed": 3}))
    assert read_fit(tmp_path) == FIT
