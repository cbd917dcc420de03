"""Sixty recordings damaged at random; `make damaged` tries as many as you like."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from captures.harmed import KINDS, draw
from captures.judge import Bench

COUNT, SEED = 60, 20


def test_damage_is_refused_in_one_line_or_does_no_harm(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    outcomes = [bench.outcome(*case) for case in draw(COUNT, SEED)]
    assert not [outcome for outcome in outcomes if outcome.fault]
    assert Counter(outcome.status for outcome in outcomes)[2] > COUNT / 2


def test_every_damage_of_every_kind_has_its_turn() -> None:
    every = sum(len(kind.damages) * len(kind.commands) for kind in KINDS.values())
    drawn = list(draw(every, SEED))
    assert len({(kind, id(damage), command) for kind, damage, command, _ in drawn}) > every - len(KINDS)
    assert [case[0] for case in draw(every, SEED)] == [case[0] for case in drawn]
