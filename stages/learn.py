"""From a goal shape to a trajectory that stays clear: reports/learn/<layout>."""

from __future__ import annotations

import sys
from dataclasses import replace

from dlolib.cli_values import rope_values
from dlolib.formats import read_layout, read_verdict, say
from dlolib.learn import LearnSettings, ablate, learn, write_learned
from dlolib.params import Learn, Rod, load_block
from dlolib.sim.effects import of_the_rope
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
    rod, stay = rod_of(layout, verdict.fit)
    if stay:
        say([f"{', '.join(stay)}: of the recording {block.verdict_of} and not of the rope, left out"])
    chosen = settings(layout.rope.length_m)
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
    elastic = learn(layout, rod_of(layout, alone)[0], chosen)
    write_learned(elastic, REPORTS / "learn" / name / WITHOUT)


def settings(length_m: float) -> LearnSettings:
    """The blocks `rod` and `learn` as learning takes them for a rope of this length."""
    rod, block = load_block(Rod), load_block(Learn)
    given = block.model_dump(exclude={"verdict_of", "ablation", "bounds", "hidden"})
    return LearnSettings(
        **given,
        particles=Mesh(rod.particles, rod.longest_segment_m).particles_for(length_m),
        hidden=(block.hidden[0], block.hidden[1]),
        bounds=tuple(block.bounds.model_dump().values()),
    )


def rod_of(layout: Layout, fit: Fit) -> tuple[SimulatedRod, tuple[str, ...]]:
    """The layout's rope with the physics that a diagnosis found; the effects that it does not take along."""
    known = rope_values(layout.rope, layout.name, fit, {})
    own, stay = of_the_rope(known.parameters)
    return SimulatedRod.of(known.rope, own), stay


if __name__ == "__main__":
    run(main, *sys.argv[1:])
