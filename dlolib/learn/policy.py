"""The controller: three fully connected layers from the rope to an arc's parameters, (18) and Fig. 6."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import autograd.numpy as anp
import numpy as np

from dlolib.learn.arcs import PARAMETERS, TABLE_I_BOUNDS
from dlolib.types import Floats

# (weight, bias) of each layer; autograd differentiates through the nesting.
Weights = list[tuple[Floats, Floats]]


# The share s of AB at which the first arc has its centre.
MIDWAY = 0.5
# A centre that no bound reaches begins at this share of it.
NEARLY = 0.95


@dataclass(frozen=True)
class Policy:
    """A controller T_i = Λ tanh(...) of the rope's state and the parameters before.

    Attributes:
        weights: three (weight (in, out), bias (out,)).
        bounds: the paper's Λ, shape (5,).
        goal_m: the goal at the nodes' arc lengths [m], shape (N, 3).
        length_m: the rope's length, the unit in which the network sees the state.
    """

    weights: Weights
    bounds: Floats
    goal_m: Floats
    length_m: float

    def parameters(self, weights: Weights, positions_m: Floats, previous: Floats) -> Floats:
        """T_i = γ_i Λ, shape (..., 5), from the nodes (..., N, 3) and T_{i-1} (..., 5): (18).

        The network sees the way that each node still has to its goal, in units of the rope's length, and
        T_{i-1} / Λ: numbers of the order of one, as Xavier's initial values expect them.
        """
        rest = anp.reshape((positions_m - self.goal_m) / self.length_m, (*previous.shape[:-1], -1))
        signal = anp.concatenate((rest, previous / self.bounds), axis=-1)
        for weight, bias in weights:
            signal = anp.tanh(anp.dot(signal, weight) + bias)
        rates: Floats = signal * self.bounds
        return rates


def xavier(
    inputs: int,
    hidden: tuple[int, int],
    seed: int,
    first_arc: float = 0.0,
    furthest: float = TABLE_I_BOUNDS[1],
) -> Weights:
    """Initial weights for `inputs` numbers in and five out: Xavier's uniform ones, biases 0.

    Glorot and Bengio (2010), equation (16): uniform within ±sqrt(6 / (in + out)).
    `first_arc`, other than 0 and between -1 and 1, goes into the output's biases: about this rate of turn φ,
    and centres midway between A and B, so that the first path is an arc beside AB, on the side it says;
    `furthest` is how far a centre may lie from A, over the distance from A to B.
    """
    random = np.random.default_rng(seed)
    sizes = (inputs, *hidden, PARAMETERS)
    weights: Weights = []
    for before, after in pairwise(sizes):
        limit = np.sqrt(6.0 / (before + after))
        weights.append((random.uniform(-limit, limit, (before, after)), np.zeros(after)))
    if first_arc:
        weights[-1][1][:2] = np.arctanh((first_arc, min(MIDWAY / furthest, NEARLY)))
    return weights
