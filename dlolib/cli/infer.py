"""From recordings to physics: `dlo simulate`, `dlo identify`, `dlo diagnose`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dlolib.cli import given
from dlolib.cli.options import Effects, FitFile, Out, QuasiStatic, Values, VerdictFile
from dlolib.cli.say import print_line
from dlolib.cli.values import parse_effects, parse_values
from dlolib.errors import ParameterError
from dlolib.outputs import check_out
from dlolib.rope_values import elsewhere, rope_values, with_effects

if TYPE_CHECKING:
    from dlolib.types import Fit


def simulate(
    recording: Annotated[Path, typer.Argument(help="A recording folder: its motion, times and arc lengths.")],
    out: Out,
    values: Values = None,
    effects: Effects = None,
    fit: FitFile = None,
    verdict: VerdictFile = None,
    quasi_static: QuasiStatic = None,
) -> None:
    """Simulate a recording's points with a rod under the recording's own motion: dlo-recording/1."""
    from dlolib.formats import write_recording
    from dlolib.sim.continuum import SIMULATED, simulated
    from dlolib.sim.mesh import FINER

    # any recording has that file
    check_out(out, "recording.json", recording, fit, verdict, said=f'"{SIMULATED}')
    read = given.recording(recording, quasi_static)
    known = rope_values(read.rope, read.name, given.stored(fit, verdict), parse_values(values or []))
    if verdict is not None and read.name not in given.diagnosed(verdict):
        known = elsewhere(known)
    known = with_effects(known, parse_effects(effects or []))
    params, mesh = given.params(), given.mesh()
    sweeps = None if params is None else params.rod.iterations
    rod = given.rod(known, mesh.particles_for(known.rope.length_m))
    read = replace(read, rope=known.rope)
    # corrected as identification corrects, so that a fit is played back as it was made
    write_recording(simulated(read, rod, mesh.time_step_s, sweeps, FINER), out)
    print_line(f"{out}: {len(read.points.s_m)} simulated points of {read.name}")


def identify(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders, all of one object.")],
    out: Out,
    verdict: VerdictFile = None,
) -> None:
    """Identify a rope's stiffness from its recordings: fit.json, the loss curve, the shapes."""
    from dlolib.identify import DescentSettings, descend, write_identified
    from dlolib.identify import identify as fit_recordings

    check_out(out, "fit.json", *recordings, verdict)
    settings, params = given.identify_settings(), given.params()
    seen = [given.recording(folder) for folder in recordings]
    known = given.stored(None, verdict)
    rods = None
    if known is not None and verdict is not None:
        values = [rope_values(one.rope, one.name, known, {}) for one in seen]
        there = given.diagnosed(verdict)
        pairs = zip(seen, values, strict=True)
        rods = [given.rod(mine if one.name in there else elsewhere(mine)) for one, mine in pairs]
    found = fit_recordings(seen, settings, rods)
    descended = None
    if params is not None and params.identify.method == "gradient_descent":
        descended = descend(seen[0], DescentSettings(**params.identify.paper.model_dump()), settings)
    write_identified(found, seen, out, descended)
    _say_fit(found.fit)


def diagnose(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders, all of one object.")],
    out: Out,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="EFFECT", help="Take an effect out of the library."),
    ] = None,
    full: Annotated[
        bool, typer.Option("--full", help="Fit all pairs of effects, not those alone that promise something.")
    ] = False,
    quasi_static: QuasiStatic = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; the verdict does not depend on them.")
    ] = None,
) -> None:
    """Say what physics an elastic rod leaves out of recordings: verdict.json, figures, the next motion."""
    from dlolib.diagnose import diagnose as diagnose_recordings
    from dlolib.diagnose import write_diagnosis
    from dlolib.files import whole_folder
    from dlolib.report import draw_diagnosis
    from dlolib.sim.effects import EFFECTS

    check_out(out, "verdict.json", *recordings)
    for name in without or []:
        if name not in EFFECTS:
            problem = f"unknown effect {name!r}"
            raise ParameterError(problem, place="--without", mend=f"choose from {', '.join(sorted(EFFECTS))}")
    seen = [given.recording(folder, quasi_static) for folder in recordings]
    set_there = given.diagnose_settings()
    settings = replace(
        set_there,
        without=(*set_there.without, *(without or ())),
        full=full or set_there.full,
        workers=workers or set_there.workers,
    )
    diagnosis = diagnose_recordings(seen, settings)
    with whole_folder(out) as folder:
        write_diagnosis(diagnosis, folder)
        draw_diagnosis(folder)
    print_line(diagnosis.verdict.summary)


def _say_fit(fit: Fit) -> None:
    for name, value in fit.parameters.items():
        low, high = ("?" if end is None else f"{end:.4g}" for end in (value.low, value.high))
        print_line(f"{name}: {value.value:.4g} {value.unit} (95 %: {low} to {high})")
    print_line(f"residual: {1e3 * fit.rmse_m:.2f} mm RMS a point")
