"""docs/formats.md names every key that is read, and every one of a verdict."""

import json
import re
from collections.abc import Iterator
from dataclasses import fields
from inspect import getsource
from pathlib import Path
from typing import get_args

from pydantic import BaseModel

from dlolib.execute import ExecutionResult
from dlolib.execute.laboratory import LawOutcome
from dlolib.formats.capture import CaptureModel
from dlolib.formats.layout import LayoutModel
from dlolib.formats.recording import COVARIANCES, FORM, RecordingModel
from dlolib.identify import summary
from dlolib.learn.write import result, write_learned
from dlolib.obstacles import SHAPES
from dlolib.types import Verdict

PAGE = Path("docs/formats.md").read_text(encoding="utf-8")
FENCED = r"```json\n(.*?)```"
SPANS = re.findall(r"`([^`]+)`", re.sub(FENCED, "", PAGE, flags=re.DOTALL))
NAMED = set(re.findall(r"\w+", " ".join(SPANS)))


def keys(model: type[BaseModel]) -> Iterator[str]:
    """Of a model and of those that it holds."""
    for name, field in model.model_fields.items():
        yield name
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from keys(part)


def test_every_key_that_is_read_is_named() -> None:
    read = {key for model in (RecordingModel, CaptureModel, LayoutModel) for key in keys(model)}
    assert {"length_m", "correlation_frames", "world_from_camera", "position_m"} <= read
    shapes = {*SHAPES, *(value for values in SHAPES.values() for value in values)}
    assert read | shapes | set(COVARIANCES) | {"format"} <= NAMED


def test_every_key_of_a_verdict_is_named() -> None:
    assert {field.name for field in fields(Verdict)} <= NAMED


def test_every_key_of_a_result_is_named() -> None:
    learned = getsource(result) + getsource(write_learned)
    written = set(re.findall(r'"(\w+)": ', learned)) | set(re.findall(r'"(\w+)\.\w+"', learned))
    written |= set(re.findall(r'"(\w+)": ', getsource(summary).split("paper_method")[0]))
    written |= {field.name for kind in (ExecutionResult, LawOutcome) for field in fields(kind)}
    assert {"free_of_contact", "ablation", "rmse_each_m", "of_another", "rod_error_m"} <= written
    assert written <= NAMED


def test_the_recording_to_copy_is_one() -> None:
    (example,) = re.findall(FENCED, PAGE, re.DOTALL)
    content = json.loads(example)
    assert content["format"] == FORM
    assert set(content) - {"format"} <= set(RecordingModel.model_fields)
    assert set(content["object"]) <= set(keys(RecordingModel))
    assert RecordingModel.model_validate(content).static_frames == (0, 29)
