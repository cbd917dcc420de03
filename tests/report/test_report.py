"""The report as a whole: both renderings from one content, self-contained, the same bytes twice."""

from __future__ import annotations

import json
import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from report.synthetic import LAYOUTS, blocks_of

from dlolib.report import build_report
from dlolib.report.diagnosis import scan_figure
from dlolib.report.shapes import shapes_figure

REQUESTS = ("src", "href", "srcset", "data", "action", "poster", "background", "xlink:href")
OUTPUTS = ("report.json", "report.html", "report.pdf")
UNITS = re.compile(
    r"mm|\bm\b|N m²|m⁴/s²|N m|rad|%|\bs\b|px|g/m|kg/m|1/m|frames|poses|iterations|layouts|runs|recordings"
    r"|intervals|values|mm a point|α"
)

NAMING = ("Measure", "Parameter", "Figure", "Recording")
"""Columns that name things and hold no quantities."""


class Page(HTMLParser):
    """What a browser would fetch, the texts of figures, and the anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.requests: list[str] = []
        self.anchors: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name in REQUESTS:
                (self.links if (value or "").startswith("#") else self.requests).append(value or "")
            if name == "style" and "url(" in (value or ""):
                self.requests.append(value or "")
            if name == "id":
                self.anchors.append(value or "")


@pytest.fixture(scope="module")
def out(results: Path) -> Path:
    parameters = {"lab": {"length_m": 0.445, "seed": 1}, "layouts": list(LAYOUTS)}
    build_report(results, results, parameters=parameters)
    return results


@pytest.fixture(scope="module")
def content(out: Path) -> dict:
    return json.loads((out / "report.json").read_text(encoding="utf-8"))


def test_page_asks_nobody_for_anything(out: Path) -> None:
    text = (out / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.requests and all(request.startswith("data:") for request in page.requests)
    assert not {"script", "iframe", "object", "embed", "base"} & set(page.tags)
    assert not re.search(r"@import|url\(", text)


def test_figures_ask_nobody_for_anything(out: Path) -> None:
    figures = sorted((out / "figures").glob("*.svg"))
    assert figures
    for path in figures:
        text = path.read_text(encoding="utf-8")
        fetched = re.findall(r"""(?:href|src)\s*=\s*["']([^"']*)["']|url\(([^)]*)\)""", text)
        assert all(target.startswith(("#", "data:")) for pair in fetched for target in pair if target), path
        assert "dc:date" not in text, f"{path} carries a date"


def test_page_is_smaller_than_two_megabytes(out: Path) -> None:
    assert (out / "report.html").stat().st_size < 2_000_000


def test_every_figure_stands_whole_in_the_page(out: Path) -> None:
    uris = Page((out / "report.html").read_text(encoding="utf-8")).requests
    drawn = {" ".join(path.read_text("utf-8").split()) for path in (out / "figures").glob("*.svg")}
    assert drawn and drawn <= {unquote(uri.removeprefix("data:image/svg+xml,")) for uri in uris}


def test_a_long_recording_makes_no_long_figure(tmp_path: Path) -> None:
    sizes = []
    for frames in (60, 600):
        s_m = np.linspace(0, 0.4, 20)
        rows = {"frame": np.repeat(np.arange(frames), 20), "s_m": np.tile(s_m, frames)}
        wave = np.random.default_rng(1).normal(0, 1e-3, 20 * frames) + np.repeat(np.arange(frames), 20) * 1e-3
        rows |= {
            "x_m": rows["s_m"],
            "y_m": 0 * wave,
            "z_m": wave,
            "sim_x_m": rows["s_m"],
            "sim_z_m": 0 * wave,
        }
        shapes_figure("long", pd.DataFrame(rows), tmp_path / str(frames))
        sizes.append((tmp_path / str(frames) / "shapes_long.svg").stat().st_size)
    assert sizes[1] < 1.1 * sizes[0]


@pytest.mark.parametrize(("points", "says"), [(1, "No frame has two points"), (2, "grey one line a frame")])
def test_few_points_a_frame_are_drawn(tmp_path: Path, points: int, says: str) -> None:
    rows = pd.DataFrame({"frame": np.repeat(np.arange(5), points), "s_m": np.tile([0.2, 0.4][:points], 5)})
    rows = rows.assign(x_m=rows["s_m"], y_m=0.0, z_m=0.1 * rows["frame"], sim_x_m=rows["s_m"], sim_z_m=0.0)
    assert says in shapes_figure("few", rows, tmp_path).caption


def test_a_scan_in_which_nothing_can_gain_is_drawn() -> None:
    """As of markers on the clamps alone: nothing that is fitted moves them."""
    rows = {"recording": "tips", "s_m": [0.0, 0.4] * 3, "frame": [0, 0, 1, 1, 2, 2]}
    canvas = scan_figure(pd.DataFrame(rows).assign(gain=0.0, threshold=0.0), "tips")
    canvas.canvas.draw()


@pytest.mark.usefixtures("undrawn")
def test_a_large_page_is_written_with_a_warning(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("dlolib.report.build.LARGE_BYTES", 1000)
    monkeypatch.setattr("dlolib.report.build.render_pdf", lambda *_: b"")
    page = build_report(results, tmp_path / "out")
    assert page.is_file()
    assert "report.html: the page has 0." in caplog.text and "warning" in caplog.text


def test_contents_lead_to_every_section(out: Path, content: dict) -> None:
    page = Page((out / "report.html").read_text(encoding="utf-8"))
    names = [section["name"] for section in content["sections"]]
    assert page.links == [f"#{name}" for name in names]
    assert set(names) <= set(page.anchors)


def test_two_runs_give_the_same_bytes(out: Path, results: Path, tmp_path: Path) -> None:
    again = tmp_path / "elsewhere"
    parameters = {"lab": {"length_m": 0.445, "seed": 1}, "layouts": list(LAYOUTS)}
    build_report(results, again, parameters=parameters)
    for name in OUTPUTS:
        assert (again / name).read_bytes() == (out / name).read_bytes(), name
    figures = {path.name: path.read_bytes() for path in (again / "figures").iterdir()}
    assert figures and figures == {path.name: path.read_bytes() for path in (out / "figures").iterdir()}


def test_outputs_name_no_folder_of_this_machine(out: Path, results: Path) -> None:
    for name in OUTPUTS:
        assert str(results.parent).encode() not in (out / name).read_bytes(), name


def test_pdf_has_no_date(out: Path) -> None:
    document = (out / "report.pdf").read_bytes()
    assert document.startswith(b"%PDF")
    assert b"CreationDate" not in document and b"ModDate" not in document


def test_every_figure_has_a_caption_that_says_what_to_see(content: dict) -> None:
    figures = blocks_of(content, "figure")
    assert len(figures) >= 12
    assert [figure["number"] for figure in figures] == list(range(1, len(figures) + 1))
    for figure in figures:
        assert len(figure["caption"]) > 80, figure["file"]
        assert len(figure["alt"]) > 10, figure["file"]


def test_every_number_in_a_table_has_a_unit(content: dict) -> None:
    for table in blocks_of(content, "table"):
        if table["caption"] == "Versions." or "params.yaml" in table["caption"]:
            continue  # versions are no quantities; parameters have their unit in their name
        titles = [column["title"] for column in table["columns"]]
        for row in table["rows"]:
            beside = "Unit" in titles and bool(row[titles.index("Unit")])
            assert not beside or "^" not in row[titles.index("Unit")]
            for column, cell in zip(table["columns"], row, strict=True):
                names = column["align"] == "left" or column["title"] in NAMING or "dvc repro" in cell
                if names or not re.search(r"\d", re.sub(r"[Ll]ayout \d", "", cell)):
                    continue
                has_unit = column["unit"] or UNITS.search(cell) or beside
                assert has_unit, (table["caption"], column["title"], cell)


def test_the_summary_gives_the_stiffness_with_what_was_missing(content: dict) -> None:
    told = json.dumps(content["sections"][0], ensure_ascii=False)
    assert "and at 3.00 × 10⁻⁴ (2.90 to 3.10 × 10⁻⁴) with what the diagnosis names in the model." in told


def test_headline_is_what_the_stages_measured(content: dict) -> None:
    headline = content["headline"]
    assert set(headline) == {
        "ei_n_m2", "residual_m", "chain_rms_m", "worst_goal_error_m", "smallest_clearance_m",
    }  # fmt: skip
    assert headline["ei_n_m2"] == pytest.approx(
        {"value": 3.04e-4, "low": 0.97 * 3.04e-4, ("high"): 1.04 * 3.04e-4}
    )
    assert headline["residual_m"] == pytest.approx(1.4e-3)
    # Noise of 0.6 mm along each axis leaves two of them across the rope.
    assert headline["chain_rms_m"] == pytest.approx(6e-4 * 2**0.5, rel=0.1)
    assert headline["worst_goal_error_m"] == pytest.approx(0.0041 + 0.71 / 200)
    assert headline["smallest_clearance_m"] == pytest.approx(0.0052 - 0.71 / 300)


def test_a_run_at_an_obstacle_is_told_by_the_margin_of_learning(content: dict) -> None:
    (words,) = [block for block in blocks_of(content, "paragraph") if "bare" in block["text"]]
    assert "plain MSE, 5 of 5 runs end at an obstacle" in words["text"]
    assert "with contact term, 0 of 5 runs end at an obstacle" in words["text"]
    (table,) = [block for block in blocks_of(content, "table") if block["caption"] == "Figure by figure."]
    ours = {row[0]: row[2] for row in table["rows"]}
    assert ours["Plain MSE on layout 1, Fig. 11"].startswith("5 of 5 runs end at an obstacle")


def test_iterations_of_every_start_stand_beside_the_papers(content: dict) -> None:
    (table,) = [block for block in blocks_of(content, "table") if block["caption"] == "Figure by figure."]
    (row,) = [row for row in table["rows"] if row[0] == "Iterations of learning, Table I"]
    assert row[1] == "200 iterations"
    first = "Layout 1: 120 iterations, 171 over the 2 initial weights that were tried; Layout 2: "
    assert row[2].startswith(first)


def test_cards_say_which_command_gives_them(content: dict) -> None:
    (cards,) = blocks_of(content, "cards")
    assert len(cards["items"]) == 5
    assert all(card["command"].startswith("dvc repro ") for card in cards["items"])


def test_page_holds_every_section_caption_and_cell(out: Path, content: dict) -> None:
    text = unescape(re.sub(r"</?(?:code|sub|strong)>", "", (out / "report.html").read_text(encoding="utf-8")))
    assert len(content["sections"]) == 15
    shown = [section["title"] for section in content["sections"]]
    shown += [block["caption"] for kind in ("figure", "table") for block in blocks_of(content, kind)]
    shown += [cell for table in blocks_of(content, "table") for row in table["rows"] for cell in row]
    for words in shown:
        assert re.sub(r"[`~]|\*\*", "", words) in text, words


def test_a_verdict_is_told_with_its_tie_and_the_motion_that_would_end_it(content: dict) -> None:
    (section,) = [section for section in content["sections"] if section["name"] == "diagnosis"]
    words = " ".join(block["text"] for block in section["blocks"] if block["kind"] == "paragraph")
    assert "explained, but not by one model alone" in words and "roll the wrist" in words
    assert "To tell plastic bending from internal friction" in words
    files = [block["file"] for block in section["blocks"] if block["kind"] == "figure"]
    assert [file.split("diagnosis_")[1].split("_")[0] for file in files] == [
        "rope",
        "scan",
        "models",
        "moments",
    ]
    parameters, detectable = [block for block in section["blocks"] if block["kind"] == "table"]
    assert "plastic bending: yield curvature" in [row[1] for row in parameters["rows"]]
    assert detectable["rows"][1][2] == "cannot be seen here"


def test_a_solver_that_no_stiffness_fits_is_said_so(content: dict) -> None:
    (section,) = [section for section in content["sections"] if section["name"] == "solvers"]
    words, figure, table = section["blocks"]
    assert "With 10 and 20 iterations there is none" in words["text"]
    assert figure["file"] == "figures/solvers.svg" and "no number of iterations" in figure["caption"]
    assert [row[4] for row in table["rows"]] == [*["3.00 × 10⁻⁴"] * 3, "none", "none", "5.00 × 10⁻⁴"]
    assert [row[6] for row in table["rows"]] == ["0.0"] * 3 + ["–", "–", "66.7"]


def test_each_law_stands_beside_another_solvers(content: dict) -> None:
    (section,) = [section for section in content["sections"] if section["name"] == "agreement"]
    words, figure = section["blocks"]
    assert "3 times as large" in words["text"] and "1 of 3 are within the goal" in words["text"]
    assert "1 could not be simulated" in words["text"] and "In 1 the rope lies" in words["text"]
    assert figure["file"] == "figures/agreement.svg"


def test_the_bench_keeps_what_was_missed_and_what_was_not_measured(content: dict) -> None:
    (section,) = [section for section in content["sections"] if section["name"] == "bench"]
    words, figure, fast, right = section["blocks"]
    assert "1 of 14 goals are met" in words["text"] and "Not measured yet: " in words["text"]
    assert figure["file"] == "figures/bench.svg"
    assert [row[1:3] for row in fast["rows"]] == [["3.00", "≥ 12"], ["–", "≤ 0.20"]]
    assert [row[1:3] for row in right["rows"]] == [["0.120", "≤ 0.25"]]


def test_the_proof_shows_every_share_and_every_confusion(content: dict) -> None:
    (section,) = [section for section in content["sections"] if section["name"] == "proof"]
    words, shares, figure, confusion, versions, refinement, practice = section["blocks"]
    assert "5 recordings" in words["text"] and "1 of 2 shards" in words["text"]
    assert "Intervals are counted in 0 of these shards" in words["text"]
    counts = {row[0]: row[1:3] for row in shares["rows"]}
    assert counts["right, or among the best three of a tie"] == ["2 of 3 recordings", "66.7"]
    assert counts["nothing missing, and yet an alarm"] == ["1 of 2 recordings", "50.0"]
    assert counts["95 % intervals that hold the truth"] == ["1 of 1 intervals", "100.0"]
    assert counts["planted at the size that `detectable` names, and found"] == ["9 of 10 recordings", "90.0"]
    assert counts["every pair fitted: a better model than those screened"] == ["1 of 12 recordings", "8.3"]
    assert figure["file"] == "figures/proof.svg"
    assert ["nothing", "end_angle", "1"] in confusion["rows"]
    every = ["2 of 3", "1 of 3", "1 of 3", "–", "1 of 2", *["–"] * 3, "0.05"]
    assert versions["rows"] == [["0", "1, 4", *every], ["1", "1, 5", *every]]
    changes = ["0.42 (0.250)", "0.20 (0.030)", "0.10 (0.040)"]
    assert refinement["rows"] == [["nothing", "1", "58", *changes]]
    assert practice["rows"] == [
        ["practice_clock", "clock_offset", "clock_offset", "3.02 × 10⁻⁴ (3.00 × 10⁻⁴)", "1 of 2 values", "31"]
    ]


def test_what_was_diagnosed_together_stands_with_what_it_foretells(content: dict) -> None:
    (section,) = [section for section in content["sections"] if section["name"] == "cables"]
    tables = [block for block in section["blocks"] if block["kind"] == "table"]
    (swept,) = [table for table in tables if "make sweeps" in table["caption"]]
    assert {row[0] for row in swept["rows"]} == {"the first and half of the second (at ccccccc)"}
    assert [row[2:] for row in swept["rows"]] == [
        ["Pac sweep", "47.0", "5.3", "≤ 10"],
        ["its other half, foretold", "–", "11.0", "≤ 12"],
    ]
    assert any("elastic rod leaves out: friction." in block.get("text", "") for block in section["blocks"])


def test_the_chain_s_misses_are_named(content: dict) -> None:
    (section,) = [section for section in content["sections"] if section["name"] == "chain"]
    words = " ".join(block["text"] for block in section["blocks"] if block["kind"] == "paragraph")
    assert (
        "2 of 3 figures meet their goals" in words
        and "Missed: spacing, largest [%] (goal 3): crossing 6.00." in words
    )
