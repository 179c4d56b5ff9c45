"""What a reader of the report has to know before its tables: how it was made, on what, with which weights."""

from __future__ import annotations

from hippomat_sim.bench.tables_cells import MORE_COPIES, Plan
from hippomat_sim.bench.tables_measure import STEP_S, STEPS, WARM_UP_STEPS, Bench
from hippomat_sim.bench.tables_stats import RESAMPLES

TITLE = "Results"

_TEXT = """\
Made by `make results` (trains what is missing, then runs `hippomat-bench tables`); do not edit. Every
number is in `results.csv`, with both ends of its interval.

Worlds: {worlds} test worlds that no training saw, {size} m with {obstacles} boxes; half of the agents
are UGVs with {ugv:g} m/s on the ground, half UAVs with {uav:g} m/s in 3D. Costs are shortest paths at
straight-line speed, sent as the 8-bit codes of the air. All methods meet the same instances (seed {seed},
{episodes} of each size; slow methods the first ones of them) and, of several requests for a task, the
smallest (cost, id) wins. Continuous tasks run in steps of {step:g} s, {steps} of which count after
{warm_up}, in {copies} / N copies; slow methods have fewer, and so has everything under loss.

`x ± h`: h is half the width of the 95 % interval, by bootstrap over the test worlds, each drawn with all
its instances or copies ({resamples} resamples, the same for every method, so that differences are
paired). Where fewer than about 20 worlds are met, by slow methods and by continuous tasks under loss, it is
too narrow. A decision time is a median, on {machine}."""


def preface(plan: Plan, bench: Bench) -> str:
    """Markdown."""
    world = bench.world
    return _TEXT.format(
        worlds=world.worlds,
        size=" x ".join(map(str, world.size_m)),
        obstacles=world.obstacles,
        ugv=world.ugv_speed_mps,
        uav=world.uav_speed_mps,
        seed=plan.seed,
        episodes=plan.episodes,
        copies=MORE_COPIES * plan.episodes,
        step=STEP_S,
        steps=STEPS,
        warm_up=WARM_UP_STEPS,
        resamples=RESAMPLES,
        machine=bench.machine,
    )
