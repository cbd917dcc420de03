"""Numbers and marks of running text."""

from __future__ import annotations

import math

import pytest

from dlolib.report.text import fixed, listed, millimetres, nice_unit, scientific, sentence, span, spans, title


@pytest.mark.parametrize(
    ("value", "shown"),
    [(3.0213e-4, "3.02 × 10⁻⁴"), (0.0, "0"), (1.5, "1.50"), (-0.02, "−0.0200"), (12345.0, "1.23 × 10⁴"),
     (None, "–"), (math.nan, "–"), (math.inf, "–"), (9.999e-5, "1.00 × 10⁻⁴")],
)  # fmt: skip
def test_scientific(value: float | None, shown: str) -> None:
    assert scientific(value) == shown


def test_span_has_one_power_of_ten() -> None:
    assert span(2.951e-4, 3.162e-4) == "2.95 to 3.16 × 10⁻⁴"
    assert span(-0.5, 0.25) == "−0.500 to 0.250"
    assert span(1.5, None) == "above 1.50"
    assert span(None, 1.5) == "below 1.50"
    assert span(None, None) == "–"


def test_fixed_has_a_true_minus_sign() -> None:
    assert fixed(-1.25) == "−1.2"
    assert millimetres(-0.0012, 2) == "−1.20"
    assert millimetres(None) == "–"


def test_marks_are_split() -> None:
    assert spans("a `b` **c** α~b~ d") == [
        ("text", "a "), ("code", "b"), ("text", " "), ("strong", "c"), ("text", " α"), ("sub", "b"), ((
            "text"
        ), (
            " d"
        )),
    ]  # fmt: skip
    assert spans("plain") == [("text", "plain")]


def test_names_as_a_person_writes_them() -> None:
    assert title("layout_1") == "Layout 1"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert listed(["a"]) == "a"


def test_units_as_a_person_writes_them() -> None:
    assert nice_unit("N m^2") == "N m²"
    assert nice_unit("m^4/s^2") == "m⁴/s²"


def test_sentences_of_a_verdict_as_a_person_writes_them() -> None:
    says = "grows: cubic -0.0031 ± 3.1e-05 m^2; 2 to -3.5 rad in frames 3-7"
    assert sentence(says) == "grows: cubic −0.0031 ± 3.1 × 10⁻⁵ m²; 2 to −3.5 rad in frames 3-7"
