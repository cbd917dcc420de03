"""The five headline figures, each with the command that gives it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dlolib.report.headline import STIFFNESS, clear, headline, stiffness
from dlolib.report.model import Block, Card, Cards, Missing, Paragraph, Section
from dlolib.report.results import CAPTURED, Results
from dlolib.report.text import ABSENT, MINUS, fixed, listed, millimetres, nice_unit, scientific, span, title


def section(results: Results, figures: Path) -> Section:
    """Five cards, and in words what the run did."""
    numbers = headline(results)
    cards = (
        _stiffness_card(results),
        _residual_card(results, numbers["residual_m"]),
        _chain_card(results, numbers["chain_rms_m"]),
        _goal_card(results, numbers["worst_goal_error_m"]),
        _clearance_card(results, numbers["smallest_clearance_m"]),
    )
    blocks: list[Block] = [Paragraph(_summary(results)), Cards(cards)]
    absent = [card.label for card in cards if card.value == ABSENT]
    if absent:
        blocks.append(Missing(f"Not there yet: {listed(absent)}. `make repro` runs every stage."))
    return Section("headline", "In five figures", tuple(blocks))


def _summary(results: Results) -> str:
    source = "the virtual laboratory" if results.truth else "the camera"
    texts = []
    if results.captured is not None:
        frames = len(set(results.captured.points.frame.tolist()))
        texts.append(
            f"A rope was recorded by {source} while a gripper moved its end; {frames} frames were used."
        )
    ei = stiffness(results)
    if ei is not None:
        of = "Its" if texts else "The rope's"
        out = f"{of} bending stiffness comes out at {scientific(ei.value)} {nice_unit(ei.unit)}"
        texts.append(f"{out}{_diagnosed(results)}.")
    learned = [name for name in results.layouts if results.learned(name)]
    if learned:
        results_of = [results.learned(name) or {} for name in learned]
        free = sum(clear(result) for result in results_of)
        texts.append(
            f"Layouts for which a motion was learned: {len(learned)}; motions that keep clear of every "
            f"obstacle in the rod's simulation: {free}."
        )
    if not texts and (others := sorted({*results.recordings, *results.diagnosed})):
        texts.append(f"Nothing was captured here; what follows is of {listed(others)}.")
    return " ".join(texts) or "No stage has left results yet."


def _stiffness_card(results: Results) -> Card:
    ei = stiffness(results)
    command = f"dvc repro identify@{CAPTURED}"
    if ei is None:
        return Card("Bending stiffness EI", ABSENT, "", "", command)
    detail = f"95 % interval {span(ei.low, ei.high)}." if ei.low is not None or ei.high is not None else ""
    if results.truth is not None:
        true = results.truth.bending_stiffness_n_m2
        apart = fixed(100 * (ei.value / true - 1))
        detail += f" The laboratory's rope: {scientific(true)} ({'' if apart[0] == MINUS else '+'}{apart} %)"
        plastic = results.truth.laws["law"] == "plastic"
        detail += ", but it also yields plastically." if plastic else "."
    return Card("Bending stiffness EI", scientific(ei.value), nice_unit(ei.unit), detail, command)


def _diagnosed(results: Results) -> str:
    """The stiffness once what an elastic rod leaves out is in the model, where something is."""
    verdict = results.verdict(CAPTURED) if CAPTURED in results.diagnosed else None
    if verdict is None or not verdict.effects or verdict.status == "unexplained":
        return ""
    best = verdict.augmented.parameters
    ei = next((best[key] for key in STIFFNESS if key in best), None)
    if ei is None:
        return ""
    between = f" ({span(ei.low, ei.high)})" if ei.low is not None or ei.high is not None else ""
    return f", and at {scientific(ei.value)}{between} with what the diagnosis names in the model"


def _residual_card(results: Results, value: float | None) -> Card:
    summary = results.json("identify", CAPTURED, "summary.json")
    held = summary["heldout_rmse_m"] if summary else None
    detail = "Root mean square over all observed points."
    if held is not None:
        detail += f" On frames left out: {millimetres(held, 2)} mm."
    return Card(
        "Residual a point, rod to recording",
        millimetres(value, 2),
        "mm",
        detail,
        f"dvc repro identify@{CAPTURED}",
    )


def _chain_card(results: Results, value: float | None) -> Card:
    detail = "Root mean square distance of the chain's points to the rope's true axis."
    if results.truth is None and results.captured is not None:
        detail = "No true axis to compare with: the capture is not from the laboratory."
    return Card("Chain to true axis", millimetres(value, 2), "mm", detail, "dvc repro chain report")


def _goal_card(results: Results, value: float | None) -> Card:
    found = {
        name: result["goal_error_m"]["mean"] for name in results.layouts if (result := results.learned(name))
    }
    worst = max(found, key=lambda name: found[name]) if found else None
    detail = f"Mean distance to the goal shape, {title(worst)}, in the rod." if worst else ""
    reached = _laboratory(results, lambda law: float(law["goal_error_m"]["mean"]), max)
    if reached:
        detail += f" {_where(results)}: {reached}."
    return Card(
        "Worst goal error",
        millimetres(value),
        "mm",
        detail,
        f"dvc repro learn@{worst}" if worst else "dvc repro",
    )


def _clearance_card(results: Results, value: float | None) -> Card:
    found = {
        name: result["min_clearance_m"]
        for name in results.layouts
        if (result := results.learned(name)) and result["min_clearance_m"] is not None
    }
    learned = [name for name in results.layouts if results.learned(name)]
    if learned and value is None:
        return Card("Smallest clearance", "none", "", "No layout has an obstacle.", "dvc repro learn")
    least = min(found, key=lambda name: found[name]) if found else None
    detail = f"Rope's surface to the nearest obstacle, {title(least)}, in the rod." if least else ""
    reached = _laboratory(results, lambda law: law["min_clearance_m"], min)
    if reached:
        detail += f" {_where(results)}: {reached}."
    return Card(
        "Smallest clearance",
        millimetres(value),
        "mm",
        detail,
        f"dvc repro learn@{least}" if least else "dvc repro",
    )


def _where(results: Results) -> str:
    """Whose rope the laboratory's is."""
    return (
        "In the laboratory" if results.truth is not None else "In the laboratory, whose rope is another one"
    )


def _laboratory(
    results: Results,
    choice: Callable[[Mapping[str, Any]], float | None],
    worst: Callable[[list[float]], float],
) -> str:
    """The worst of all layouts in the laboratory, by law: "elastic 6.1 mm, plastic 19.0 mm"."""
    texts = []
    for law in ("elastic", "plastic"):
        values = []
        for name in results.layouts:
            # a layout without obstacles has no clearance
            found = results.played(name)
            if law in found and (value := choice(found[law])) is not None:
                values.append(value)
        if values:
            texts.append(f"{law} {millimetres(worst(values))} mm")
    return ", ".join(texts)
