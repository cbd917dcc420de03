"""From a goal shape to a trajectory that stays clear: reports/learn/<layout>."""

from __future__ import annotations

import sys
from dataclasses import replace

from dlolib.cli_values import rope_values
from dlolib.formats import read_layout, read_verdict
from dlolib.learn import LearnSettings, ablate, learn, write_learned
from dlolib.params import Learn, Rod, load_block
from dlolib.sim.rod import Rod as SimulatedRod
from dlolib.types import Layout
from stages import DATA, REPORTS, run, write_metrics


def main(name: str) -> None:
    block = load_block(Learn)
    layout = read_layout(DATA / "layouts" / name)
    rod = diagnosed_rod(layout, block.verdict_of)
    learned = learn(layout, rod, settings())
    ablation = None
    if block.ablation.layout == name:
        shorter = replace(settings(), iterations=block.ablation.iterations)
        ablation = ablate(layout, rod, shorter, block.ablation.seeds)
    write_metrics(f"learn_{name}", write_learned(learned, REPORTS / "learn" / name, ablation))


def settings() -> LearnSettings:
    """The blocks `rod` and `learn` as learning takes them."""
    rod, block = load_block(Rod), load_block(Learn)
    given = block.model_dump(exclude={"verdict_of", "ablation", "bounds", "hidden"})
    return LearnSettings(
        **given,
        particles=rod.particles,
        hidden=(block.hidden[0], block.hidden[1]),
        bounds=tuple(block.bounds.model_dump().values()),
    )


def diagnosed_rod(layout: Layout, verdict_of: str) -> SimulatedRod:
    """The layout's rope with the physics that the diagnosis found in the recording `verdict_of`."""
    verdict = read_verdict(REPORTS / "diagnose" / verdict_of)
    known = rope_values(layout.rope, layout.name, verdict.fit, {})
    return SimulatedRod.of(known.rope, known.parameters)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
