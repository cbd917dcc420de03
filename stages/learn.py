"""From a goal shape to a trajectory that stays clear: reports/learn/<layout>."""

from __future__ import annotations

import sys
from dataclasses import replace

from dlolib.cli_values import rope_values
from dlolib.formats import read_layout, read_verdict, say
from dlolib.identify import particles_for
from dlolib.learn import LearnSettings, ablate, learn, of_the_rope, write_learned
from dlolib.params import Learn, Rod, load_block
from dlolib.sim.rod import Rod as SimulatedRod
from dlolib.types import Fit, Layout
from stages import DATA, REPORTS, WITHOUT, run, write_metrics


def main(name: str) -> None:
    block = load_block(Learn)
    layout = read_layout(DATA / "layouts" / name)
    verdict = read_verdict(REPORTS / "diagnose" / block.verdict_of)
    fit, left_out = of_the_rope(verdict.fit)
    if left_out:
        say([f"{', '.join(left_out)}: of the recording {block.verdict_of}, not of its rope, and left out"])
    rod, chosen = rod_of(layout, fit), settings(layout.rope.length_m)
    learned = learn(layout, rod, chosen)
    ablation = None
    if block.ablation.layout == name:
        shorter = replace(chosen, iterations=block.ablation.iterations)
        ablation = ablate(layout, rod, shorter, block.ablation.seeds)
    write_metrics(f"learn_{name}", write_learned(learned, REPORTS / "learn" / name, ablation))
    # the same with the best elastic rod, for the report to compare
    bare, _ = of_the_rope(Fit(verdict.baseline.parameters, 0.0, 0, 0))
    elastic = learn(layout, rod_of(layout, bare), chosen)
    write_learned(elastic, REPORTS / "learn" / name / WITHOUT)


def settings(length_m: float) -> LearnSettings:
    """The blocks `rod` and `learn` as learning takes them for a rope of this length."""
    rod, block = load_block(Rod), load_block(Learn)
    given = block.model_dump(exclude={"verdict_of", "ablation", "bounds", "hidden"})
    return LearnSettings(
        **given,
        particles=particles_for(length_m, rod),
        hidden=(block.hidden[0], block.hidden[1]),
        bounds=tuple(block.bounds.model_dump().values()),
    )


def rod_of(layout: Layout, fit: Fit) -> SimulatedRod:
    """The layout's rope with the physics that a diagnosis found."""
    known = rope_values(layout.rope, layout.name, fit, {})
    return SimulatedRod.of(known.rope, known.parameters)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
