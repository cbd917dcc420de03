"""Damaged recordings by the hundred: `make damaged COUNT=500`. The figures go to reports/damaged.json.

The damages are those of the tests (`tests/captures/harm.py`), which draw sixty; no line of any stage is here.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from dlolib.files import write_json
from dlolib.progress import track
from stages import REPORTS, number, run

SEED = 5


def main(count: str, seed: str = str(SEED)) -> None:
    sys.path.insert(0, "tests")
    from captures.harmed import draw  # type: ignore[import-not-found]
    from captures.judge import Bench  # type: ignore[import-not-found]

    many, drawn = number(count, "COUNT", 1), number(seed, "SEED")
    tally: dict[str, Counter[str]] = {}
    faults = []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        for case in track(draw(many, drawn), "damaged recordings", many):
            one = bench.outcome(*case)
            ended = "refused" if one.status == 2 else "as without the damage" if not one.said else "warned"
            tally.setdefault(one.kind, Counter())["fault" if one.fault else ended] += 1
            if one.fault:
                faults.append(f"{one.kind}: {one.damage}: {one.fault}".replace(folder, "..."))
    every = sum(tally.values(), Counter())
    result: dict[str, Any] = {"count": many, "seed": drawn, **dict(sorted(every.items()))}
    result |= {
        "by_source": {kind: dict(sorted(tally[kind].items())) for kind in sorted(tally)},
        "faults": faults,
    }
    write_json(REPORTS / "damaged.json", result)
    for name, times in sorted(every.items()):
        print(f"{times:6d} {name}")
    if faults:
        print("\n".join(faults), file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
