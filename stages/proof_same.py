"""Is this version of what diagnoses another one? `make proof-same SHARD=shard_...`

Changes of what is refused, or of what is said beside the verdict, make a new version of files and leave what
is judged as it was. A scored shard is diagnosed once more: where all is judged the same, the two versions are
one and their shards count together; where it is but for intervals, they count together but for these; else
they are two. All of it stays in the book.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from dlolib.errors import ParameterError
from dlolib.files import write_json
from dlolib.proof import book
from dlolib.proof.score import INTERVALS, score
from stages import run
from stages.proof import (
    BOOK,
    COMMAND,
    RECORDINGS,
    WORKERS,
    answer_in,
    diagnose,
    last_shards,
    made_by,
    own_folder,
    together,
    totals,
    verdict_in,
    verdict_sha256,
)

# An error of EI, a share, or of a place [m], is the same if it changes by no more than this, a ten-thousandth
# of EI or a tenth of a millimetre of rope: no figure of the proof is told so finely.
ROUNDING = 1e-4


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_same", description=__doc__)
    options.add_argument("shard", help="a scored one of the version that counts, with its verdicts' hashes")
    options.add_argument("--command", default=COMMAND, help="what diagnoses, as in stages.proof")
    asked = options.parse_args(arguments)
    book.committed()
    made = made_by(f"make proof-same SHARD={asked.shard}")
    ((_, scored),) = last_shards([asked.shard]).values()
    known = {name: row.get("verdict_sha256", "") for name, row in scored.items()}
    if "" in known.values():
        raise ParameterError(f"{asked.shard} has no hashes of its verdicts", mend="take a later shard")
    apart = own_folder("same") / asked.shard
    tasks = [((RECORDINGS / asked.shard / name,), apart / name, asked.command) for name in known]
    together(ThreadPoolExecutor(WORKERS), diagnose, tasks, f"diagnosing {asked.shard} once more")
    differ = [name for name, sha256 in known.items() if verdict_sha256(apart / name) != sha256]
    judged = {name: _judged(asked.shard, name, apart) for name in differ}
    whole = [name for name, row in judged.items() if not _alike(row, _but(scored[name]))]
    otherwise = [
        name for name in whole if not _alike(_but(judged[name], *INTERVALS), _but(scored[name], *INTERVALS))
    ]
    before = next(row["version"] for row in book.runs(BOOK) if row["shard"] == asked.shard)
    found = made | {"as": before, "shard": asked.shard, "recordings": len(known)}
    found |= {"differ": differ, "otherwise": whole, "judged_otherwise": otherwise}
    write_json(BOOK / book.SAME, {"compared": [*book.compared(BOOK), found]})
    write_json(BOOK / "summary.json", totals())
    judged_so = f"{len(whole)} are judged otherwise, {len(otherwise)} but for their intervals"
    print(f"{asked.shard}: {len(differ)} of {len(known)} verdicts differ, {judged_so}")


def _judged(shard: str, name: str, verdicts: Path) -> dict[str, Any]:
    """What a verdict is worth, as a shard's row says it."""
    row = score(verdict_in(verdicts / name), answer_in(shard, name))
    return _but(json.loads(json.dumps(row)))


def _alike(one: Any, other: Any) -> bool:
    """Whether two rows say the same; what no figure tells of an error does not count."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_alike(value, other[key]) for key, value in one.items())
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=0.0, abs_tol=ROUNDING)
    return bool(one == other)


def _but(row: dict[str, Any], *more: str) -> dict[str, Any]:
    """A row without its verdict's hash, EI's deviation, which older rows lack, and some more of it."""
    left_out = {*more, "verdict_sha256", "stiffness_deviation"}
    return {key: value for key, value in row.items() if key not in left_out}


if __name__ == "__main__":
    run(main, *sys.argv[1:])
