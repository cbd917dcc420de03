"""The pydantic mirror of params.yaml: the only place where the pipeline's YAML meets Python.

Bounds and units stand here; defaults stand in params.yaml. A stage reads its own block and no other
(`load_block`), so that what it cannot see it cannot depend on.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from dlolib.errors import ParameterError

PARAMS = Path("params.yaml")

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]
Seed = Annotated[int, Field(ge=0)]
# A path below a folder, without a way out of it.
PART = r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*"
Inside = Annotated[str, Field(pattern=rf"^{PART}(/{PART})*$")]
# An effect is a file of its own; to import them would load the simulator.
EFFECTS = tuple(
    sorted(
        file.stem
        for file in (Path(__file__).parent / "sim" / "effects").glob("*.py")
        if file.stem not in ("__init__", "base")
    )
)
# What `dlolib.identify` may fit.
FITTED = (
    "bending_stiffness",
    "torsional_stiffness",
    *(f"end_angle.{part}" for part in ("start_1", "start_2", "end_1", "end_2")),
    *(f"rest_curvature.{part}" for part in ("kappa_1", "kappa_2")),
    "lateral_load.x",
    "end_twist.end",
)
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]


class Block(BaseModel):
    """A block of params.yaml: frozen, no unknown keys, no NaN, no text for numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Rod(Block):
    """The simulated rod that identify and learn share."""

    particles: Annotated[int, Field(ge=3, le=1000)]
    longest_segment_m: Positive
    time_step_s: Annotated[float, Field(gt=0, le=0.1)]
    solver: Literal["direct", "iterative"]
    sweeps: Count


class LabRope(Block):
    """The laboratory's rope: `dlolib.lab.rope.LabRope`."""

    length_m: Annotated[float, Field(gt=0, le=5)]
    diameter_m: Annotated[float, Field(gt=0, le=0.1)]
    linear_density_kg_m: Annotated[float, Field(gt=0, le=5)]
    bending_stiffness_n_m2: Annotated[float, Field(gt=0, le=10)]
    law: Literal["plastic", "elastic"]
    yield_curvature_1_m: Positive
    hardening_ratio: Share
    bodies: Annotated[int, Field(ge=3, le=500)]
    friction: NotNegative
    drag_1_s: NotNegative


class LabSensor(Block):
    """The laboratory's camera: `dlolib.lab.camera.Sensor`."""

    noise_m: Annotated[float, Field(ge=0, le=0.1)]
    edge_loss: Share
    bias_m: Annotated[float, Field(ge=0, le=0.1)]
    grain_px: Annotated[float, Field(ge=0, le=20)]
    seed: Seed


class Lab(Block):
    """The virtual laboratory: `dlolib.lab.record.Experiment`."""

    rope: LabRope
    sensor: LabSensor
    waypoints: Annotated[int, Field(ge=2)]
    waypoint_interval_s: Positive
    frame_every: Count

    @field_validator("frame_every")
    @classmethod
    def _frames(cls, value: int, others: ValidationInfo) -> int:
        if value > others.data.get("waypoints", value):
            raise ValueError("leaves no frame of so many waypoints")
        return value


class Ingest(Block):
    """Where the capture comes from: `lab`, or a folder under data/, and what in it is what.

    All lies in that one folder, so that it is the stage's one dependency.
    """

    source: Name
    recording: Inside | None = None
    motion: Inside | None = None
    object: Inside | None = None
    topics: dict[Literal["color", "depth", "camera_info", "camera_pose", "motion"], str] = {}


class Chain(Block):
    """From depth images to an ordered chain: `dlolib.chain.ChainSettings`."""

    points: Annotated[int, Field(ge=3, le=1000)]
    segmentation: Literal["auto", "threshold", "local", "color", "background", "mask"]
    threshold: Annotated[int, Field(ge=1, le=254)] | None
    min_contrast: Annotated[float, Field(gt=0, le=255)]
    background_levels: Annotated[float, Field(gt=0, le=255)]
    background_depth_m: Annotated[float, Field(gt=0, lt=1)]
    edge_px: NotNegative
    smooth_m: Annotated[float, Field(gt=0, lt=1)]
    bridge_m: Annotated[float, Field(ge=0, lt=1)]
    min_seen: Annotated[float, Field(gt=0, le=1)]


class RecordingEntry(Block):
    """One recording that identify fits."""

    path: Annotated[str, Field(pattern=r"^[A-Za-z0-9_./-]+$")]


class PaperDescent(Block):
    """The paper's gradient descent: `dlolib.identify.DescentSettings`."""

    start: Positive
    rate: Positive
    iterations: Count


class Identify(Block):
    """From a recording to stiffnesses with intervals."""

    method: Literal["least_squares", "gradient_descent"]
    parameters: list[str] | None
    iterations: Count
    heldout_share: Annotated[float, Field(ge=0, lt=1)]
    paper_on: list[Name]
    paper: PaperDescent


class Diagnose(Block):
    """What physics is missing: `dlolib.diagnose.DiagnoseSettings`."""

    without: list[str]
    chance: Annotated[float, Field(gt=0, lt=1)]
    tie: NotNegative
    most_effects: Annotated[int, Field(ge=1, le=5)]
    starts: Count
    partners: Count
    full: bool
    workers: Count
    heldout_share: Annotated[float, Field(ge=0, lt=1)]
    most_frames: Count
    seed: Seed


class ArcBounds(Block):
    """The paper's Λ: bounds of one sub-trajectory's parameters."""

    phi_rad: Positive
    s: Positive
    theta_rad: Positive
    dx_m: Positive
    dz_m: Positive


class Ablation(Block):
    """Plain squared error against the contact loss: on which layout, from which initial weights."""

    layout: Name
    iterations: Count
    seeds: Annotated[list[Seed], Field(min_length=1)]


class Learn(Block):
    """From a goal shape to a trajectory."""

    verdict_of: Name
    iterations: Count
    rate: Positive
    forgetting: Annotated[float, Field(ge=0, lt=1)]
    contact_weight: NotNegative
    goal_weight: Positive
    steps: Count
    step_s: Positive
    segments: Count
    hidden: Annotated[list[Count], Field(min_length=2, max_length=2)]
    seed: Seed
    starts: Count
    first_arc: Annotated[float, Field(ge=0, lt=1)]
    near_goal_m: Positive
    caught_after: Count
    caught_m: Positive
    contact_margin_m: NotNegative
    contact_zone_m: NotNegative
    clearance_m: NotNegative
    goal_tolerance_m: Positive
    bounds: ArcBounds
    ablation: Ablation

    # As `dlolib.learn.LearnSettings`, which a stage that does not learn need not load.
    @field_validator("segments")
    @classmethod
    def _divides(cls, value: int, others: ValidationInfo) -> int:
        if others.data.get("steps", value) % value:
            raise ValueError("does not divide learn.steps")
        return value

    @field_validator("contact_zone_m")
    @classmethod
    def _beyond(cls, value: float, others: ValidationInfo) -> float:
        if not value > others.data.get("contact_margin_m", -1.0):
            raise ValueError("should be more than learn.contact_margin_m")
        return value

    @field_validator("clearance_m")
    @classmethod
    def _within(cls, value: float, others: ValidationInfo) -> float:
        if value > others.data.get("contact_margin_m", value):
            raise ValueError("should be learn.contact_margin_m or less")
        return value


class Execute(Block):
    """Who runs a trajectory: `lab` with these laws, or a folder of logs under data/."""

    source: Name
    laws: Annotated[list[Literal["elastic", "plastic"]], Field(min_length=1)]


class Params(Block):
    """All of params.yaml."""

    rod: Rod
    lab: Lab
    ingest: Ingest
    chain: Chain
    recordings: Annotated[dict[Name, RecordingEntry], Field(min_length=1)]
    identify: Identify
    diagnose: Diagnose
    layouts: Annotated[list[Name], Field(min_length=1)]
    learn: Learn
    execute: Execute


AnyBlock = TypeVar("AnyBlock", bound=Block)
Keys = tuple[str, ...]


def load(path: Path = PARAMS) -> Params:
    """Read and check the whole file.

    Raises:
        ParameterError: names file, line, key and mend.
    """
    params = _validated(Params, _read(path), path, ())
    identify, learn = params.identify, params.learn
    recordings = tuple(params.recordings)
    for given, valid, keys, where in (
        ([learn.verdict_of], recordings, ("learn", "verdict_of"), "recordings"),
        ([learn.ablation.layout], params.layouts, ("learn", "ablation", "layout"), "layouts"),
        (identify.paper_on, recordings, ("identify", "paper_on"), "recordings"),
        (identify.parameters or [], FITTED, ("identify", "parameters"), "what is fitted"),
        (params.diagnose.without, EFFECTS, ("diagnose", "without"), "the effects"),
    ):
        for name in given:
            if name not in valid:
                raise _unknown_name(name, valid, path, keys, where)
    return params


def ours(path: Path = PARAMS) -> bool:
    """Whether the file has any block of ours: other projects have a params.yaml, too.

    Raises:
        ParameterError: it is no YAML, or holds no blocks.
    """
    return not Params.model_fields.keys().isdisjoint(_read(path))


def load_block(block: type[AnyBlock], path: Path = PARAMS) -> AnyBlock:
    """Read one block, by its class (`Rod` is the block `rod`), without looking at the others.

    Raises:
        ParameterError: names file, line, key and mend.
    """
    name = block.__name__.lower()
    content = _read(path)
    if name not in content:
        raise ParameterError("this block is missing", file=path, place=name, mend=f"add a block `{name}:`")
    return _validated(block, content[name], path, (name,))


class _Twice(Exception):  # noqa: N818  (what happened, as the error that it becomes says it)
    """A key that stands twice in a block, with its line: YAML would silently take the last."""


class _Once(yaml.SafeLoader):
    """Reads YAML in which no key of a block stands twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if str(key.value) in seen:
                raise _Twice(f"line {key.start_mark.line + 1}, {key.value}")
            seen.add(str(key.value))
        return super().construct_mapping(node, deep)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = _Once(path.read_text(encoding="utf-8")).get_single_data()
    except FileNotFoundError:
        raise ParameterError("no such file", file=path, mend="run from the repository's root") from None
    except _Twice as error:
        raise ParameterError(
            "this key is given twice", file=path, place=str(error), mend="remove one"
        ) from error
    except (yaml.YAMLError, ValueError) as error:  # no text, or a date that no calendar has
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}" if mark else None
        raise ParameterError("is not valid YAML", file=path, place=place, mend="correct that line") from error
    if not isinstance(content, dict):
        raise ParameterError("holds no blocks", file=path, mend="write one block a stage")
    return content


def _validated(block: type[AnyBlock], content: Any, path: Path, above: Keys) -> AnyBlock:
    try:
        return block.model_validate(content)
    except ValidationError as error:
        raise _refusal(error, block, path, above) from error


def _refusal(error: ValidationError, block: type[Block], path: Path, above: Keys) -> ParameterError:
    """The first violation as one line; an unknown key first, since a missing one may be its misspelling."""
    found = sorted(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")[0]
    inside = tuple(str(part) for part in found["loc"] if part != "[key]")
    place = _place(path, above + inside)
    if found["type"] == "extra_forbidden":
        valid = _keys_at(block, inside[:-1])
        closest = difflib.get_close_matches(inside[-1], valid, n=1, cutoff=0.5)
        mend = f"did you mean `{closest[0]}`?" if closest else f"valid are {', '.join(valid)}"
        return ParameterError("unknown key", file=path, place=place, mend=mend)
    if found["type"] == "missing":
        return ParameterError("this key is missing", file=path, place=place, mend="add it")
    problem = found["msg"].removeprefix("Input ").removeprefix("Value error, ")
    given = f" (it is {found['input']!r})" if isinstance(found["input"], int | float | str) else ""
    number = isinstance(found["input"], str) and found["type"] in ("float_type", "int_type")
    mend = (
        "give a number without quotes, with a point before an exponent and a sign in it (1.0e-4, 1.0e+4)"
        if number
        else "correct the value"
    )
    return ParameterError(f"{problem}{given}", file=path, place=place, mend=mend)


def _keys_at(block: type[Block], keys: Keys) -> list[str]:
    """The valid keys of the block below these keys."""
    for key in keys:
        field = block.model_fields.get(key)
        if field is None:  # a name of the user's own, such as a recording's
            continue
        types = (field.annotation, *get_args(field.annotation))
        block = next((one for one in types if isinstance(one, type) and issubclass(one, Block)), block)
    return list(block.model_fields)


def _place(path: Path, keys: Keys) -> str:
    """`line 12, lab.length_m`: where in the file the key is, or the nearest one above it that is there."""
    node, line = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader), 0
    for key in keys:
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        below = next(((name, value) for name, value in pairs if name.value == key), None)
        if below is None:
            break
        line, node = below[0].start_mark.line + 1, below[1]
    return f"line {line}, {'.'.join(keys)}" if line else ".".join(keys)


def _unknown_name(name: str, valid: Sequence[str], path: Path, keys: Keys, where: str) -> ParameterError:
    closest = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    return ParameterError(
        f"`{name}` is not among {where} ({', '.join(valid)})",
        file=path,
        place=_place(path, keys),
        mend=f"did you mean `{closest[0]}`?" if closest else "name one of them",
    )
