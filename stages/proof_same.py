"""Is this version of what diagnoses another one? `make proof-same SHARD=shard_...`

Changes of what is refused, or of what is said on the way, make a new version of files and leave every verdict
as it was. A scored shard is diagnosed once more: where all its verdicts are the same byte for byte, the two
versions are one and their shards count together; where any differs they are two. Both stays in the book.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor

from dlolib.errors import ParameterError
from dlolib.files import write_json
from dlolib.proof import book
from stages import run
from stages.proof import (
    BOOK,
    COMMAND,
    RECORDINGS,
    WORKERS,
    diagnose,
    last_shards,
    made_by,
    own_folder,
    together,
    totals,
    verdict_sha256,
)


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_same", description=__doc__)
    options.add_argument("shard", help="a scored one of the version that counts, with its verdicts' hashes")
    options.add_argument("--command", default=COMMAND, help="what diagnoses, as in stages.proof")
    asked = options.parse_args(arguments)
    made = made_by(f"make proof-same SHARD={asked.shard}")
    if made["version"].endswith("+changes"):
        raise ParameterError("what diagnoses has changes that are in no commit", mend="commit them first")
    ((_, scored),) = last_shards([asked.shard]).values()
    known = {name: row.get("verdict_sha256", "") for name, row in scored.items()}
    if "" in known.values():
        raise ParameterError(f"{asked.shard} has no hashes of its verdicts", mend="take a later shard")
    apart = own_folder("same") / asked.shard
    tasks = [((RECORDINGS / asked.shard / name,), apart / name, asked.command) for name in known]
    together(ThreadPoolExecutor(WORKERS), diagnose, tasks, f"diagnosing {asked.shard} once more")
    differ = [name for name, sha256 in known.items() if verdict_sha256(apart / name) != sha256]
    before = next(row["version"] for row in book.runs(BOOK) if row["shard"] == asked.shard)
    found = made | {"as": before, "shard": asked.shard, "recordings": len(known), "differ": differ}
    write_json(BOOK / book.SAME, {"compared": [*book.compared(BOOK), found]})
    write_json(BOOK / "summary.json", totals())
    print(f"{asked.shard}: {len(differ)} of {len(known)} verdicts differ")


if __name__ == "__main__":
    run(main, *sys.argv[1:])
