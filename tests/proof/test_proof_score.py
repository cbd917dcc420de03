"""Right, tied, confidently wrong: made-up verdicts against made-up answers."""

from typing import Any

import pytest

from dlolib.proof.score import outcome, owns_up, score, share, summarise


def answer(*names: str, detectable: tuple[str, ...] | None = None, gain: float = 100.0) -> dict[str, Any]:
    found = names if detectable is None else detectable
    return {
        "effects": list(names),
        "detectable": list(found),
        "elastic_gain": gain if names else 0.0,
        "everywhere": {"detectable": list(names), "elastic_gain": gain if names else 0.0},
        "parameters": {name: {"s": 0.2, "mass": 0.001, "gradient": 0.0} for name in names},
        "bending_stiffness": 3e-4,
        "nearest": {},
        "touch_m": None,
    }


def verdict(
    status: str, *names: str, tie: tuple[tuple[str, ...], ...] = (), s: float = 0.2
) -> dict[str, Any]:
    place = {"value": s, "low": s - 0.005, "high": s + 0.005, "unit": "m"}
    stiffness = {"value": 3.3e-4, "low": 3.2e-4, "high": 3.4e-4, "unit": "N m^2"}
    better = {"value": 3.01e-4, "low": 2.9e-4, "high": None, "unit": "N m^2"}
    return {
        "status": status,
        "effects": [{"name": name, "parameters": {"s": place}} for name in names],
        "equivalent": [list(one) for one in tie],
        "baseline": {"parameters": {"bending_stiffness": stiffness}},
        "augmented": {"parameters": {"bending_stiffness": better}},
        "candidates": [
            {"kind": "library", "effects": list(names), "heldout_delta_chi2": -30.0},
            {"kind": "wrong_same_size", "effects": [CLOCK], "heldout_delta_chi2": 9.0},
            {"kind": "black_box", "effects": [], "heldout_delta_chi2": -40.0 if s > 0.22 else -10.0},
        ],
    }


LUMP, SPOT, CLOCK = "mass_profile", "stiffness_profile", "clock_offset"
FOUR = ((SPOT,), (CLOCK,), (LUMP,), (LUMP, SPOT))


@pytest.mark.parametrize(
    ("said", "true", "judged"),
    [
        (verdict("no_mismatch"), answer(), "right"),
        (verdict("explained", LUMP), answer(), "wrong"),
        (verdict("unexplained"), answer(), "undecided"),
        (verdict("explained", LUMP), answer(LUMP), "right"),
        (verdict("explained", SPOT), answer(LUMP), "wrong"),
        (verdict("no_mismatch"), answer(LUMP), "missed"),
        (verdict("no_mismatch"), answer(LUMP, detectable=(), gain=9.0), "right"),
        (verdict("explained", LUMP), answer(LUMP, detectable=(), gain=9.0), "right"),
        (verdict("ambiguous", SPOT, tie=((SPOT,), (LUMP,))), answer(LUMP), "tied"),
        (verdict("ambiguous", SPOT, tie=((SPOT,), (CLOCK,))), answer(LUMP), "undecided"),
        (
            verdict("ambiguous", SPOT, tie=FOUR),
            answer(LUMP),
            "undecided",
        ),
        (verdict("explained", LUMP), answer(LUMP, SPOT), "wrong"),
        (verdict("explained", SPOT, LUMP), answer(LUMP, SPOT), "right"),
        (verdict("explained", LUMP), answer(LUMP, SPOT, detectable=(LUMP,)), "right"),
        (verdict("explained", SPOT), answer(LUMP, SPOT, detectable=(LUMP,)), "wrong"),
        (verdict("no_mismatch"), answer(LUMP, SPOT, detectable=()), "missed"),
        (verdict("explained", SPOT), answer(LUMP, SPOT, detectable=()), "right"),
        (None, answer(LUMP), "failed"),
    ],
)
def test_outcomes(said: dict[str, Any] | None, true: dict[str, Any], judged: str) -> None:
    assert outcome(said, true) == judged


def test_the_summary_counts() -> None:
    rows = [
        score(verdict("explained", LUMP, s=0.203), answer(LUMP)),
        score(verdict("explained", LUMP, s=0.25), answer(LUMP)),
        score(verdict("explained", SPOT), answer(LUMP)),
        score(verdict("no_mismatch"), answer()),
        score(verdict("explained", SPOT), answer()),
        score(verdict("explained", SPOT, LUMP), answer(LUMP, SPOT)),
        score(verdict("no_mismatch"), answer(CLOCK)),
        score(verdict("no_mismatch"), answer(SPOT, detectable=(), gain=9.0)),
        score(verdict("explained", LUMP), answer(SPOT, detectable=(), gain=9.0)),
    ]
    figures = summarise(rows)
    assert figures["detectable"] == 5
    assert figures["drawn"] == {"alone": {CLOCK: 1, LUMP: 3, SPOT: 2}, "pairs": 1, "combinations": 1}
    assert figures["right_or_tied"]["share"] == pytest.approx(3 / 5)
    assert figures["confidently_wrong"]["count"] == 2
    assert figures["missed"]["count"] == 1
    assert figures["wrong_of_too_small"] == share(1, 2)
    assert figures["heldout_better"] == share(6, 6)
    assert figures["heldout_better_than_black_box"] == share(5, 6)
    # an alarm where nothing is missing does not count there
    assert figures["where_detectable"]["heldout_better"] == share(4, 4)
    # what shows in the held-out frames alone counts there
    assert figures["everywhere"]["right_or_tied"]["of"] == 7
    assert figures["everywhere"]["confidently_wrong"]["count"] == 4
    assert figures["false_alarms"]["count"] == 1
    assert figures["pairs_both_named"]["share"] == 1
    assert figures["place"] == share(3, 4)
    assert figures["coverage"]["mass_profile.s"]["count"] == 2
    assert figures["stiffness_bias"]["ratio"] == pytest.approx(1 / 30)
    assert figures["by_effect"][LUMP] == {"right": 2, "wrong": 1}
    assert {"true": CLOCK, "said": "no_mismatch", "count": 1} in figures["confusion"]


def test_a_row_says_what_was_true_and_what_was_said() -> None:
    row = score(verdict("ambiguous", SPOT, tie=((SPOT,), (LUMP,))), answer(LUMP))
    assert (row["true"], row["status"], row["named"]) == ([LUMP], "ambiguous", [SPOT])
    assert (row["tie"], row["outcome"]) == ([[SPOT], [LUMP]], "tied")
    failed = score(None, answer(LUMP))
    assert (failed["status"], failed["named"], failed["tie"], failed["outcome"]) == (None, [], [], "failed")


def test_what_is_left_of_a_bias_is_told_by_its_size() -> None:
    row = score(verdict("explained", LUMP), answer(LUMP))
    errors = [(-0.005, 0.005), (0.03, 0.006), (-0.07, 0.007), (0.2, -0.01)]
    rows = [{**row, "stiffness_error": {"baseline": b, "augmented": a}} for b, a in errors]
    told = summarise(rows)["stiffness_bias"]
    assert told["ratio"] == pytest.approx(0.15)
    found = [(one["without_more_than"], one["recordings"], one["ratio"]) for one in told["where"]]
    assert found == [
        (0.01, 3, pytest.approx(0.1)),
        (0.02, 3, pytest.approx(0.1)),
        (0.05, 2, pytest.approx(0.075)),
        (0.1, 1, pytest.approx(0.05)),
    ]


def test_what_may_be_left_of_a_bias_is_what_intervals_say() -> None:
    said = verdict("explained", LUMP)
    row = score(said, answer(LUMP))
    assert row["stiffness_deviation"] is None  # the interval has no end
    said["augmented"]["parameters"]["bending_stiffness"]["high"] = 3.12e-4
    assert score(said, answer(LUMP))["stiffness_deviation"] == pytest.approx(0.22 / 3.92 / 3.01, rel=1e-4)
    rows = [
        {**row, "stiffness_error": {"baseline": b, "augmented": 0.0}, "stiffness_deviation": d}
        for b, d in ((0.1, 0.01), (-0.1, 0.01), (0.1, 0.01), (0.2, None))
    ]
    told = summarise(rows)["stiffness_bias"]["expected"]
    # half of what is normal lies within 0.674 deviations
    assert told == {"recordings": 3, "ratio": pytest.approx(0.0674, rel=0.01)}
    older = [{key: value for key, value in row.items() if key != "stiffness_deviation"} for row in rows]
    assert summarise(older)["stiffness_bias"]["expected"] is None


def test_what_stays_unexplained_is_not_told_as_named() -> None:
    (row,) = summarise([score(verdict("unexplained", SPOT), answer(LUMP))])["confusion"]
    assert row == {"true": LUMP, "said": f"unexplained, and {SPOT}", "count": 1}


def test_wilsons_interval() -> None:
    half = share(5, 10)
    assert (half["low"], half["high"]) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert share(0, 0)["share"] is None


def test_without_its_effect_a_diagnosis_owns_up_or_names_the_twin() -> None:
    assert owns_up(verdict("unexplained"), LUMP)
    assert owns_up(verdict("explained", "internal_friction"), "plastic_bending")
    assert not owns_up(verdict("explained", SPOT), LUMP)
    assert not owns_up(verdict("no_mismatch"), LUMP)
    assert not owns_up(None, LUMP)


@pytest.mark.parametrize(
    ("rolled", "said", "beside", "covered"),
    [
        ("end", ("end", 0.3), (), {"end_twist.end": True}),
        ("end", ("start", -0.3), (), {"end_twist.end": True}),
        ("start", ("end", -0.3), (), {"end_twist.start": True}),
        ("end", ("start", 0.3), (), {"end_twist.end": False}),
        ("end", ("start", -0.3), ("anisotropic_bending",), {}),
    ],
)
def test_a_round_rope_may_be_rolled_at_either_end(
    rolled: str, said: tuple[str, float], beside: tuple[str, ...], covered: dict[str, bool]
) -> None:
    end, value = said
    names = ("end_twist", *beside)
    true = answer(*names) | {"parameters": {"end_twist": {rolled: 0.3}}}
    told = verdict("explained", *names)
    about = {"value": value, "low": value - 0.05, "high": value + 0.05, "unit": "rad"}
    told["effects"][0]["parameters"] = {end: about}
    row = score(told, true)["covered"]
    assert {name: inside for name, inside in row.items() if name != "bending_stiffness"} == covered
