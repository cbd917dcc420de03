"""From a goal shape to a trajectory that stays clear: reports/learn/<layout>."""

from __future__ import annotations

import sys
from dataclasses import replace

from dlolib.formats import read_layout, read_verdict, say
from dlolib.learn import LearnSettings, ablate, learn, write_learned
from dlolib.params import Learn, Rod, load_block
from dlolib.rope_values import elsewhere, rope_values
from dlolib.sim.mesh import Mesh
from dlolib.sim.rod import Rod as SimulatedRod
from dlolib.types import Fit, Layout
from stages import DATA, REPORTS, WITHOUT, run, write_metrics


def main(name: str) -> None:
    block = load_block(Learn)
    layout = read_layout(DATA / "layouts" / name)
    verdict = read_verdict(REPORTS / "diagnose" / block.verdict_of)
    if verdict.status == "unexplained":
        says = "no model of the library explains it; take what it names with care"
        say([f"recording {block.verdict_of}: {says}"])
    rod, chosen = rod_of(layout, verdict.fit), settings(layout.rope.length_m)
    learned = learn(layout, rod, chosen)
    if not learned.free:
        say([f"{name}: no path with the clearance asked for was found; no robot goes this one"])
    ablation = None
    if block.ablation.layout == name:
        shorter = replace(chosen, iterations=block.ablation.iterations)
        ablation = ablate(layout, rod, shorter, block.ablation.seeds)
    write_metrics(f"learn_{name}", write_learned(learned, REPORTS / "learn" / name, ablation))
    # the same with the best elastic rod, for the report to compare
    alone = replace(verdict.fit, parameters=verdict.baseline.parameters, rope=None)
    elastic = learn(layout, rod_of(layout, alone), chosen)
    write_learned(elastic, REPORTS / "learn" / name / WITHOUT)


def settings(length_m: float) -> LearnSettings:
    """The blocks `rod` and `learn` as learning takes them for a rope of this length."""
    particles = Mesh(**load_block(Rod).mesh()).particles_for(length_m)
    return LearnSettings(**load_block(Learn).settings(), particles=particles)


def rod_of(layout: Layout, fit: Fit) -> SimulatedRod:
    """The layout's rope with the physics that a diagnosis found."""
    known = elsewhere(rope_values(layout.rope, layout.name, fit, {}))
    return SimulatedRod.of(known.rope, known.parameters)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
