"""Reports of a run of which something is missing, unreadable or left out, and what no report may replace."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure as Canvas
from report.synthetic import LAYOUTS, blocks_of, write_results, write_robot_log

from dlolib.errors import DloError, FormatError
from dlolib.files import write_csv, write_json
from dlolib.report import Results, build_report, collect
from dlolib.report.build import FILES
from dlolib.report.headline import headline
from dlolib.report.sections import execution, layouts


@pytest.mark.usefixtures("undrawn")
def test_own_data_has_no_truth_and_says_so(results: Path, tmp_path: Path) -> None:
    content = collect(Results(results, results.parent / "data", has_truth=False), tmp_path / "figures")
    assert content["headline"]["chain_rms_m"] is None
    said = " ".join(block["text"] for block in blocks_of(content, "missing"))
    assert "no truth to compare" in said
    assert "not those of the rope that was recorded here" in json.dumps(content)
    assert "In the laboratory, whose rope is another one: " in json.dumps(content)
    assert "laboratory's rope:" not in json.dumps(content)


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04"])
def test_a_truth_that_cannot_be_read_is_named(results: Path, tmp_path: Path, content: bytes) -> None:
    data = Path(shutil.copytree(results.parent / "data", tmp_path / "data"))
    (data / "truth" / "shapes.npz").write_bytes(content)
    with pytest.raises(FormatError, match=r"shapes\.npz: holds no shapes; run stage lab again"):
        _ = Results(results, data).truth


@pytest.mark.usefixtures("undrawn")
def test_a_stiffness_over_density_keeps_its_unit(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    for name in ("fit.json", "loss.csv"):
        path = copy / "reports" / "identify" / "captured" / name
        text = path.read_text(encoding="utf-8").replace("bending_stiffness", "bending_stiffness_over_density")
        path.write_text(text.replace("N m^2", "m^4/s^2"), encoding="utf-8")
    content = collect(Results(copy / "reports", copy / "data"), tmp_path / "figures")
    (table,) = [block for block in blocks_of(content, "table") if block["caption"] == "Figure by figure."]
    ours = {row[0]: row[2] for row in table["rows"]}
    assert ours["Stiffness identified"].startswith("3.04 × 10⁻⁴ m⁴/s² (")


@pytest.mark.usefixtures("undrawn")
def test_the_parameters_stand_as_params_yaml_has_them(results: Path, tmp_path: Path) -> None:
    chain = {"threshold": None, "full": False, "without": [], "topics": {}, "hidden": [64, 32], "tie": 6.0}
    given = {"chain": chain, "learn": {"segments": 5}, "layouts": [LAYOUTS[0]]}
    source = Results(results, results.parent / "data", parameters=given)
    content = collect(source, tmp_path / "figures")
    (table,) = [block for block in blocks_of(content, "table") if "params.yaml" in block["caption"]]
    assert table["rows"][0][1] == (
        "`threshold` null; `full` false; `without` []; `topics` {}; `hidden` 64, 32; `tie` 6"
    )
    parts = {part["name"]: json.dumps(part) for part in content["sections"]}
    assert "Layouts for which a motion was learned: 1; motions that keep clear" in parts["headline"]
    # a user's obstacles may be of any shape
    assert (
        "from A to B as 5 arcs" in parts["layouts"] and "cylinder" not in parts["layouts"] + parts["ablation"]
    )


def test_a_short_descent_fills_its_panel(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy, drawn = tmp_path / "run", {}
    shutil.copytree(results.parent, copy)
    path = copy / "reports" / "identify" / "captured" / "loss.csv"
    loss = pd.read_csv(path)
    write_csv(path, loss[loss["method"] == "least_squares"])
    monkeypatch.setattr(Canvas, "get_layout_engine", lambda self: None)
    monkeypatch.setattr(
        Canvas, "savefig", lambda self, path, **_: drawn.update({path.stem: self}) or path.touch()
    )
    collect(Results(copy / "reports", copy / "data"), tmp_path / "figures")
    assert drawn["loss"].get_axes()[0].get_xlim()[1] < 20


@pytest.mark.usefixtures("undrawn")
def test_of_recordings_identified_together_each_keeps_its_own(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    folder = copy / "reports" / "identify" / "wire_white"
    fit = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    own = fit["nuisances"]["wire_white"]["end_angle.start_1"]
    fit["nuisances"]["wire_again"] = {"end_angle.start_1": own | {"value": 0.0123}}
    write_json(folder / "fit.json", fit)
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    write_json(folder / "summary.json", summary | {"recordings": ["wire_white", "wire_again"]})
    content = collect(Results(copy / "reports", copy / "data"), tmp_path / "figures")
    (table,) = [block for block in blocks_of(content, "table") if "What was identified" in block["caption"]]
    angles = {row[0]: row[2] for row in table["rows"] if row[1] == "End angle, start 1"}
    assert (angles["Wire white"], angles["Wire again"]) == ("0.0110", "0.0123")
    said = " ".join(block["text"] for block in blocks_of(content, "paragraph"))
    assert "Wire white: wire_white and wire_again were identified together; shapes" in said


@pytest.mark.usefixtures("undrawn")
def test_of_clouds_no_image_is_spoken_of(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    frames = copy / "data" / "capture" / "frames.csv"
    table = pd.read_csv(frames)
    write_csv(frames, table[["frame", "t_s"]].assign(cloud=[f"{k}.ply" for k in table["frame"]]))
    for k in table["frame"]:
        (frames.parent / f"{k}.ply").write_text("ply", encoding="utf-8")
    words = json.dumps(collect(Results(copy / "reports", copy / "data"), tmp_path / "figures"))
    assert "in each segmented cloud" in words and "in the colour image" not in words


def _turned(table: pd.DataFrame) -> pd.DataFrame:
    """The table with what goes along z along y instead, as of a rope that lies on a table, 1 m further up."""
    swapped = {name: name.replace("z_m", "y_m") for name in table if name.endswith("z_m")}
    swapped |= {name: name.replace("y_m", "z_m") for name in table if name.endswith("y_m")}
    turned = table.rename(columns=swapped)
    return turned.assign(**{name: turned[name] + 1.0 for name in turned if name.endswith("z_m")})


def test_a_rope_on_a_table_is_looked_at_from_above(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy, drawn = tmp_path / "run", {}
    shutil.copytree(results.parent, copy)
    monkeypatch.setattr(Canvas, "get_layout_engine", lambda self: None)
    monkeypatch.setattr(
        Canvas, "savefig", lambda self, path, **_: drawn.update({path.stem: self}) or path.touch()
    )
    names = ("shapes.csv", "goal.csv", "trajectory.csv", "capture/motion.csv")
    for path in (path for name in names for path in copy.rglob(name)):
        write_csv(path, _turned(pd.read_csv(path)))
    for path in copy.rglob("layout.json"):
        layout = json.loads(path.read_text(encoding="utf-8"))
        for place in (layout["start"], layout["grasp"]):
            x, y, z = place["position_m"]
            place["position_m"] = [x, z, y + 1.0]
        for obstacle in layout["obstacles"]:
            x, y, z = obstacle["center_m"]
            obstacle.update(center_m=[x, z, y + 1.0], axis=[0.0, 0.0, 1.0])
        write_json(path, layout)
    content = collect(Results(copy / "reports", copy / "data"), tmp_path / "figures")
    captions = {Path(block["file"]).stem: block["caption"] for block in blocks_of(content, "figure")}
    for name in ("motion", "shapes_captured", "execution"):
        assert "x-y plane" in captions[name], name
        assert drawn[name].get_axes()[0].get_ylabel() == "y [mm]", name
    # the rope's height of 1 m is no part of what is to be seen
    front = drawn["layouts"].get_axes()[0]
    assert front.get_ylim()[0] > 0.9


@pytest.mark.usefixtures("undrawn")
def test_logs_of_a_robot_stand_beside_the_plan(tmp_path: Path) -> None:
    results = write_results(tmp_path, execution=False)
    write_robot_log(results / "execute" / LAYOUTS[0])
    content = collect(Results(results, tmp_path / "data"), tmp_path / "figures")
    assert any(figure["file"] == "figures/tracking.svg" for figure in blocks_of(content, "figure"))
    assert "protective stop" in json.dumps(content)


@pytest.mark.usefixtures("undrawn")
def test_a_log_of_another_trajectory_tells_nothing_of_this_one(tmp_path: Path) -> None:
    results = write_results(tmp_path, execution=False)
    write_robot_log(results / "execute" / LAYOUTS[0])
    result = results / "execute" / LAYOUTS[0] / "result.json"
    said = {"of_another": True, "demanded_error_m": 0.03, "tracking_error_m": 0.0329}
    write_json(result, {**json.loads(result.read_text(encoding="utf-8")), **said})
    content = json.dumps(collect(Results(results, tmp_path / "data"), tmp_path / "figures"))
    assert "another trajectory, which goes up to 30 mm off the one here" in content
    assert "32.9" not in content


@pytest.mark.usefixtures("undrawn")
def test_a_chain_of_another_capture_is_not_laid_on_this_ones_images(tmp_path: Path) -> None:
    results, frames = write_results(tmp_path), tmp_path / "data" / "capture" / "frames.csv"
    lines = frames.read_text(encoding="utf-8").splitlines(keepends=True)
    frames.write_text("".join(lines[:-2]), encoding="utf-8")
    content = collect(Results(results, tmp_path / "data"), tmp_path / "figures")
    assert "The chain is of another capture" in json.dumps(content)


def test_what_was_taken_out_of_the_parameters_is_no_longer_reported(results: Path) -> None:
    data, kept = results.parent / "data", ["layout_2", "layout_3"]
    paths = {"captured": "data/recordings/captured", "wire_white": "data/wires/wire_white"}
    parameters = {"layouts": kept, "recordings": {name: {"path": path} for name, path in paths.items()}}
    now = Results(results, data, parameters=parameters)
    assert now.layouts == ("layout_2", "layout_3")
    assert now.recordings == ("captured", "wire_white")
    assert set(now.diagnosed) <= {"captured", "wire_white"}
    before, after = headline(Results(results, data)), headline(now)
    assert after["worst_goal_error_m"] < before["worst_goal_error_m"]


def test_empty_results_make_a_report_of_sentences(tmp_path: Path) -> None:
    (tmp_path / "reports").mkdir()
    build_report(tmp_path / "reports", tmp_path / "out")
    content = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert not blocks_of(content, "figure")
    assert len(blocks_of(content, "missing")) >= 8
    assert content["headline"] and all(value is None for value in content["headline"].values())


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("gone", "sentence"),
    [
        ("reports/identify", "Nothing was identified yet"),
        ("reports/identify/captured/loss.csv", "no loss curve"),
        ("reports/identify/wire_black/shapes.csv", "no simulated shapes of the recording `wire_black`"),
        ("reports/learn", "Nothing was learned yet"),
        ("reports/learn/layout_1/ablation.csv", "ablation has not run"),
        ("reports/learn/layout_2/shapes.csv", "no shapes to draw for Layout 2"),
        ("data/layouts/layout_2", "no shapes to draw for Layout 2"),
        ("reports/execute", "Nothing was executed"),
        ("reports/agreement.json", "not held against another solver"),
        ("reports/bench.json", "Nothing was measured beside the peers"),
        ("reports/chain_bench.json", "not held against rendered ropes"),
        ("reports/proof", "blind proof was not run"),
        ("reports/practice.json", "practice recordings were not diagnosed"),
        ("reports/cables.json", "cables were not run"),
        ("reports/sweeps.json", "sweeps were not diagnosed"),
        ("reports/deform.json", "swung cables were not foretold"),
        ("reports/elastic.json", "elastic laboratory was not run"),
        ("reports/solvers.json", "two solvers were not compared"),
        ("data/truth", "no truth to compare"),
        ("data/capture", "no images under this recording"),
        ("data/recordings/captured", "No chain is there"),
    ],
)
def test_one_missing_input_gives_a_sentence(results: Path, tmp_path: Path, gone: str, sentence: str) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    path = copy / gone
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    content = collect(Results(copy / "reports", copy / "data"), tmp_path / "figures")
    assert sentence in " ".join(block["text"] for block in blocks_of(content, "missing"))


def test_a_layout_is_drawn_as_it_was_learned_for(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    now, then = copy / "data" / "layouts" / LAYOUTS[0], copy / "reports" / "learn" / LAYOUTS[0] / "layout"
    shutil.copytree(now, then)
    source = Results(copy / "reports", copy / "data")
    content = json.loads((now / "layout.json").read_text(encoding="utf-8"))
    write_json(now / "layout.json", content | {"obstacles": []})
    layout = source.layout(LAYOUTS[0])
    assert layout is not None and len(layout.obstacles) == 2
    shutil.rmtree(now)
    assert source.layout(LAYOUTS[0]) is not None


def test_a_layouts_name_is_no_formula(results: Path, tmp_path: Path) -> None:
    name = r"a$\foo$b"
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    for folder in (copy / "data" / "layouts", copy / "reports" / "learn", copy / "reports" / "execute"):
        (folder / LAYOUTS[0]).rename(folder / name)
    source = Results(copy / "reports", copy / "data")
    for section in (layouts.section, execution.section):
        section(source, tmp_path / "figures")
    drawn = {path.stem for path in (tmp_path / "figures").glob("*.svg")}
    assert {"layouts", "learning", "execution"} <= drawn


@pytest.mark.usefixtures("undrawn")
def test_unreadable_result_is_refused_and_nothing_written(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    (copy / "reports" / "learn" / LAYOUTS[1] / "result.json").write_text("{", encoding="utf-8")
    with pytest.raises(DloError, match=r"layout_2.result\.json.*no JSON"):
        build_report(copy / "reports", copy / "out")
    assert not (copy / "out").exists()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("file", "key", "said"),
    [
        ("learn/layout_1/result.json", "min_clearance_m", "has no min_clearance_m"),
        ("learn/layout_1/curve.csv", "contact_margin_m", "has no column"),
        ("diagnose/captured/scan.csv", "threshold", "has no column"),
        ("identify/captured/summary.json", "heldout_rmse_m", "has no heldout_rmse_m"),
        ("bench.json", "at_least", "forward_vs_mujoco: has no at_least"),
        ("execute/layout_1/result.json", "rod_error_m", "laws.elastic: has no rod_error_m"),
    ],
)
def test_a_result_without_a_figure_is_refused_in_one_line(
    results: Path, tmp_path: Path, file: str, key: str, said: str
) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    path = copy / "reports" / file
    path.write_text(path.read_text(encoding="utf-8").replace(key, "other"), encoding="utf-8")
    with pytest.raises(FormatError, match=rf"{re.escape(file)}: {said}.*; run its stage again"):
        collect(Results(copy / "reports", copy / "data"), tmp_path / "figures")


@pytest.mark.usefixtures("undrawn")
def test_without_obstacles_there_is_no_clearance_and_none_is_missing(results: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(results.parent, copy)
    for path in (copy / "reports" / "learn").glob("*/result.json"):
        write_json(path, json.loads(path.read_text(encoding="utf-8")) | {"min_clearance_m": None})
        curve = path.with_name("curve.csv")
        write_csv(curve, pd.read_csv(curve).assign(min_clearance_m=float("inf")))
    content = collect(Results(copy / "reports", copy / "data"), tmp_path / "figures")
    (cards,) = blocks_of(content, "cards")
    (card,) = [card for card in cards["items"] if card["label"] == "Smallest clearance"]
    assert (card["value"], card["detail"]) == ("none", "No layout has an obstacle.")
    assert "Not there yet" not in json.dumps(content["sections"][0])
    (learning,) = [one for one in blocks_of(content, "figure") if one["file"].endswith("learning.svg")]
    assert "touches" not in learning["caption"] and "clearance" not in learning["alt"]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "there", ["report.pdf", "report.html", "figures/photo.txt", "report.json", "report.pdf/inside"]
)
def test_what_no_report_left_stays(results: Path, tmp_path: Path, there: str) -> None:
    out = tmp_path / "thesis"
    (out / there).parent.mkdir(parents=True)
    (out / there).write_text("{}", encoding="utf-8")
    if "inside" not in there:
        (out / "report.json").write_text('{"format": "mine"}', encoding="utf-8")
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    with pytest.raises(DloError, match="is there and of no report; write to a folder of its own"):
        build_report(results, out)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


@pytest.mark.usefixtures("undrawn")
def test_a_file_is_no_folder_to_report_to(results: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis").write_text("mine", encoding="utf-8")
    with pytest.raises(DloError, match="thesis: is a file; write to a folder of its own"):
        build_report(results, tmp_path / "thesis")
    assert (tmp_path / "thesis").read_text(encoding="utf-8") == "mine"


@pytest.mark.usefixtures("undrawn")
def test_a_report_goes_where_a_link_leads(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dlolib.report.build.render_pdf", lambda *_: b"")
    (tmp_path / "disk").mkdir()
    (tmp_path / "reports").symlink_to("disk")
    seen = []
    monkeypatch.setattr("dlolib.report.build.render_html", lambda _, work: seen.append(work) or "page")
    build_report(results, tmp_path / "reports")
    assert seen[0].parent == tmp_path / "disk"  # nothing is renamed from one disk to another
    assert {path.name for path in (tmp_path / "disk").iterdir()} == {"figures", *FILES}


@pytest.mark.usefixtures("undrawn")
def test_what_was_not_diagnosed_to_the_end_is_left_out(results: Path) -> None:
    (results / "diagnose/other").mkdir(parents=True)
    assert "other" not in Results(results, results.parent / "data").diagnosed


@pytest.mark.usefixtures("undrawn")
def test_what_the_parameters_name_no_more_is_not_reported(results: Path, tmp_path: Path) -> None:
    kept = [name for name in Results(results, results.parent / "data").recordings if name != "captured"]
    parameters = {"recordings": dict.fromkeys(kept), "layouts": [LAYOUTS[0]]}
    source = Results(results, results.parent / "data", parameters=parameters)
    assert source.recordings == tuple(sorted(kept)) and source.fit("captured") is None
    assert source.json("identify", "captured", "summary.json") is None
    content = collect(source, tmp_path / "figures")
    assert content["headline"]["ei_n_m2"] is None and content["headline"]["residual_m"] is None


@pytest.mark.usefixtures("undrawn")
def test_what_was_not_captured_is_named_on_the_first_page(results: Path, tmp_path: Path) -> None:
    for stage in ("identify", "diagnose"):
        shutil.rmtree(results / stage / "captured", ignore_errors=True)
    for stage in ("chain", "learn", "execute"):
        shutil.rmtree(results / stage, ignore_errors=True)
    content = collect(Results(results, tmp_path / "data"), tmp_path / "figures")
    said = json.dumps(content["sections"][0])
    assert "Nothing was captured here; what follows is of " in said and "No stage" not in said


@pytest.mark.parametrize("name", ["recording.json", "capture.json"])
def test_a_recording_is_no_results(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    with pytest.raises(DloError, match=rf"is a {name[:-5]}, no results; name the folder"):
        build_report(tmp_path, tmp_path / "out")


def test_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DloError, match="no such folder"):
        build_report(tmp_path / "nothing", tmp_path / "out")
