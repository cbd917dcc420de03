"""The cases of `make validation` and of tests/sim/test_validation.py: the rod against theory, one by one.

Each is settled by a formula or by a boundary-value problem that knows nothing of the rod.
"""

from stages.cases.friction import Capstan, capstan
from stages.cases.laws import Bending, Decay, creep, plastic, relaxation
from stages.cases.oscillation import Oscillation, oscillation
from stages.cases.shapes import Shapes, cantilever, catenary, elastica
from stages.cases.stability import Buckling, Standing, michell, standing

__all__ = [
    "Bending",
    "Buckling",
    "Capstan",
    "Decay",
    "Oscillation",
    "Shapes",
    "Standing",
    "cantilever",
    "capstan",
    "catenary",
    "creep",
    "elastica",
    "michell",
    "oscillation",
    "plastic",
    "relaxation",
    "standing",
]
