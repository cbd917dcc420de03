"""What a fit takes from the slow modes, and that noise is as likely after a fit as it should be."""

import numpy as np
import pytest
from scipy.fft import idctn
from scipy.stats import kstest

from dlolib.diagnose import residuals
from dlolib.diagnose.fitting import covariance_of
from dlolib.diagnose.modes import SLOWER, taken
from dlolib.diagnose.whitening import MODES, ModesOfNoise

SHAPE, RECORDINGS, OWN = (4, 8, 3), 5, 6
NOISE = ModesOfNoise(32, np.einsum("fg,pq->fpgq", np.eye(4), np.eye(8)))


def smooth(rng: np.random.Generator, count: int) -> np.ndarray:
    """What so many parameters do to a recording's points: slow waves, (F P A, N)."""
    modes = np.zeros((*SHAPE, count))
    modes[:2, :4] = rng.standard_normal((2, 4, 3, count))
    return idctn(modes, axes=(0, 1), norm="ortho").reshape(-1, count)


def several(prior: float) -> np.ndarray:
    """The Jacobian of recordings that share two parameters and have some of their own, which priors hold."""
    rng, size = np.random.default_rng(4), int(np.prod(SHAPE))
    rows = np.zeros((RECORDINGS * size + RECORDINGS * OWN, 2 + RECORDINGS * OWN))
    for k in range(RECORDINGS):
        rows[k * size : (k + 1) * size, :2] = smooth(rng, 2)
        rows[k * size : (k + 1) * size, 2 + k * OWN : 2 + (k + 1) * OWN] = smooth(rng, OWN)
    rows[RECORDINGS * size :, 2:] = prior * np.eye(RECORDINGS * OWN)
    return rows


def test_a_fit_takes_a_degree_of_freedom_for_each_parameter_that_is_slow_and_free() -> None:
    free, held = (several(prior) for prior in (1e-6, 1e6))
    for jacobian, count in ((free, 2 + RECORDINGS * OWN), (held, 2)):
        found = taken(jacobian, covariance_of(jacobian), [SHAPE] * RECORDINGS)
        assert set(found) == set(SLOWER)
        assert found[MODES] == pytest.approx(count, abs=1e-3)
        assert 0 < found[2] < found[MODES]


def test_a_parameter_that_moves_nothing_takes_nothing() -> None:
    jacobian = np.hstack([several(1e-6), np.zeros((len(several(1.0)), 1))])
    found = taken(jacobian, covariance_of(jacobian), [SHAPE] * RECORDINGS)
    assert found[MODES] == pytest.approx(2 + RECORDINGS * OWN, abs=1e-3)


@pytest.mark.parametrize("prior", [1e-3, 1.0, 30.0])
def test_noise_is_as_likely_after_a_fit_with_priors_as_it_should_be(prior: float) -> None:
    """Small recordings with nuisances of their own: counted as whole parameters they left no slow modes."""
    jacobian, rng = several(prior), np.random.default_rng(7)
    covariance, size = covariance_of(jacobian), int(np.prod(SHAPE))
    own = taken(jacobian, covariance, [SHAPE] * RECORDINGS)[MODES]
    likely = []
    for _ in range(300):
        noise = rng.standard_normal(len(jacobian))
        left = noise - jacobian @ (covariance @ (jacobian.T @ noise))
        grids = [left[k * size : (k + 1) * size].reshape(SHAPE) for k in range(RECORDINGS)]
        likely.append(residuals.tested(grids, [NOISE] * RECORDINGS, own).p_value)
    assert kstest(likely, "uniform").pvalue > 1e-3
