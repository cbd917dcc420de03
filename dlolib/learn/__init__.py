"""From a goal shape to a trajectory: Section V.B of the paper."""

from dlolib.learn.learn import Learned, ablate, learn
from dlolib.learn.settings import LearnSettings
from dlolib.learn.write import read_policy, write_learned

__all__ = ["LearnSettings", "Learned", "ablate", "learn", "read_policy", "write_learned"]
