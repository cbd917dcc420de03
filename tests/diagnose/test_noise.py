"""The noise's model: exact whitening, and its three numbers found again."""

from dataclasses import replace

import numpy as np
import pytest
from sim.test_recording import recording

from dlolib.diagnose.diagnose import raw_study
from dlolib.diagnose.noise import known_noise, noise_left
from dlolib.diagnose.study import DiagnoseSettings
from dlolib.diagnose.whitening import Whitener, grid_of, lasting
from dlolib.errors import ParameterError
from dlolib.types import Floats, Motion, Noise, Points, Recording

SIGMA = 1.5e-3


def noisy(noise: Noise, frames: int = 30, columns: int = 20, lost: float = 0.0) -> tuple[Recording, Floats]:
    """A rope that stands still, and the noise (P, 3) on its points."""
    rng = np.random.default_rng(5)
    root_t, root_s = (
        np.linalg.cholesky(decay(count, length))
        for count, length in ((frames, noise.correlation_frames), (columns, noise.correlation_points))
    )
    drawn = noise.sigma_m * np.einsum("fg,cd,gdk->fck", root_t, root_s, rng.normal(size=(frames, columns, 3)))
    keep = rng.random(frames * columns) >= lost
    frame, s = (
        np.repeat(np.arange(frames), columns)[keep],
        np.tile(np.linspace(0, 0.44, columns), frames)[keep],
    )
    points = Points(frame, 0.1 * frame, s, drawn.reshape(-1, 3)[keep])
    made = recording()
    standing = Motion(
        made.motion.t_s,
        *(np.tile(part[0], (len(made.motion.t_s), 1)) for part in (
            made.motion.start_m, made.motion.start_q, made.motion.end_m, made.motion.end_q,
        )),
    )  # fmt: skip
    still = replace(made, motion=standing, points=points, static_frames=(0, frames - 1))
    return still, points.xyz_m


def decay(count: int, length: float) -> Floats:
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return np.exp(-lag / length) if length > 0 else np.eye(count)


@pytest.mark.parametrize("lost", [0.0, 0.15])
def test_whitening_is_exact(lost: float) -> None:
    """Sums of squares are those of the dense inverse covariance of the points that were seen."""
    noise = Noise(SIGMA, 1.2, 0.8)
    made, values = noisy(noise, 8, 7, lost)
    used = np.ones(len(values), dtype=bool)
    grid = grid_of(made, used)
    lags = [np.abs(np.subtract.outer(places, places)) for places in (grid.frame[grid.row], grid.column)]
    dense = SIGMA**2 * np.exp(-lags[0] / 0.8 - lags[1] / 1.2)
    expected = np.einsum("pk,pq,qk->", values, np.linalg.inv(dense), values)
    assert np.sum(Whitener(grid, noise)(values) ** 2) == pytest.approx(expected, rel=1e-10)


def test_of_points_that_are_hardly_apart_each_counts() -> None:
    noise = Noise(SIGMA, 0.0, 0.0)
    made, values = noisy(noise, 8, 7, 0.0)
    s_m = made.points.s_m.copy()
    s_m[1::7] = s_m[0::7] + 1e-7 * made.rope.length_m
    seen = replace(made, points=replace(made.points, s_m=s_m))
    grid = grid_of(seen, np.ones(len(values), dtype=bool))
    assert np.sum(Whitener(grid, noise)(values) ** 2) == pytest.approx(np.sum(values**2) / SIGMA**2)


def test_a_points_own_covariance_counts() -> None:
    noise = Noise(SIGMA, 0.0, 0.0)
    made, values = noisy(noise, 4, 5)
    covariance = np.tile(np.diag([1e-6, 4e-6, 9e-6]), (len(values), 1, 1))
    grid = grid_of(made, np.ones(len(values), dtype=bool))
    white = Whitener(grid, noise, covariance)(values)
    assert np.sum(white**2) == pytest.approx(np.sum(values**2 / [1e-6, 4e-6, 9e-6]), rel=1e-10)


@pytest.mark.parametrize("planar", [None, "xz"])
def test_what_lasts_in_a_named_camera_is_whitened_too(planar: str | None) -> None:
    """Exact likewise, and what frames alone would average away is not surer than one point."""
    noise = Noise(SIGMA, 1.2, 0.8)
    made, values = noisy(noise, 8, 7, 0.15)
    seen = replace(made, world_from_camera=np.eye(4), noise=noise, planar=planar)
    used = np.ones(len(values), dtype=bool)
    grid = grid_of(seen, used)
    assert lasting(made, used, grid, None) is lasting(replace(seen, noise=None), used, grid, None) is None
    errors = lasting(seen, used, grid, None)
    assert errors is not None
    values = values[:, [0, 2]] if planar else values
    lags = [np.abs(np.subtract.outer(places, places)) for places in (grid.frame[grid.row], grid.column)]
    axes = np.eye(values.shape[1])
    dense = np.kron(SIGMA**2 * np.exp(-lags[0] / 0.8 - lags[1] / 1.2), axes)
    flat = errors.reshape(values.size, -1)
    always = np.kron(SIGMA**2 * np.exp(-lags[1] / 1.2), axes)
    assert np.all(np.diag(flat @ flat.T - always) > SIGMA**2 - 1e-12)
    expected = values.ravel() @ np.linalg.inv(dense + flat @ flat.T) @ values.ravel()
    whitener = Whitener(grid, noise, None, errors)
    assert np.sum(whitener(values) ** 2) == pytest.approx(expected, rel=1e-10)
    assert np.sum(whitener(np.full(values.shape, SIGMA)) ** 2) < values.shape[1]


@pytest.mark.parametrize(("points", "frames"), [(0.0, 0.0), (0.7, 0.7), (1.5, 1.5)])
def test_numbers_are_found_again(points: float, frames: float) -> None:
    made, _ = noisy(Noise(SIGMA, points, frames), lost=0.05)
    known = known_noise(made)
    assert known is not None
    found, source, _ = known
    assert source == "frames 0 to 29, which stand still"
    assert found.sigma_m == pytest.approx(SIGMA, rel=0.08)
    for value, true in ((found.correlation_points, points), (found.correlation_frames, frames)):
        # correlation of neighbours, which is what matters
        assert np.exp(-1 / max(value, 1e-9)) == pytest.approx(np.exp(-1 / max(true, 1e-9)), abs=0.08)


def test_without_static_frames_the_quick_part_tells() -> None:
    made, values = noisy(Noise(SIGMA, 0.7, 0.7))
    wave = 0.02 * np.sin(made.points.t_s)[:, None] * made.points.s_m[:, None]
    moving = replace(made, motion=recording().motion, static_frames=None)
    assert known_noise(moving) is None
    found, source, _ = noise_left(moving, values + wave)
    assert source == "quick part of the residuals"
    assert found.sigma_m == pytest.approx(SIGMA, rel=0.1)


def test_frames_in_which_an_end_moves_do_not_stand_still() -> None:
    """What moves there would pass for noise, beside which nothing shows."""
    made, _ = noisy(Noise(SIGMA, 0.0, 0.0))
    with pytest.raises(ParameterError, match="made: the end moves by 55 mm .* in frames 0 to 29") as refused:
        known_noise(replace(made, motion=recording().motion))
    assert refused.value.place == "static_frames"


@pytest.mark.parametrize(
    ("given", "holds"), [(SIGMA / 15, False), (SIGMA / 1.9, False), (SIGMA / 1.3, True), (3 * SIGMA, True)]
)
def test_a_given_deviation_holds_unless_points_at_rest_scatter_more(given: float, holds: bool) -> None:
    made, _ = noisy(Noise(SIGMA, 0.0, 0.0))
    known = known_noise(replace(made, position_noise_m=given))
    assert known is not None
    noise, source, _ = known
    assert noise.sigma_m == pytest.approx(given if holds else SIGMA, rel=0.08)
    assert "position_noise_m" in source and ("scatter" in source) is not holds


@pytest.mark.parametrize(("given", "holds"), [(SIGMA / 3, False), (SIGMA / 1.2, True), (2 * SIGMA, True)])
def test_given_covariances_and_noise_hold_unless_points_at_rest_scatter_more(
    given: float, holds: bool
) -> None:
    """A tracker that is too sure of itself makes all that it sees physics."""
    made, _ = noisy(Noise(SIGMA, 0.0, 0.0))
    covariance = np.tile(given**2 * np.eye(3), (len(made.points.s_m), 1, 1))
    sure = replace(made, points=replace(made.points, covariance_m2=covariance))
    told = known_noise(sure)
    assert told is not None
    assert told.wider == pytest.approx(1.0 if holds else SIGMA / given, rel=0.08)
    assert ("times as much as points.csv: the covariances" in told.whence) is not holds
    raw = raw_study([sure], DiagnoseSettings(), [told.wider])
    roots = raw.seen[0].whitener.covariance_m2
    assert roots is not None
    assert np.sqrt(roots[0, 0, 0]) == pytest.approx(given if holds else SIGMA, rel=0.08)
    known = known_noise(replace(made, noise=Noise(given, 0.0, 0.0)))
    assert known is not None
    assert known.noise.sigma_m == pytest.approx(given if holds else SIGMA, rel=0.08) and known.wider == 1.0


def test_points_that_say_the_same_again_tell_no_noise() -> None:
    """Simulated ones, or those of a tracker that waits for a motion: the residuals tell it then."""
    still, _ = noisy(Noise(SIGMA, 0.0, 0.0))
    first = still.points.xyz_m[:20]
    same = replace(still, points=replace(still.points, xyz_m=np.tile(first, (30, 1))))
    assert known_noise(still) is not None and known_noise(same) is None
    noise, _, _ = noise_left(same, np.zeros_like(same.points.xyz_m))
    assert noise.sigma_m == pytest.approx(1e-6)


@pytest.mark.parametrize("lost", [0.0, 0.1])
@pytest.mark.parametrize("aside_m", [0.0, 2e-3, 5e-3])
def test_still_frames_tell_the_noise_wherever_along_the_rope_each_sees_it(
    aside_m: float, lost: float
) -> None:
    """A tracker without markers: every frame has places of its own, and lacks some."""
    made, values = noisy(Noise(SIGMA, 0.0, 0.0), 20, 30, lost)
    rng, points = np.random.default_rng(2), made.points
    s_m = np.clip(points.s_m + rng.uniform(-aside_m, aside_m, len(values)), 0.0, 0.445)
    arc = np.stack([0.15 * np.sin(s_m / 0.15), 0 * s_m, 0.15 * np.cos(s_m / 0.15)], axis=1)
    found = known_noise(replace(made, points=replace(points, s_m=s_m, xyz_m=values + arc)))
    assert found is not None
    assert found[0].sigma_m == pytest.approx(SIGMA, rel=0.06)
    assert max(found[0].correlation_points, found[0].correlation_frames) < 0.4


def test_still_frames_that_see_no_place_twice_tell_nothing() -> None:
    made, values = noisy(Noise(SIGMA, 0.0, 0.0), 3, 2)
    points = replace(made.points, s_m=np.linspace(0.05, 0.4, len(values)))
    assert known_noise(replace(made, points=points)) is None
