"""From a goal shape to a motion: `dlo learn`, `dlo execute`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from dlolib.cli import given
from dlolib.cli.options import FitFile, Out, Values, VerdictFile
from dlolib.cli.say import print_line
from dlolib.cli.values import parse_values
from dlolib.errors import ParameterError
from dlolib.outputs import check_out
from dlolib.rope_values import elsewhere, rope_values


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
    settings = given.learn_settings(goal.rope.length_m)
    known = rope_values(goal.rope, goal.name, given.stored(fit, verdict), parse_values(values or []))
    rod = given.rod(elsewhere(known), settings.particles)
    learned = learn_layout(replace(goal, rope=known.rope), rod, settings)
    write_learned(learned, out)
    kept = learned.kept
    clear = "" if learned.free else "; no path with the clearance asked for was found"
    least = f"smallest clearance {1e3 * kept.min_clearance_m:.1f} mm" if goal.obstacles else "no obstacle"
    print_line(f"{out}: mean goal error {1e3 * kept.goal.mean_m:.1f} mm, {least}{clear}")


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
        print_line(f"{out / 'log.csv'}: {result.reason}")
        raise typer.Exit(result.exit_status)
    assert layout is not None
    _execute_in_lab(trajectory, layout, out)


def _execute_in_lab(trajectory: Path, layout: Path, out: Path) -> None:
    """The laboratory alone needs MuJoCo: the other commands never import it."""
    from dlolib.execute.laboratory import execute_in_lab
    from dlolib.files import whole_folder
    from dlolib.formats import read_layout, read_motion
    from dlolib.lab.rope import LabRope

    params = given.params()
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
        print_line(f"{out}: {law} rope, mean goal error {1e3 * outcome.goal_error_m['mean']:.1f} mm{clear}")
