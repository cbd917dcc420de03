"""When simulation and recording differ: locate it, name it, model it, show it."""

from dlolib.diagnose.diagnose import Diagnosis, diagnose
from dlolib.diagnose.study import DiagnoseSettings
from dlolib.diagnose.write import write_diagnosis

__all__ = ["DiagnoseSettings", "Diagnosis", "diagnose", "write_diagnosis"]
