"""Where compiled kernels are kept, and what they may depend on."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys

import pytest

from dlolib.sim import runtime

SOURCES = sorted(runtime.SOURCES.rglob("*.py"))


def test_a_changed_constant_gives_another_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    kept = runtime._cache()["offline_cache_file_path"]
    assert runtime._cache()["offline_cache_file_path"] == kept
    copy = tmp_path / "sim"
    shutil.copytree(runtime.SOURCES, copy)
    monkeypatch.setattr(runtime, "SOURCES", copy)
    assert runtime._cache()["offline_cache_file_path"] == kept
    scene = copy / "scene.py"
    scene.write_text(scene.read_text().replace("SAMPLES = 4", "SAMPLES = 5"))
    assert runtime._cache()["offline_cache_file_path"] != kept


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(runtime.SOURCES)))
def test_kernels_take_constants_from_the_simulator_alone(path):
    tree = ast.parse(path.read_text())
    taken = {
        alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and not node.module.startswith("dlolib.sim")
        for alias in node.names
    }
    compiled = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and _compiled(node)]
    used = {name.id for node in compiled for name in ast.walk(node) if isinstance(name, ast.Name)}
    assert not taken & used


def _compiled(function):
    named = {node.attr if isinstance(node, ast.Attribute) else node.id for node in function.decorator_list}
    return named & {"func", "real_func", "kernel"}


def test_without_a_place_for_them_they_are_compiled_all_the_same():
    # no folder can be made there, not by root either
    env = {**os.environ, "XDG_CACHE_HOME": "/proc/nothing"}
    code = """
import numpy as np
from dlolib.sim.clearance import nearest
from dlolib.types import Obstacle
ball = Obstacle("sphere", {"center_m": (0.0, 0.0, 0.0), "radius_m": (0.1,)})
print(nearest(np.array([[0.3, 0.0, 0.0]]), [ball]).distance_m.round(9))
"""
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[0.2]\n", "")


def test_it_says_nothing_on_standard_output():
    done = subprocess.run(
        [sys.executable, "-c", "import dlolib.sim.runtime"], capture_output=True, text=True, check=True
    )
    assert done.stdout == "" and done.stderr == ""
