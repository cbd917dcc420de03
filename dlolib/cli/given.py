"""What the commands are given: recordings, stored parameters, and params.yaml of the working directory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dlolib.errors import ParameterError
from dlolib.rope_values import RopeValues

if TYPE_CHECKING:
    from dlolib.diagnose import DiagnoseSettings
    from dlolib.identify import IdentifySettings
    from dlolib.learn import LearnSettings
    from dlolib.params import Params
    from dlolib.sim.mesh import Mesh
    from dlolib.sim.rod import Rod
    from dlolib.types import Fit, Recording


def params() -> Params | None:
    """params.yaml of the working directory, whole and checked; None where there is none, or another
    project's."""
    from dlolib.params import PARAMS, load, ours

    return load() if PARAMS.is_file() and ours() else None


def stored(fit: Path | None, verdict: Path | None) -> Fit | None:
    """Stored parameters: of a fit or of a verdict's winning model."""
    from dlolib.formats import read_fit, read_verdict, say

    if fit is not None and verdict is not None:
        raise ParameterError("two sets of parameters", place="--fit and --verdict", mend="give one of them")
    if verdict is not None:
        told = read_verdict(verdict)
        if told.status == "unexplained":
            say([f"{verdict}: no model of the library explains its recordings; take what it names with care"])
        return told.fit
    return None if fit is None else read_fit(fit)


def diagnosed(verdict: Path) -> tuple[str, ...]:
    """The recordings that a verdict is about."""
    from dlolib.formats import read_verdict

    return read_verdict(verdict).recordings


def recording(folder: Path, quasi_static: str | None = None) -> Recording:
    """The recording, quasi-static or not as said; what is odd about its motion is said, too."""
    from dlolib.formats import motion_doubts, read_recording, say

    read = read_recording(folder)
    say(motion_doubts(read.motion, read.points.t_s, folder / "motion.csv"))
    if read.obstacles and read.rope.diameter_m is None:
        file = folder / "recording.json"
        say([f"{file}: object.diameter_m is not given: its axis may touch obstacles; measure it"])
    return read if quasi_static is None else replace(read, quasi_static=quasi_static == "true")


def rod(known: RopeValues, particles: int = 30) -> Rod:
    from dlolib.sim.rod import Rod

    return Rod.of(known.rope, known.parameters, particles)


def mesh() -> Mesh:
    """The mesh of every simulation."""
    from dlolib.sim.mesh import Mesh

    blocks = params()
    return Mesh() if blocks is None else Mesh(**blocks.rod.mesh())


def identify_settings() -> IdentifySettings:
    """Of identification, and of the rod that it shares with simulation."""
    from dlolib.identify import IdentifySettings

    blocks = params()
    return IdentifySettings() if blocks is None else IdentifySettings(**blocks.identify.settings(blocks.rod))


def diagnose_settings() -> DiagnoseSettings:
    """Of the diagnosis, and of the rod that it fits."""
    from dlolib.diagnose import DiagnoseSettings

    blocks = params()
    return DiagnoseSettings() if blocks is None else DiagnoseSettings(**blocks.diagnose.settings(blocks.rod))


def learn_settings(length_m: float) -> LearnSettings:
    """Of learning with a rope of this length, and of the rod that it drives."""
    from dlolib.learn import LearnSettings

    blocks = params()
    own = {} if blocks is None else blocks.learn.settings()
    return LearnSettings(**own, particles=mesh().particles_for(length_m))
