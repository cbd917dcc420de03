"""The rod against theory: docs/validation.md and its figures (`make validation`); cases in stages.cases."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes

from dlolib.files import whole_file
from dlolib.report.style import (
    OBSERVED,
    PAPER,
    PLASTIC,
    ROD,
    SERIES,
    STYLE,
    canvas,
    legend_above,
    save,
    thousandths,
)
from stages import cases, run

FOLDER = Path("docs/validation")
DOTTED = (0, (1, 2))
PAGE = """# Validation

The rod of `dlolib.sim` against theory, case by case. `make validation` runs them, draws the figures and
writes this page; `tests/sim/test_validation.py` holds the same cases to the same theory. Each is a function
of [`stages/cases`](../stages/cases), which names its source.

| case | against | figure reached |
|---|---|---|
{table}

## Shapes

![Elastica, catenary and cantilever: shapes and convergence](validation/shapes.svg)

{shapes}

## Stability

![Growth of a twisted ring's second mode; how far a standing rope hangs over](validation/stability.svg)

{stability}

## Friction

![Tension along a rope drawn over a rough cylinder](validation/capstan.svg)

{capstan}

## Laws with a history

![Moment of a plastic rope; relaxation and creep](validation/laws.svg)

{laws}

## Motion

![Free oscillation of a cantilever](validation/oscillation.svg)

{oscillation}
"""


def main() -> None:
    elastica, catenary, cantilever = cases.elastica(), cases.catenary(), cases.cantilever()
    ring, standing, rope = cases.michell(), cases.standing(), cases.capstan()
    plastic, relaxation, creep = cases.plastic(), cases.relaxation(), cases.creep()
    beam = cases.oscillation()
    with rc_context(STYLE):
        _shapes({"elastica": elastica, "catenary": catenary, "cantilever": cantilever})
        _stability(ring, standing)
        _capstan(rope)
        _laws(plastic, relaxation, creep)
        _oscillation(beam)
    rows = [
        ("clamped elastica", "boundary-value problem (`solve_bvp`)", _converges(elastica)),
        ("catenary, EI = 1e-9 N m²", "z = a cosh(x / a)", _converges(catenary)),
        ("light cantilever with a tip mass", "boundary-value problem (`solve_bvp`)", _converges(cantilever)),
        ("twisted ring (Michell)", "2π √3 EI / GJ", _off(ring.found, ring.theory, "buckles at {:.2f} rad")),
        (
            "standing rope (Greenhill)", "7.8373 EI / L²",
            _off(standing.found, standing.theory, "falls at a weight of {:.3f} EI / L²"),
        ),
        ("capstan, μ = 0.3, half a turn", "e^(μπ)", _off(rope.ratio, rope.theory, "tension ratio {:.3f}")),
        (
            "plastic ring-back", "(κ - κy) / (1 + H)",
            _off(plastic.left, plastic.left_theory, "curvature left {:.3f} 1/m"),
        ),
        ("relaxation of a held bend", "exponential of the Maxwell branch", f"{relaxation.error:.1e} at most"),
        ("creep under a load", "standard linear solid", f"{creep.error:.1e} of the deflection at most"),
        (
            "free oscillation", "1.8751² √(EI / ρ L⁴)",
            _off(beam.continuous, beam.theory, "{:.4f} rad/s at a step of zero"),
        ),
        ("its numerical decay", "the scheme's characteristic equation", _decay(beam)),
    ]  # fmt: skip
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    shapes = (
        f"Left: the shapes with {elastica.particles[-1]} particles (colours) on the exact ones (black). "
        "Right: the largest distance of a particle to the exact place of its arc length, over the length; "
        "the dotted line falls with the square of the segments. What flattens at 1e-5 is the rope's own "
        "stretch: an inextensible rope is one with an axial stiffness that its load strains by 3e-5 "
        "(`dlolib.sim.rod.WEIGHT_STRAIN`)."
    )
    stability = (
        "Left: growth a step of the second harmonic of a ring put a little out of its plane, by twist; where "
        f"the line crosses 1 the ring buckles: at {ring.found:.2f} rad, Michell's {ring.theory:.2f} rad is "
        "dotted. The ring can turn about its clamp's tangent at no cost, so no single quasi-static "
        "equilibrium exists and none is asked for. Right: how far the tip of a rope that stands on a clamp "
        "hangs beside its foot, over the length, by its weight (dots), and the elastica's (line). It is "
        "begun straight up and nothing pushes it: it stays where that is stable and falls where it is not. "
        f"Greenhill's {standing.theory:.3f} EI / L² is dotted."
    )
    capstan = (
        "A rope over half a cylinder with 0.5 kg on one side, drawn 50 mm down on the other until it slides "
        "everywhere: tension of every segment by its angle (dots), and T₁ e^(μ θ) (line)."
    )
    laws = (
        "Left: moment over curvature of a rope bent evenly (dots) and the law (line), and the curvature that "
        "it keeps when let go. Middle: moment over EI κ of a bend made in 0.1 s and held. Right: a "
        "cantilever's tip under a small load, over where it goes at once."
    )
    oscillation = (
        "Left: the first mode of a cantilever let go, two periods at the shortest "
        "step. Right: decay rate by step. The decay is the scheme's own (dotted: that of its characteristic "
        f"equation), of order {_order_in_time(beam):.1f} in time."
    )
    page = PAGE.format(
        table=table, shapes=shapes, stability=stability, capstan=capstan, laws=laws, oscillation=oscillation
    )
    with whole_file(Path("docs/validation.md")) as file:
        file.write_text(page, encoding="utf-8")
    print(table)


def _converges(found: cases.Shapes) -> str:
    errors = dict(zip(found.particles, 100 * found.error, strict=True))
    listed = ", ".join(f"{error:.2g} %" for error in errors.values())
    first, second = found.particles[:2]
    order = f"order {found.order[0]:.2f} from n = {first} to {second}"
    return f"{listed} of the length at n = {', '.join(map(str, errors))}; {order}"


def _off(found: float, theory: float, words: str) -> str:
    return f"{words.format(found)}, {100 * (found / theory - 1):+.2g} %"


def _order_in_time(beam: cases.Oscillation) -> float:
    return float(np.log(beam.rate[0] / beam.rate[-1]) / np.log(beam.step_s[0] / beam.step_s[-1]))


def _decay(beam: cases.Oscillation) -> str:
    worst = float(np.abs(beam.rate / beam.own_rate - 1).max())
    longest = beam.rate[0] / beam.theory
    steps = round(2 * np.pi / (beam.theory * beam.step_s[0]))
    return f"off by {100 * worst:.1g} % at most; {100 * longest:.2g} % of critical in {steps} steps a period"


def _shapes(found: dict[str, cases.Shapes]) -> None:
    figure = canvas(66)
    shape, error = figure.subplots(1, 2)
    for color, (name, one) in zip(SERIES, found.items(), strict=False):
        shape.plot(*one.exact.T, color=OBSERVED, linewidth=0.8)
        shape.plot(*one.simulated[::4].T, ".", color=color, markersize=4, label=name)
        error.plot(np.array(one.particles) - 1, 100 * one.error, "o-", color=color, markersize=3, label=name)
    segments = np.array([14.0, 119.0])
    error.plot(
        segments, 100 * found["elastica"].error[0] * (14 / segments) ** 2, color=PAPER, linestyle=DOTTED
    )
    shape.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
    thousandths(shape)
    error.set(xscale="log", yscale="log", xlabel="segments", ylabel="error [% of the length]")
    error.set_xticks([14, 29, 59, 119], ["14", "29", "59", "119"])
    error.minorticks_off()
    legend_above(error)
    save(figure, FOLDER, "shapes")


def _stability(ring: cases.Buckling, standing: cases.Standing) -> None:
    figure = canvas(52)
    axes, other = figure.subplots(1, 2)
    other.plot(standing.weight, standing.exact, color=OBSERVED, linewidth=0.8)
    other.plot(standing.weight, standing.aside, "o", color=ROD, markersize=3)
    other.axvline(standing.theory, color=OBSERVED, linestyle=DOTTED)
    other.set(xlabel="weight over EI / L²", ylabel="tip aside over the length")
    axes.plot(ring.twist, ring.growth, "o-", color=ROD, markersize=3)
    axes.axhline(1.0, color=PAPER, linewidth=0.8)
    axes.axvline(ring.theory, color=OBSERVED, linestyle=DOTTED)
    axes.set(xlabel="twist [rad]", ylabel="growth a step")
    save(figure, FOLDER, "stability")


def _capstan(rope: cases.Capstan) -> None:
    figure = canvas(52, 90)
    axes = figure.subplots()
    on = (rope.angle > -0.4) & (rope.angle < np.pi + 0.4)
    axes.plot(np.degrees(rope.angle[on]), rope.tension[on], ".", color=ROD, markersize=4)
    theta = np.linspace(0, np.pi, 100)
    low = rope.tension[(rope.angle > np.pi) & on].mean()
    axes.plot(np.degrees(theta), low * rope.theory ** (1 - theta / np.pi), color=OBSERVED, linewidth=0.8)
    axes.set(xlabel="angle from the drawn side [°]", ylabel="tension [N]", ylim=(0, None))
    axes.set_xticks([0, 45, 90, 135, 180])
    save(figure, FOLDER, "capstan")


def _laws(plastic: cases.Bending, relaxation: cases.Decay, creep: cases.Decay) -> None:
    figure = canvas(56)
    moment, relaxed, crept = figure.subplots(1, 3)
    moment.plot(plastic.curvature, 1e3 * plastic.theory, color=OBSERVED, linewidth=0.8)
    top = plastic.curvature[-1], 1e3 * plastic.theory[-1]
    moment.plot([top[0], plastic.left_theory], [top[1], 0.0], color=OBSERVED, linewidth=0.8)
    moment.plot(plastic.curvature[::4], 1e3 * plastic.moment[::4], ".", color=PLASTIC, markersize=4)
    moment.plot(plastic.left, 0.0, "o", color=PLASTIC, markersize=4)
    moment.set(xlabel="curvature [1/m]", ylabel="moment [mN m]")
    for axes, one, what, every in (
        (relaxed, relaxation, "moment over EI κ", 2),
        (crept, creep, "deflection over the first", 5),
    ):
        axes.plot(one.t_s, one.theory, color=OBSERVED, linewidth=0.8)
        axes.plot(one.t_s[::every], one.found[::every], ".", color=ROD, markersize=4)
        axes.set(xlabel="time [s]", ylabel=what)
    save(figure, FOLDER, "laws")


def _oscillation(beam: cases.Oscillation) -> None:
    figure = canvas(56)
    tip, rate = figure.subplots(1, 2)
    tip.plot(beam.t_s, beam.tip, color=ROD)
    tip.set(xlabel="time [s]", ylabel="first mode, first value -1")
    _line(rate, 1e3 * beam.step_s, beam.rate, beam.own_rate)
    rate.set(xlabel="step [ms]", ylabel="decay rate [1/s]", xscale="log", yscale="log")
    rate.set_xticks(1e3 * beam.step_s, [f"{step:.0f}" for step in 1e3 * beam.step_s], minor=False)
    rate.set_xticks([], minor=True)
    save(figure, FOLDER, "oscillation")


def _line(axes: Axes, x: np.ndarray, found: np.ndarray, theory: np.ndarray) -> None:
    axes.plot(x, theory, color=OBSERVED, linestyle=DOTTED)
    axes.plot(x, found, "o", color=ROD, markersize=3.5)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
