"""The table "the paper's figure, ours, the command"."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dlolib.report import paper
from dlolib.report.headline import clear, headline, stiffness
from dlolib.report.model import Column, Paragraph, Section, Table
from dlolib.report.results import CAPTURED, Results
from dlolib.report.sections.ablation import at_obstacle, last_of_runs, read_ablation
from dlolib.report.text import ABSENT, millimetres, nice_unit, scientific, span, title

Row = tuple[str, str, str, str]


def section(results: Results, figures: Path) -> Section:
    """One row for each figure that the paper states."""
    rows = (*_identification(results), *_learning(results), *_execution(results))
    columns = (
        Column("Figure", align="wide"),
        Column("The paper's", align="wide"),
        Column("Ours", align="wide"),
        Column("The command", align="left"),
    )
    words = (
        f"{paper.CITATION}: what it states in numbers or shows, beside what this run gives. The paper's "
        "rope was real; the commands tell what to run again for a figure of ours. With unit masses, the "
        f"paper's inverse stiffness α~b~ = {paper.FINAL_ALPHA_B} stands for EI = "
        f"{scientific(paper.stiffness_n_m2(paper.FINAL_ALPHA_B), 2)} N m² at "
        f"{1e3 * paper.LINEAR_DENSITY_KG_M:.0f} g/m."
    )
    return Section(
        "paper", "The paper's figures and ours", (Paragraph(words), Table("Figure by figure.", columns, rows))
    )


def _identification(results: Results) -> tuple[Row, ...]:
    command = f"`dvc repro identify@{CAPTURED}`"
    summary, ei, ours = results.json("identify", CAPTURED, "summary.json"), stiffness(results), ABSENT
    if summary is not None:
        loss, frames = summary["loss_paper_m"], summary["frames"]
        ours = f"{scientific(loss, 3)} m over {frames} frames, {millimetres(loss / frames, 2)} mm a point"
    value = f"{scientific(ei.value)} {nice_unit(ei.unit)} ({span(ei.low, ei.high)})" if ei else ABSENT
    return (
        ("Loss (12) at the end, Fig. 9", "about 0.2 m over 40 frames, 5 mm a point", ours, command),
        (
            "Stiffness identified",
            f"α~b~ = {paper.FINAL_ALPHA_B}, EI = "
            f"{scientific(paper.stiffness_n_m2(paper.FINAL_ALPHA_B), 2)} N m²",
            value,
            command,
        ),
        (
            "The paper's own method: gradient descent on α~b~ from 0.1",
            f"α~b~ = {paper.FINAL_ALPHA_B} after {paper.IDENTIFY_ITERATIONS} iterations",
            _published(summary["paper_method"] if summary else None),
            command,
        ),
        (
            "Iterations of identification",
            f"{paper.IDENTIFY_ITERATIONS} iterations",
            _iterations(results),
            command,
        ),
    )


def _published(published: Mapping[str, Any] | None) -> str:
    """None where the paper's method was not run on the recording."""
    if published is None:
        return ABSENT
    after = f"after {published['iterations']} iterations, loss {published['loss_m']:.3g} m"
    return f"α~b~ = {published['alpha_b']:.4g} {after}"


def _iterations(results: Results) -> str:
    loss = results.table("identify", CAPTURED, "loss.csv")
    if loss is None or loss.empty:
        return ABSENT
    last = loss.groupby("method", sort=False)["iteration"].max()
    return ", ".join(f"{str(method).replace('_', ' ')}: {count} iterations" for method, count in last.items())


def _learning(results: Results) -> tuple[Row, ...]:
    found = [result for name in results.layouts if (result := results.learned(name))]
    numbers = headline(results)
    free = sum(clear(result) for result in found)
    least_m = numbers["smallest_clearance_m"]
    least = "no obstacle" if least_m is None else f"smallest clearance {millimetres(least_m)} mm"
    reached = (
        f"{free} of {len(found)} layouts without contact; worst mean error "
        f"{millimetres(numbers['worst_goal_error_m'])} mm, {least}"
        if found
        else ABSENT
    )
    return (
        (
            "Goal reached without contact, Fig. 10",
            "4 of 4 layouts, shown in pictures",
            reached,
            "`dvc repro learn`",
        ),
        (
            "Iterations of learning, Table I",
            f"{paper.LEARN_ITERATIONS} iterations",
            "; ".join(_tried(result) for result in found) or ABSENT,
            "`dvc repro learn`",
        ),
        *_ablation(results),
    )


def _tried(result: Mapping[str, Any]) -> str:
    """Iterations of the initial weights that were kept, and of all that were tried."""
    kept, total, starts = (result[key] for key in ("iterations", "iterations_total", "starts"))
    others = f", {total} over the {starts} initial weights that were tried" if starts > 1 else ""
    return f"{title(result['layout'])}: {kept} iterations{others}"


def _ablation(results: Results) -> tuple[Row, ...]:
    for name in results.layouts:
        table = read_ablation(results, name)
        if table is None:
            continue
        command = f"`dvc repro learn@{name}`"
        rows: list[Row] = []
        for loss, head, theirs in (
            ("mse", f"Plain MSE on {title(name).lower()}, Fig. 11", "stuck at the cylinder"),
            (
                "contact",
                "With the contact term, Fig. 11",
                f"loss below {paper.FINAL_CONTACT_LOSS_M} m, goal reached",
            ),
        ):
            runs = last_of_runs(table, loss)
            ours = (
                f"{at_obstacle(table, loss)} of {len(runs)} runs end at an obstacle; median goal error "
                f"{millimetres(float(runs['goal_error_mean_m'].median()))} mm"
                if len(runs)
                else ABSENT
            )
            rows.append((head, theirs, ours, command))
        return tuple(rows)
    return ()


def _execution(results: Results) -> tuple[Row, ...]:
    texts = []
    for name in results.layouts:
        if laws := results.played(name):
            means = {law: found["goal_error_m"]["mean"] for law, found in laws.items()}
            told = ", ".join(f"{law} {millimetres(mean)} mm" for law, mean in means.items())
            texts.append(f"{title(name)}: {told}")
    theirs = "reproduces the plan; larger gap in layout 2, laid to plastic bending"
    return (("Execution against goal, Fig. 10", theirs, "; ".join(texts) or ABSENT, "`dvc repro execute`"),)
