"""Segmented clouds of a real rope, which no pipeline carries (no licence): reports/clouds.json.

`make clouds DATA=DIR COUNT=300`, DIR holding the capture `rope_clouds`: the chain of each of its frames
beside the nodes that others found (`reference_nodes.csv`); then as many clouds made of these by laying the
rope out anew, so that it crosses itself (`stages.cloud_layouts`).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from dlolib.captures import Frame, open_capture
from dlolib.chain import ChainSettings, FrameChain, chain_frame
from dlolib.errors import ChainError
from dlolib.files import write_json
from dlolib.params import Chain, load_block
from dlolib.progress import track
from dlolib.types import CaptureIndex, Floats
from stages import REPORTS, number, run
from stages.chain_score import Score, score
from stages.cloud_layouts import Layout, Strip, laid_out, strip_of
from stages.proof import made_by

SEED = 20261130
LENGTH_M, RMS_M = (0.93, 1.03), 0.006
ORDERED = 0.98


def main(data: str, count: str) -> None:
    source, settings = (
        open_capture(Path(data) / "rope_clouds"),
        ChainSettings(**load_block(Chain).model_dump()),
    )
    nodes = pd.read_csv(Path(data) / "rope_clouds" / "reference_nodes.csv")
    frames = list(source.frames())
    chains = [chain_frame(frame, source.index, settings) for frame in frames]
    real = [_beside(chain, nodes[nodes["frame"] == chain.frame]) for chain in chains]
    strips = [
        strip_of(frame.cloud_m, _camera(chain.line_m, source.index))
        for frame, chain in zip(frames, chains, strict=True)
        if frame.cloud_m is not None
    ]
    again = laid_anew(strips, source.index, settings, number(count, "COUNT", 1))
    write_json(
        REPORTS / "clouds.json", made_by(f"make clouds DATA=DIR COUNT={count}") | {"real": real} | again
    )
    for row in real:
        print(
            f"frame {row['frame']}: {row['length_m']:.3f} m, {1e3 * row['rms_m']:.1f} mm from the reference"
        )
    print(_line(again))


def laid_anew(
    strips: Sequence[Strip], index: CaptureIndex, settings: ChainSettings, count: int
) -> dict[str, Any]:
    """The chains of so many clouds that cross themselves, beside the lines that they were laid along."""
    scores: dict[int, Score | None] = {}
    for made in track(range(count), "clouds laid out anew"):
        layout = laid_out(strips[made % len(strips)], np.random.default_rng([SEED, made]))
        scores[made] = _score(layout, index, settings, made)
    found = [one for one in scores.values() if one is not None]
    return {
        "laid_anew": count,
        "refused": count - len(found),
        "ordered": sum(one.ordered for one in found),
        "out_of_order": [made for made, one in scores.items() if one is None or not one.ordered],
        "off_rms_m": _rms([one.off_m for one in found if one.ordered]),
        "arc_rms_m": _rms([one.arc_m for one in found if one.ordered]),
        "goal_ordered": ORDERED,
    }


def _score(layout: Layout, index: CaptureIndex, settings: ChainSettings, made: int) -> Score | None:
    """The better of both directions, since no end is held; None where no rope was found."""
    line = layout.line_m
    s_m = np.r_[0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    index = replace(
        index,
        rope=replace(index.rope, length_m=float(s_m[-1])),
        camera=replace(index.camera, world_from_camera=np.eye(4)),
    )
    try:
        chain = chain_frame(Frame(made, 0.0, Path(f"cloud {made}"), cloud_m=layout.cloud_m), index, settings)
    except ChainError:
        return None
    # what of it is hidden does not count here
    ways = ((s_m, line), (s_m[-1] - s_m[::-1], line[::-1]))
    both = [score(chain, s, way, np.ones(len(s), bool), settings.points) for s, way in ways]
    return min(both, key=lambda one: _rms([one.arc_m]))


def _beside(chain: FrameChain, nodes: pd.DataFrame) -> dict[str, Any]:
    """Length of a real rope's chain, and how far it runs from the nodes that others found."""
    line = np.concatenate([np.linspace(a, b, 50) for a, b in zip(chain.xyz_m, chain.xyz_m[1:], strict=False)])
    apart = np.asarray(cKDTree(line).query(nodes[["x_m", "y_m", "z_m"]].to_numpy())[0])
    length = float(np.linalg.norm(np.diff(chain.xyz_m, axis=0), axis=1).sum())
    return {
        "frame": int(chain.frame),
        "length_m": length,
        "rms_m": _rms([apart]),
        "met": bool(LENGTH_M[0] <= length <= LENGTH_M[1] and _rms([apart]) <= RMS_M),
    }


def _camera(points_m: Floats, index: CaptureIndex) -> Floats:
    pose = index.camera.world_from_camera
    return np.asarray((points_m - pose[:3, 3]) @ pose[:3, :3])


def _rms(values: Sequence[Floats]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2))) if len(values) else float("nan")


def _line(again: dict[str, Any]) -> str:
    ordered, count = again["ordered"], again["laid_anew"]
    return (
        f"laid out anew: {ordered} of {count} in order ({ordered / count:.1%}, goal {ORDERED:.0%}); of these "
        f"{1e3 * again['off_rms_m']:.1f} mm off the line, {1e3 * again['arc_rms_m']:.1f} mm in arc length; "
        f"refused {again['refused']}; not in order {again['out_of_order'] or 'none'}"
    )


if __name__ == "__main__":
    run(main, *sys.argv[1:])
