"""From a goal shape to a trajectory that stays clear: reports/learn/<layout>."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace

from dlolib.cli_values import rope_values
from dlolib.formats import read_layout, read_verdict
from dlolib.learn import LearnSettings, ablate, learn, write_learned
from dlolib.params import Learn, Rod, load_block
from dlolib.sim.rod import Rod as SimulatedRod
from dlolib.types import Estimate, Fit, Layout
from stages import DATA, REPORTS, WITHOUT, run, write_metrics


def main(name: str) -> None:
    block = load_block(Learn)
    layout = read_layout(DATA / "layouts" / name)
    verdict = read_verdict(REPORTS / "diagnose" / block.verdict_of)
    rod = rod_of(layout, verdict.fit.parameters)
    learned = learn(layout, rod, settings())
    ablation = None
    if block.ablation.layout == name:
        shorter = replace(settings(), iterations=block.ablation.iterations)
        ablation = ablate(layout, rod, shorter, block.ablation.seeds)
    write_metrics(f"learn_{name}", write_learned(learned, REPORTS / "learn" / name, ablation))
    # the same with the best elastic rod, for the report to compare
    elastic = learn(layout, rod_of(layout, verdict.baseline.parameters), settings())
    write_learned(elastic, REPORTS / "learn" / name / WITHOUT)


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


def rod_of(layout: Layout, parameters: Mapping[str, Estimate]) -> SimulatedRod:
    """The layout's rope with the physics that a diagnosis found."""
    known = rope_values(layout.rope, layout.name, Fit(parameters, 0.0, 0, 0), {})
    return SimulatedRod.of(known.rope, known.parameters)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
