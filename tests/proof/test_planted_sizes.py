"""Effects at the size that a diagnosis says it would have seen: planted in the same motion, and counted."""

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from dlolib.formats import read_recording
from stages import proof_sizes

# Takes every rope for one that is held at another angle, and says how small an angle it would see.
SAYS = """
import json, sys
from pathlib import Path
out = Path(sys.argv[2])
out.mkdir()
size = {"name": "end_angle", "parameter": "start_1", "value": 0.02, "unit": "rad"}
unseen = {"name": "end_twist", "parameter": "start", "value": None, "unit": "rad"}
verdict = {"status": "explained", "effects": [{"name": "end_angle"}], "equivalent": []}
(out / "verdict.json").write_text(json.dumps({**verdict, "detectable": [unseen, size]}))
"""


def test_an_effect_is_planted_at_the_named_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "says.py").write_text(SAYS)
    monkeypatch.setattr(proof_sizes, "FOLDER", tmp_path / "sizes")
    command = shlex.join([sys.executable, str(tmp_path / "says.py"), "{recording}", "{out}"])
    row = proof_sizes.planted(3, 0, command)
    assert row["found"] and (row["name"], row["parameter"], row["value"]) == ("end_angle", "start_1", 0.02)
    answer = json.loads((tmp_path / "sizes/planted/answers/000.json").read_text())
    assert answer["effects"] == ["end_angle"]
    assert answer["parameters"]["end_angle"]["start_1"] == 0.02
    null, planted = (
        read_recording(tmp_path / "sizes" / kind / "recordings/000") for kind in ("nulls", "planted")
    )
    assert np.array_equal(null.motion.end_m, planted.motion.end_m)
    assert planted.rope == null.rope and planted.heldout_frames == null.heldout_frames
