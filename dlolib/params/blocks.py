"""The blocks of params.yaml: their keys, bounds and units; defaults stand in the file itself.

What a block's stage is set with, `settings` says for stage and command alike.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator

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
        for file in (Path(__file__).parents[1] / "sim" / "effects").glob("*.py")
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


def _each_once(names: list[str]) -> list[str]:
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{twice} stands in it more than once")
    return names


class Block(BaseModel):
    """A block of params.yaml: frozen, no unknown keys, no NaN, no text for numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Rod(Block):
    """The simulated rod that identify and learn share."""

    particles: Annotated[int, Field(ge=4, le=1000)]
    longest_segment_m: Positive
    time_step_s: Annotated[float, Field(gt=0, le=0.1)]
    solver: Literal["direct", "iterative"]
    sweeps: Annotated[int, Field(ge=1, le=10_000)]

    def mesh(self) -> dict[str, Any]:
        """Of `dlolib.sim.mesh.Mesh`."""
        return self.model_dump(exclude={"solver", "sweeps"})

    @property
    def iterations(self) -> int | None:
        """Sweeps a step of the paper's solver; None for the direct one."""
        return self.sweeps if self.solver == "iterative" else None


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
    edge_px: Annotated[float, Field(ge=0, le=20)]
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
    """From a recording to stiffnesses with intervals: `dlolib.identify.IdentifySettings`."""

    method: Literal["least_squares", "gradient_descent"]
    parameters: Annotated[list[str], Field(min_length=1), AfterValidator(_each_once)] | None
    iterations: Count
    heldout_share: Annotated[float, Field(ge=0, lt=1)]
    paper_on: list[Name]
    paper: PaperDescent

    def settings(self, rod: Rod) -> dict[str, Any]:
        """Of identification with this rod."""
        own = self.model_dump(include={"iterations", "heldout_share"})
        fitted = None if self.parameters is None else tuple(self.parameters)
        return {**own, **rod.mesh(), "sweeps": rod.iterations, "parameters": fitted}


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

    def settings(self, rod: Rod) -> dict[str, Any]:
        """Of a diagnosis with this rod."""
        return {**self.model_dump(), **rod.mesh(), "without": tuple(self.without)}


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
    """From a goal shape to a trajectory: `dlolib.learn.LearnSettings`."""

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

    def settings(self) -> dict[str, Any]:
        """Of learning; how many particles, the rope's length says."""
        own = self.model_dump(exclude={"verdict_of", "ablation"})
        return {**own, "hidden": tuple(self.hidden), "bounds": tuple(own["bounds"].values())}

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
    laws: Annotated[list[Literal["elastic", "plastic"]], Field(min_length=1), AfterValidator(_each_once)]


class Params(Block):
    """All of params.yaml."""

    rod: Rod
    lab: Lab
    ingest: Ingest
    chain: Chain
    recordings: Annotated[dict[Name, RecordingEntry], Field(min_length=1)]
    identify: Identify
    diagnose: Diagnose
    layouts: Annotated[list[Name], Field(min_length=1), AfterValidator(_each_once)]
    learn: Learn
    execute: Execute
