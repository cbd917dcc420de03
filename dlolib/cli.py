"""The console script `dlo`: one command a stage, over the same functions as stages/.

Subpackages are imported inside the commands, so that `dlo --help` does not wait for Taichi or Open3D.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer.exceptions import TyperException

from dlolib.cli_values import RopeValues, check_places, parse_effects, parse_topics, parse_values, rope_values
from dlolib.errors import DloError, ParameterError
from dlolib.outputs import check_out

if TYPE_CHECKING:
    from dlolib.diagnose import DiagnoseSettings
    from dlolib.identify import IdentifySettings
    from dlolib.learn import LearnSettings
    from dlolib.params import Params
    from dlolib.sim.mesh import Mesh
    from dlolib.sim.rod import Rod
    from dlolib.types import Fit, Recording

UNUSABLE, INTERRUPTED = 2, 130
HELP = """A rope's stiffness from depth images, and motions that shape it without contact.

A params.yaml in the working directory, all blocks of it, sets what they name; without one the defaults hold.
"""
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, help=HELP)

Out = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder to write; an earlier result is replaced whole.")
]
Values = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A value of the rope, such as bending_stiffness=3e-4."),
]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME:PARAM=VALUE,...",
        help="Further physics, such as plastic_bending:yield_curvature=8.",
    ),
]
QuasiStatic = Annotated[
    Literal["true", "false"] | None,
    typer.Option("--quasi-static", metavar="BOOL", help="In the place of what the recording says."),
]
VerdictFile = Annotated[
    Path | None, typer.Option("--verdict", metavar="FILE", help="verdict.json of `dlo diagnose`.")
]
FitFile = Annotated[Path | None, typer.Option("--fit", metavar="FILE", help="fit.json of `dlo identify`.")]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `dlo` and exit: 0 on success, 1 for a stopped motion, 2 with one line for unusable input."""
    sys.exit(run(arguments))


def run(arguments: Sequence[str] | None = None) -> int:
    """Run `dlo` on the given arguments (those of the process by default) and return its exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        status = app(given or ["--help"], prog_name="dlo", standalone_mode=False)
    except DloError as error:
        return _refuse(str(error))
    except TyperException as error:
        return _refuse(f"{error.format_message().rstrip('.')}; see dlo --help")
    except OSError as error:
        return _refuse(f"{error.filename or '--out'}: {error.strerror}; correct the path or its permissions")
    except KeyboardInterrupt:
        return INTERRUPTED
    return status if isinstance(status, int) else 0


@app.command()
def ingest(
    source: Annotated[
        Path, typer.Argument(help="A capture folder; a bag, .mcap, .mkv; a folder of images or clouds.")
    ],
    out: Out,
    motion: Annotated[
        Path | None, typer.Option("--motion", metavar="CSV", help="motion.csv, where it lies elsewhere.")
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="ROLE=NAME",
            help="Of a bag: which topic is color, depth, camera_info, camera_pose, motion.",
        ),
    ] = None,
    about: Annotated[
        Path | None,
        typer.Option("--object", metavar="FILE", help="What no camera knows, as in capture.json."),
    ] = None,
) -> None:
    """Check every frame of a recording and write it as a capture: dlo-capture/1."""
    from dlolib.captures import ingest as ingest_capture

    check_out(out, "capture.json", source, motion, about)
    index = ingest_capture(source, out, motion, parse_topics(topic or []), about)
    _say(f"{out}: {len(index.frame)} frames of {index.rope.name}, {index.t_s[-1] - index.t_s[0]:.3g} s")


@app.command()
def chain(
    capture: Annotated[Path, typer.Argument(help="A capture folder.")],
    out: Out,
) -> None:
    """Find the rope in every frame of a capture as a chain of points: dlo-recording/1, and a sheet."""
    from dlolib.calibrate import clock_offset
    from dlolib.captures import open_capture
    from dlolib.chain import ChainSettings, extract_chain, write_sheet
    from dlolib.files import whole_folder
    from dlolib.formats import write_recording

    check_out(out, "sheet.png", capture)
    params = _params()
    settings = ChainSettings() if params is None else ChainSettings(**params.chain.model_dump())
    source = open_capture(capture)
    result = extract_chain(source, settings)
    with whole_folder(out) as folder:
        write_recording(result.recording, folder)
        write_sheet(result, source, folder / "sheet.png")
    points = result.recording.points
    frames = len(set(points.frame.tolist()))
    _say(f"{out}: {len(points.s_m)} points in {frames} frames of {result.recording.name}; look at sheet.png")
    _say(clock_offset(result.recording).says)


@app.command()
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
    read = _recording(recording, quasi_static)
    known = rope_values(read.rope, read.name, _known(fit, verdict), parse_values(values or []))
    if verdict is not None and read.name not in _diagnosed(verdict):
        known = _of_the_rope(known)
    given = replace(read, rope=known.rope)
    known = replace(known, parameters={**known.parameters, **parse_effects(effects or [])})
    check_places(known.rope, known.parameters)
    mesh, sweeps = _mesh()
    rod = _rod(known, mesh.particles_for(known.rope.length_m))
    # corrected as identification corrects, so that a fit is played back as it was made
    write_recording(simulated(given, rod, mesh.time_step_s, sweeps, FINER), out)
    _say(f"{out}: {len(given.points.s_m)} simulated points of {read.name}")


@app.command()
def identify(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders, all of one object.")],
    out: Out,
    verdict: VerdictFile = None,
) -> None:
    """Identify a rope's stiffness from its recordings: fit.json, the loss curve, the shapes."""
    from dlolib.identify import DescentSettings, descend, write_identified
    from dlolib.identify import identify as fit_recordings

    check_out(out, "fit.json", *recordings, verdict)
    settings, params = _identify_settings(), _params()
    given = [_recording(folder) for folder in recordings]
    known = _known(None, verdict)
    rods = None
    if known is not None and verdict is not None:
        values = [rope_values(one.rope, one.name, known, {}) for one in given]
        there = _diagnosed(verdict)
        pairs = zip(given, values, strict=True)
        rods = [_rod(mine if one.name in there else _of_the_rope(mine)) for one, mine in pairs]
    found = fit_recordings(given, settings, rods)
    descended = None
    if params is not None and params.identify.method == "gradient_descent":
        descended = descend(given[0], DescentSettings(**params.identify.paper.model_dump()), settings)
    write_identified(found, given, out, descended)
    _say_fit(found.fit)


@app.command()
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
    given = [_recording(folder, quasi_static) for folder in recordings]
    settings = _diagnose_settings(tuple(without or ()))
    settings = replace(settings, full=full or settings.full, workers=workers or settings.workers)
    diagnosis = diagnose_recordings(given, settings)
    with whole_folder(out) as folder:
        write_diagnosis(diagnosis, folder)
        draw_diagnosis(folder)
    _say(diagnosis.verdict.summary)


@app.command()
def learn(
    layout: Annotated[Path, typer.Argument(help="A layout folder: the goal shape and the obstacles.")],
    out: Out,
    fit: FitFile = None,
    verdict: VerdictFile = None,
    values: Values = None,
) -> None:
    """Learn how to move the held end so that the rope reaches the goal shape without contact."""
    from dlolib.formats import read_layout
    from dlolib.learn import learn as learn_layout
    from dlolib.learn import write_learned

    check_out(out, "policy.npz", layout, fit, verdict)
    goal = read_layout(layout)
    settings = replace(_learn_settings(), particles=_mesh()[0].particles_for(goal.rope.length_m))
    known = rope_values(goal.rope, goal.name, _known(fit, verdict), parse_values(values or []))
    rod = _rod(_of_the_rope(known), settings.particles)
    learned = learn_layout(replace(goal, rope=known.rope), rod, settings)
    write_learned(learned, out)
    kept = learned.kept
    clear = "" if learned.free else "; no path with the clearance asked for was found"
    least = f"smallest clearance {1e3 * kept.min_clearance_m:.1f} mm" if goal.obstacles else "no obstacle"
    _say(f"{out}: mean goal error {1e3 * kept.goal.mean_m:.1f} mm, {least}{clear}")


@app.command()
def execute(
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY.csv", help="As `dlo learn` writes it.")],
    out: Out,
    host: Annotated[str | None, typer.Option("--host", help="The robot's address.")] = None,
    layout: Annotated[
        Path | None, typer.Option("--layout", metavar="LAYOUT", help="Run it in the virtual laboratory.")
    ] = None,
    robot: Annotated[
        Path | None, typer.Option("--robot", metavar="robot.json", help="Where the robot stands; its limits.")
    ] = None,
) -> None:
    """Run a trajectory on a robot (--host) or in the laboratory (--layout): log and result."""
    if (host is None) == (layout is None):
        raise ParameterError("a run needs one place", place="execute", mend="give --host or --layout")
    if layout is not None and robot is not None:
        raise ParameterError(
            "the laboratory has no robot", place="--robot", mend="leave it out, or give --host"
        )
    # a robot's log is no result of the laboratory, nor the reverse
    if layout is None:
        check_out(out, "log.csv", trajectory, robot, never="shapes.csv")
    else:
        check_out(out, ("log.csv", "shapes.csv"), trajectory, layout, never="robot.json")
    if host is not None:
        from dlolib.execute import execute_on_robot, read_robot

        result = execute_on_robot(trajectory, host, read_robot(robot), out)
        _say(f"{out / 'log.csv'}: {result.reason}")
        raise typer.Exit(result.exit_status)
    assert layout is not None
    _execute_in_lab(trajectory, layout, out)


def _execute_in_lab(trajectory: Path, layout: Path, out: Path) -> None:
    """The laboratory alone needs MuJoCo: the other commands never import it."""
    from dlolib.execute.laboratory import execute_in_lab
    from dlolib.files import whole_folder
    from dlolib.formats import read_layout, read_motion
    from dlolib.lab.rope import LabRope

    params = _params()
    goal, motion = read_layout(layout), read_motion(trajectory)
    if params is None:
        execution = execute_in_lab(motion, goal, LabRope())
    else:
        rope = LabRope(**params.lab.rope.model_dump())
        execution = execute_in_lab(motion, goal, rope, params.execute.laws)
    with whole_folder(out) as folder:
        execution.write(folder)
    for law, outcome in execution.laws.items():
        clear = (
            "" if outcome.min_clearance_m is None else f", clearance {1e3 * outcome.min_clearance_m:.1f} mm"
        )
        _say(f"{out}: {law} rope, mean goal error {1e3 * outcome.goal_error_m['mean']:.1f} mm{clear}")


@app.command()
def report(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the report and its figures.")],
    results: Annotated[Path, typer.Argument(help="What the stages left behind.")] = Path("reports"),
) -> None:
    """Write report.html and report.pdf, with their numbers in report.json."""
    from dlolib.report import build_report

    # what this folder's params.yaml says is of what lies here, and of no other results
    params = _params() if results.resolve() == Path("reports").resolve() else None
    page = build_report(
        results,
        out,
        has_truth=params is None or params.ingest.source == "lab",
        parameters=None if params is None else params.model_dump(mode="json"),
    )
    _say(str(page))


def _params() -> Params | None:
    """params.yaml of the working directory, whole and checked; None where there is none, or another
    project's."""
    from dlolib.params import PARAMS, load, ours

    return load() if PARAMS.is_file() and ours() else None


def _known(fit: Path | None, verdict: Path | None) -> Fit | None:
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


def _diagnosed(verdict: Path) -> tuple[str, ...]:
    """The recordings that a verdict is about."""
    from dlolib.formats import read_verdict

    return read_verdict(verdict).recordings


def _of_the_rope(known: RopeValues) -> RopeValues:
    """What goes along to another place: how one recording was held and seen is left out, and that is said."""
    from dlolib.formats import say
    from dlolib.sim.effects import of_the_rope

    parameters, stay = of_the_rope(known.parameters)
    if stay:
        say([f"{', '.join(stay)}: of the recording and not of the rope, left out"])
    return replace(known, parameters=parameters)


def _recording(folder: Path, quasi_static: str | None = None) -> Recording:
    """The recording, quasi-static or not as said; what is odd about its motion is said, too."""
    from dlolib.formats import motion_doubts, read_recording, say

    recording = read_recording(folder)
    say(motion_doubts(recording.motion, recording.points.t_s, folder / "motion.csv"))
    return recording if quasi_static is None else replace(recording, quasi_static=quasi_static == "true")


def _rod(known: RopeValues, particles: int = 30) -> Rod:
    from dlolib.sim.rod import Rod

    return Rod.of(known.rope, known.parameters, particles)


def _mesh() -> tuple[Mesh, int | None]:
    """The mesh of every simulation, and the iterative solver's sweeps; None for the direct one."""
    from dlolib.sim.mesh import Mesh

    params = _params()
    if params is None:
        return Mesh(), None
    rod = params.rod
    mesh = Mesh(rod.particles, rod.longest_segment_m, rod.time_step_s)
    return mesh, rod.sweeps if rod.solver == "iterative" else None


def _identify_settings() -> IdentifySettings:
    """Settings of identification and of the rod that it shares with simulation."""
    from dlolib.identify import IdentifySettings

    params = _params()
    if params is None:
        return IdentifySettings()
    (mesh, sweeps), block = _mesh(), params.identify
    return IdentifySettings(
        **asdict(mesh),
        sweeps=sweeps,
        parameters=None if block.parameters is None else tuple(block.parameters),
        iterations=block.iterations,
        heldout_share=block.heldout_share,
    )


def _diagnose_settings(without: tuple[str, ...]) -> DiagnoseSettings:
    """Settings of the diagnosis and of the rod that it fits."""
    from dlolib.diagnose import DiagnoseSettings

    params = _params()
    if params is None:
        return DiagnoseSettings(without=without)
    given = params.diagnose.model_dump()
    return DiagnoseSettings(**asdict(_mesh()[0]), **{**given, "without": (*given["without"], *without)})


def _learn_settings() -> LearnSettings:
    """Settings of learning and of the rod that it drives."""
    from dlolib.learn import LearnSettings

    params = _params()
    if params is None:
        return LearnSettings()
    block = params.learn
    return LearnSettings(
        **block.model_dump(exclude={"verdict_of", "ablation", "bounds", "hidden"}),
        hidden=(block.hidden[0], block.hidden[1]),
        bounds=(
            block.bounds.phi_rad,
            block.bounds.s,
            block.bounds.theta_rad,
            block.bounds.dx_m,
            block.bounds.dz_m,
        ),
    )


def _say_fit(fit: Fit) -> None:
    for name, value in fit.parameters.items():
        low, high = ("?" if end is None else f"{end:.4g}" for end in (value.low, value.high))
        _say(f"{name}: {value.value:.4g} {value.unit} (95 %: {low} to {high})")
    _say(f"residual: {1e3 * fit.rmse_m:.2f} mm RMS a point")


def _say(line: str) -> None:
    if isinstance(sys.stdout, TextIOWrapper):
        # a terminal that has no such letter is no reason to fail after the work is done
        sys.stdout.reconfigure(errors="replace")
    print(line)


def _refuse(line: str) -> int:
    print(f"dlo: {' '.join(line.split())}", file=sys.stderr)
    return UNUSABLE


if __name__ == "__main__":
    main()
