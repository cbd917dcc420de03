"""Effects at the size that a diagnosis says it would have seen: planted in the same motion, and counted."""

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from dlolib.formats import read_recording
from dlolib.proof import play
from dlolib.proof.draw import draw_case
from dlolib.proof.sizes import NAMES
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import sizes
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


def test_an_effect_is_planted_at_the_named_size(tmp_path: Path) -> None:
    (tmp_path / "says.py").write_text(SAYS)
    command = shlex.join([sys.executable, str(tmp_path / "says.py"), "{recording}", "{out}"])
    row = proof_sizes.planted(tmp_path / "sizes", 3, 0, command)
    assert row["found"] and (row["name"], row["parameter"], row["value"]) == ("end_angle", "start_1", 0.02)
    answer = json.loads((tmp_path / "sizes/planted/answers/000.json").read_text())
    assert answer["effects"] == ["end_angle"]
    assert answer["parameters"]["end_angle"]["start_1"] == 0.02
    null, planted = (
        read_recording(tmp_path / "sizes" / kind / "recordings/000") for kind in ("nulls", "planted")
    )
    assert np.array_equal(null.motion.end_m, planted.motion.end_m)
    assert planted.rope == null.rope and planted.heldout_frames == null.heldout_frames


def test_every_size_of_the_library_can_be_planted(monkeypatch: pytest.MonkeyPatch) -> None:
    # any chain will do: it is asked for its shape alone
    monkeypatch.setattr(play, "CHAINS", (29, 58))
    monkeypatch.setattr(play, "LEFT", np.inf)
    case = draw_case(3, 0, ())
    rng = np.random.default_rng(0)
    for name in NAMES:
        for part in sizes(EFFECTS[name]):
            known = parameter(f"{name}.{part}")
            value = known.neutral + 1e-3 * known.scale if np.isfinite(known.neutral) else max(known.starts)
            planted = proof_sizes.with_effect(case, name, part, value, rng)
            assert planted.effects[name][part] == value and planted.points_m.shape == case.points_m.shape


def test_what_is_only_suspected_is_not_found() -> None:
    said = {"status": "unexplained", "effects": [{"name": "end_angle"}], "equivalent": []}
    assert not proof_sizes.found_in(said, "end_angle")["found"]
    assert proof_sizes.found_in({**said, "status": "explained"}, "end_angle")["found"]
    assert not proof_sizes.found_in(None, "end_angle")["found"]
