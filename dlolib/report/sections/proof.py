"""How often the diagnosis is right about what it cannot know: the blind proof and the practice recordings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.ticker import MaxNLocator

from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import FAINT, OBSERVED, PLASTIC, ROD, canvas, save
from dlolib.report.text import ABSENT, fixed, scientific

TITLE = "Is the diagnosis right?"
SHARES = {
    "right_or_tied": ("right, or among the best three of a tie", "≥ 95 %"),
    "tied": ("of these tied", "≤ 25 %"),
    "confidently_wrong": ("confidently wrong (missed ones among them)", "≤ 2 %"),
    "missed": ("of these missed: nothing was found", ABSENT),
    "wrong_of_too_small": ("something missing, too small to be detectable: named wrongly", ABSENT),
    "pairs_both_named": ("pairs: both named", "≥ 80 %"),
    "false_alarms": ("nothing missing, and yet an alarm", "≤ 1 %"),
    "place": ("named place within 15 mm", "≥ 90 %"),
    "heldout_better": ("held-out χ² better than the elastic rod's, where something is named", "≥ 95 %"),
    "heldout_better_than_black_box": ("and better than the black box's", "≥ 80 %"),
}
DETECTABLE = "of these where the laboratory says that something is detectable"
# Of every version.
VERSIONS = {
    "right_or_tied": "Right or tied",
    "tied": "Tied",
    "confidently_wrong": "Wrong",
    "wrong_of_too_small": "Small",
    "false_alarms": "Alarms",
    "pairs_both_named": "Pairs",
    "heldout_better": "Held out",
    "place": "Places",
}
# Counted beside it: the file, where the share lies in it, what it is, and its goal.
BESIDE = (
    ("without.json", ["owned_up"], "the true effect taken out of the library, and that noticed", "≥ 80 %"),
    ("next.json", ["asked"], "ties for which a motion is asked for and can be played", ABSENT),
    ("next.json", ["told_apart"], "of these end in the true set alone once it was", "≥ 80 %"),
    ("heldout.json", ["truth_better"], "held-out χ² of the true rope better than an elastic one's", ABSENT),
    (
        "heldout.json",
        ["named_better_where_truth_is"],
        "and of these, of what is named, better than the elastic rod's",
        ABSENT,
    ),
    ("sizes.json", ["found"], "planted at the size that `detectable` names, and found", "85 to 99 %"),
    ("screen.json", ["missed"], "every pair fitted: a better model than those screened", ABSENT),
    ("screen.json", ["otherwise"], "and another verdict for it", ABSENT),
    ("images.json", ["summary", "right_or_tied"], "from depth images: right or tied", "5 points less"),
    ("images.json", ["summary", "false_alarms"], "from depth images: nothing missing, and alarm", "≤ 2.5 %"),
)
OUTCOMES = {
    "right": ROD,
    "tied": "#9CC3DE",
    "undecided": FAINT,
    "missed": "#E5A95B",
    "wrong": PLASTIC,
    "failed": OBSERVED,
}


def section(results: Results, figures: Path) -> Section:
    """Shares with Wilson's intervals, outcomes by effect, every confusion; the practice recordings."""
    blocks: list[Block] = []
    proof, practice = results.json("proof", "summary.json"), results.json("practice.json")
    if not proof or not proof["recordings"]:
        blocks.append(Missing("The blind proof was not run: `make proof` runs a shard of it."))
    else:
        beside = [_beside(results, *one) for one in BESIDE]
        blocks += [_words(proof), _shares(proof, [row for row in beside if row])]
        if proof["by_effect"]:
            blocks.append(_outcomes(proof, figures))
        blocks.append(_confusion(proof))
        if len(proof["versions"]) > 1:
            blocks.append(_versions(proof))
        fine = results.json("proof", "refinement.json")
        if fine:
            blocks.append(_refinement(fine))
    if practice is None:
        blocks.append(
            Missing("The practice recordings were not diagnosed: `make practice DATA=DIR` does it.")
        )
    else:
        blocks.append(_practice(practice))
    return Section("proof", TITLE, tuple(blocks))


def _words(proof: Mapping[str, Any]) -> Paragraph:
    bias = proof["stiffness_bias"]
    text = (
        f"{proof['recordings']} recordings of a laboratory whose solver and laws are not ours, drawn from "
        f"secret seeds in {len(proof['shards'])} of {proof['started']} shards begun, each noted with the "
        "hash of its answers before its diagnosis; the others, of earlier versions or aborted, are in "
        f"`reports/proof`. {proof['detectable']} of them hold an effect that a noise-free fit could see (a "
        "gain of 40 in χ²)."
    )
    drawn = proof["drawn"]
    if drawn["alone"]:
        least, most = min(drawn["alone"].values()), max(drawn["alone"].values())
        times = f"{least} to {most} times" if most > least else f"{most} times" if most > 1 else "once"
        text += (
            f" {len(drawn['alone'])} effects were drawn alone, {times} each (asked for 6), "
            f"and {drawn['pairs']} pairs of {drawn['combinations']} combinations (60 of 30)."
        )
    whole = len(proof["shards_of_intervals"])
    if whole < len(proof["shards"]):
        text += (
            f" Intervals are counted in {whole} of these shards: the others were diagnosed by versions that "
            "give other intervals, and judged alike all recordings of a shard that was diagnosed again."
        )
    everywhere = proof["everywhere"]["right_or_tied"]
    text += (
        " The frames that a recording declares held out do not count there, for no diagnosis may fit them; "
        f"where they count {everywhere['count']} of {everywhere['of']} are right or tied."
    )
    if bias["recordings"]:
        text += (
            f" In {bias['recordings']} that were named rightly EI is off by {fixed(100 * bias['with'], 1)} % "
            f"in the median; the elastic rod's by {fixed(100 * bias['without'], 1)} %. Of the elastic rod's "
            f"error {fixed(bias['ratio'], 2)} is left in the median (goal 0.2); where it is more than "
            f"{_where(bias)}."
        )
        if bias.get("expected"):
            expected = bias["expected"]
            text += (
                f" If EI were off by what its intervals say, no more, {fixed(expected['ratio'], 2)} would be "
                f"left ({expected['recordings']} recordings)."
            )
    return Paragraph(text)


def _where(bias: Mapping[str, Any]) -> str:
    """What is left of EI's error, by how large it was."""
    told = [(100 * one["without_more_than"], one["recordings"], one["ratio"]) for one in bias["where"]]
    counted = [(more, f"{of} recording{'s' if of > 1 else ''}", ratio) for more, of, ratio in told]
    return "; ".join(f"{fixed(more, 0)} % ({of}) {fixed(ratio, 2)}" for more, of, ratio in counted)


def _beside(results: Results, file: str, keys: list[str], label: str, goal: str) -> tuple[str, ...]:
    found: Any = results.json("proof", file)
    for key in keys if found else ():
        found = found[key]
    return (label, *_share(found, "recordings"), goal) if found else ()


def _shares(proof: Mapping[str, Any], beside: list[tuple[str, ...]]) -> Table:
    rows: list[tuple[str, ...]] = []
    narrow = proof["where_detectable"]
    for key, (label, goal) in SHARES.items():
        rows.append((label, *_share(proof[key], "recordings"), goal))
        if key in narrow:
            rows.append((DETECTABLE, *_share(narrow[key], "recordings"), goal))
    coverage = {
        "95 % intervals that hold the truth": proof["coverage"]["all"],
        DETECTABLE: narrow["coverage"],
        "of laws' own forms": proof["coverage_forms"]["all"],
    }
    rows += [(label, *_share(one, "intervals"), "90 to 99 %") for label, one in coverage.items()]
    rows += beside
    columns = (
        Column("What", align="left"), Column("Count"), Column("Share", "%"), Column("95 % interval", "%"),
        Column("Goal"),
    )  # fmt: skip
    others = ("without", "next", "heldout", "sizes", "screen", "images")
    named = ", ".join(f"`proof-{one}`" for one in others)
    caption = f"The blind proof (`make proof`, and {named}), with Wilson's intervals."
    return Table(caption, columns, tuple(rows))


def _share(found: Mapping[str, Any], what: str) -> tuple[str, str, str]:
    count = f"{found['count']} of {found['of']} {what}"
    if found["share"] is None:
        return count, ABSENT, ABSENT
    low, high = (fixed(100 * found[key], 1) for key in ("low", "high"))
    return count, fixed(100 * found["share"], 1), f"{low} to {high}"


def _outcomes(proof: Mapping[str, Any], figures: Path) -> Figure:
    """A bar an effect: how its recordings with it alone ended."""
    names = sorted(proof["by_effect"], reverse=True)
    figure = canvas(16 + 5 * len(names))
    axes = figure.subplots()
    for at, name in enumerate(names):
        left = 0
        for outcome, color in OUTCOMES.items():
            count = proof["by_effect"][name].get(outcome, 0)
            axes.barh(
                at,
                count,
                left=left,
                color=color,
                height=0.65,
                edgecolor="white",
                label=outcome if at == 0 else None,
            )
            left += count
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axes.set_xlabel("recordings")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(visible=False, axis="y")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=len(OUTCOMES))
    caption = (
        "Recordings with one effect alone, where it is detectable, by what was said. What was said of pairs "
        "stands in the table."
    )
    return Figure(save(figure, figures, "proof"), caption, "Outcomes of the blind proof by effect")


def _confusion(proof: Mapping[str, Any]) -> Table:
    rows = tuple((one["true"], one["said"], str(one["count"])) for one in proof["confusion"])
    columns = (
        Column("In the recording", align="wide"),
        Column("Said", align="wide"),
        Column("Count", "recordings"),
    )
    return Table("What was in the recordings, and what was said.", columns, rows)


def _counted(share: Mapping[str, Any]) -> str:
    return f"{share['count']} of {share['of']}" if share["of"] else ABSENT


def _versions(proof: Mapping[str, Any]) -> Table:
    rows = tuple(
        (
            one["shards"][-1].removeprefix("shard_"),
            f"{len(one['shards'])}, {one['recordings']}",
            *(_counted(one[key]) for key in VERSIONS),
            fixed(one["stiffness_bias"]["ratio"], 2),
        )
        for one in proof["versions"]
    )
    columns = (
        Column("Last shard", align="left"),
        Column("Shards, recordings", "count"),
        *(Column(title, "count") for title in VERSIONS.values()),
        Column("EI", "share"),
    )
    caption = (
        "Every version of what diagnoses, with its own shards; the last one's are those that count above. "
        "Wrong: confidently; small: named wrongly, and too small to be detectable; EI: what of its error the "
        "named effect leaves, median."
    )
    return Table(caption, columns, rows)


def _refinement(fine: Mapping[str, Any]) -> Table:
    asked = ("gain", "bodies_m"), ("steps_gain", "steps_m"), ("harder_gain", "harder_m")
    rows = tuple(
        (
            " + ".join(one["effects"]) or "nothing",
            str(one["obstacles"]),
            str(one["bodies"]),
            *(f"{fixed(one[left], 2)} ({fixed(1e3 * one[moved], 3)})" for left, moved in asked),
        )
        for one in fine["cases"]
    )
    unit = "χ² (mm)"
    columns = (
        Column("In the recording", align="left"), Column("Obstacles", "count"), Column("Bodies", "count"),
        Column("Twice the bodies", unit), Column("Half the steps", unit), Column("Harder obstacles", unit),
    )  # fmt: skip
    caption = (
        "What the laboratory's rope leaves of one with twice as many bodies, of one played in steps half as "
        "long, and of one whose obstacles are four times as hard (`make proof-refinement`): the noise-free "
        "χ² of the best such rope with the same effects, at white noise of 1.5 mm "
        f"(goal < {fine['goal']:g}), and in brackets the largest change of a point."
    )
    return Table(caption, columns, rows)


def _practice(practice: Mapping[str, Any]) -> Table:
    rows = []
    for name, row in practice["recordings"].items():
        held = row["parameters"]
        inside = sum(one["inside"] for one in held.values())
        ei = held["bending_stiffness"]
        rows.append(
            (
                name,
                " + ".join(row["true"]) or "nothing",
                " + ".join(row["named"]) or row["status"],
                f"{scientific(ei['value'], 3)} ({scientific(ei['true'], 3)})",
                f"{inside} of {len(held)} values",
                fixed(row["seconds"], 0),
            )
        )
    columns = (
        Column("Recording", align="left"), Column("In it", align="wide"), Column("Said", align="wide"),
        Column("EI (true)", "N m²"), Column("Inside"), Column("Time", "s"),
    )  # fmt: skip
    caption = (
        "Practice recordings of a third solver (`make practice DATA=DIR`). Inside: planted parameters and EI "
        "in their 95 % intervals or within a tenth."
    )
    return Table(caption, columns, tuple(rows))
