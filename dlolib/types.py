"""What crosses from one stage to the next: frozen dataclasses of NumPy arrays in SI units.

Quaternions are (w, x, y, z). The third material axis of a frame is the rope's tangent, from start to
end. Positions of a free end are NaN in a `Motion`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
EndKind = Literal["clamped", "free"]


@dataclass(frozen=True)
class Rope:
    """The object of a recording: lengths in m, density in kg/m, mass in kg; None where not measured."""

    name: str
    length_m: float
    diameter_m: float | None = None
    linear_density_kg_m: float | None = None
    tip_mass_kg: float = 0.0

    @property
    def radius_m(self) -> float:
        """Half the diameter [m]; 0 where the diameter is not known."""
        return 0.0 if self.diameter_m is None else self.diameter_m / 2


@dataclass(frozen=True)
class Ends:
    """How the two ends are held, and whether the recorded roll of each is to be believed."""

    start: EndKind = "clamped"
    end: EndKind = "clamped"
    start_roll_known: bool = True
    end_roll_known: bool = True


@dataclass(frozen=True)
class Obstacle:
    """One obstacle: a shape of `dlolib.obstacles.SHAPES` and its values by name (m, unit vectors)."""

    shape: str
    values: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Pose:
    """Position [m], shape (3,), and unit quaternion, shape (4,)."""

    position_m: Floats
    quaternion: Floats


@dataclass(frozen=True)
class Motion:
    """Poses of the held ends over time: the rows of `motion.csv`.

    t_s (T,), positions [m] (T, 3), quaternions (T, 4) as stored: neighbours may differ in sign, which
    tells which way round an end turned. All-NaN for a free end.
    """

    t_s: Floats
    start_m: Floats
    start_q: Floats
    end_m: Floats
    end_q: Floats


@dataclass(frozen=True)
class Points:
    """Observed points, one row each: the rows of `points.csv`, ordered by frame, then arc length.

    frame (P,), t_s (P,), s_m (P,), xyz_m (P, 3), covariance_m2 (P, 3, 3) or None.
    """

    frame: Ints
    t_s: Floats
    s_m: Floats
    xyz_m: Floats
    covariance_m2: Floats | None = None


@dataclass(frozen=True)
class Noise:
    """Deviation of a point [m] and its correlation lengths in points and frames: exp(-lag / value)."""

    sigma_m: float
    correlation_points: float
    correlation_frames: float


@dataclass(frozen=True)
class Recording:
    """What was observed of the rope, and how its ends moved (format "dlo-recording/1")."""

    name: str
    rope: Rope
    gravity_m_s2: Floats
    ends: Ends
    motion: Motion
    points: Points
    obstacles: tuple[Obstacle, ...] = ()
    source: str = ""
    note: str = ""
    quasi_static: bool = True
    position_noise_m: float | None = None
    noise: Noise | None = None
    world_from_camera: Floats | None = None
    static_frames: tuple[int, int] | None = None
    heldout_frames: tuple[int, int] | None = None
    rate_hz: float | None = None
    planar: Literal["xz"] | None = None


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: pixels, focal lengths and centre in pixels, depth units per metre.

    world_from_camera (4, 4) turns camera axes (x right, y down, z forward) into the world's. The sizes
    are None for a capture of point clouds.
    """

    world_from_camera: Floats
    width: int | None = None
    height: int | None = None
    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None
    depth_scale: float | None = None


@dataclass(frozen=True)
class CaptureIndex:
    """What a capture's folder says, images and clouds still unread (format "dlo-capture/1").

    frame (F,), t_s (F,) [s]; color, depth, mask and cloud are one path a frame, or None where the
    capture has no such column: either color and depth are there, or cloud. motion is None where both
    ends are free and it was not recorded. rope_color_hsv is [low, high] in OpenCV's HSV, a low
    hue above the high one passing through red.
    """

    name: str
    folder: Path
    rope: Rope
    gravity_m_s2: Floats
    ends: Ends
    camera: Camera
    frame: Ints
    t_s: Floats
    color: tuple[Path, ...] | None = None
    depth: tuple[Path, ...] | None = None
    cloud: tuple[Path, ...] | None = None
    mask: tuple[Path, ...] | None = None
    motion: Motion | None = None
    obstacles: tuple[Obstacle, ...] = ()
    rope_color_hsv: tuple[tuple[int, int, int], tuple[int, int, int]] | None = None
    background_color: Path | None = None
    background_depth: Path | None = None
    source: str = ""
    note: str = ""
    quasi_static: bool = True
    rate_hz: float | None = None
    static_frames: tuple[int, int] | None = None
    heldout_frames: tuple[int, int] | None = None


@dataclass(frozen=True)
class Layout:
    """What is to be learned (format "dlo-layout/1"): goal points (G, 3) at arc lengths (G,)."""

    name: str
    rope: Rope
    gravity_m_s2: Floats
    ends: Ends
    obstacles: tuple[Obstacle, ...]
    start: Pose
    grasp: Pose
    goal_s_m: Floats
    goal_m: Floats


PER_DENSITY = " per kg/m"


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval (None where unbounded) and unit.

    The unit of a force or a mass ends with `PER_DENSITY` where the rope's density is not known: so much for
    each kg/m that it has.
    """

    value: float
    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True)
class Fit:
    """What identification found (format "dlo-fit/1"), and of which rope, where that is told."""

    parameters: Mapping[str, Estimate]
    rmse_m: float
    frames: int
    points: int
    nuisances: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    rope: Rope | None = None


@dataclass(frozen=True)
class Quality:
    """How a model fits: its parameters, the RMS distances [m], and the test of its slow residuals."""

    parameters: Mapping[str, Estimate]
    rmse_m: float
    heldout_rmse_m: float | None
    statistic: float
    p_value: float


@dataclass(frozen=True)
class Place:
    """A stretch of rope, and of frames, of a recording in which the models differ from what was seen.

    force_n is what would have to act there beside an elastic rod; it is null where a moment would.
    """

    recording: str
    s_m: tuple[float, float]
    frames: tuple[int, int]
    phase: str
    strength: float
    probe: str
    needed: tuple[float, ...]
    unit: str


@dataclass(frozen=True)
class Named:
    """An effect of the winning model. where: {s_m, frames} or null."""

    name: str
    probability: float
    parameters: Mapping[str, Estimate]
    where: Mapping[str, tuple[float, float] | None] | None
    says: str


@dataclass(frozen=True)
class Candidate:
    """One model that was fitted."""

    effects: tuple[str, ...]
    kind: Literal["library", "wrong_same_size", "black_box"]
    delta_bic: float
    heldout_delta_chi2: float | None
    heldout_delta_chi2_se: float | None
    low_mode_energy: float
    rmse_m: float
    heldout_rmse_m: float | None


@dataclass(frozen=True)
class Detectable:
    """The smallest size of an effect that would have been seen; null: none would."""

    name: str
    parameter: str
    value: float | None
    unit: str


@dataclass(frozen=True)
class NextMotion:
    """A motion that would separate two models."""

    file: str
    why: str
    separates: tuple[tuple[str, ...], tuple[str, ...]]
    expected_delta_bic: float


@dataclass(frozen=True)
class SeenNoise:
    """The noise that the diagnosis reckons with, and where it comes from."""

    sigma_m: float
    correlation_points: float
    correlation_frames: float
    source: str


@dataclass(frozen=True)
class Verdict:
    """What a diagnosis says (format "dlo-verdict/1")."""

    summary: str
    recordings: tuple[str, ...]
    status: Literal["no_mismatch", "explained", "ambiguous", "unexplained"]
    noise: SeenNoise
    baseline: Quality
    nuisances: Mapping[str, Mapping[str, Estimate]]
    where: tuple[Place, ...]
    effects: tuple[Named, ...]
    candidates: tuple[Candidate, ...]
    equivalent: tuple[tuple[str, ...], ...]
    augmented: Quality
    detectable: tuple[Detectable, ...]
    next_motion: NextMotion | None = None
    rope: Rope | None = None

    @property
    def fit(self) -> Fit:
        """What simulate, identify and learn take: the model with the named effects; where none is named, not
        the best of those that do not explain it either, but the elastic rod."""
        best = self.augmented if self.effects else self.baseline
        return Fit(best.parameters, best.rmse_m, 0, 0, self.nuisances, self.rope)
