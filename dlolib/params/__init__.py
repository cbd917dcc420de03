"""The pydantic mirror of params.yaml: the only place where the pipeline's YAML meets Python.

A stage reads its own block and no other (`load_block`), so that what it cannot see it cannot depend on.
"""

from dlolib.params.blocks import (
    EFFECTS,
    FITTED,
    Block,
    Chain,
    Diagnose,
    Execute,
    Identify,
    Ingest,
    Lab,
    LabRope,
    LabSensor,
    Learn,
    PaperDescent,
    Params,
    Rod,
)
from dlolib.params.read import PARAMS, load, load_block, ours

__all__ = [
    "EFFECTS",
    "FITTED",
    "PARAMS",
    "Block",
    "Chain",
    "Diagnose",
    "Execute",
    "Identify",
    "Ingest",
    "Lab",
    "LabRope",
    "LabSensor",
    "Learn",
    "PaperDescent",
    "Params",
    "Rod",
    "load",
    "load_block",
    "ours",
]
