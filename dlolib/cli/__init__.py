"""The console script `dlo`: one command a stage, over the same functions as stages/.

Subpackages are imported inside the commands, so that `dlo --help` does not wait for Taichi or Open3D.
"""

from dlolib.cli.app import app, main, run

__all__ = ["app", "main", "run"]
