"""`hippomat-bench tables`: its options, and what it does with them."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from shutil import copyfile

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hippomat_core.errors import ConfigError
from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_cells import PARTS, Plan
from hippomat_sim.bench.tables_figures import figures_of
from hippomat_sim.bench.tables_files import as_csv, as_json, as_markdown
from hippomat_sim.bench.tables_goals import OURS, goals_of, verdict
from hippomat_sim.bench.tables_layout import Book, Section
from hippomat_sim.bench.tables_measure import TEST_SPLIT, Bench, fleet_of
from hippomat_sim.bench.tables_preface import TITLE, preface
from hippomat_sim.bench.tables_run import Results
from hippomat_sim.bench.tables_run import run as measure_all
from hippomat_sim.bench.tables_sections import sections_of
from hippomat_sim.bench.tables_show import show
from hippomat_sim.bench.tables_store import STORE_NAME, Store
from hippomat_sim.bench.tables_training import trained_networks
from hippomat_sim.learn.method_registry import METHODS, Sources, policy_manifest, run_of
from hippomat_sim.learn.pool_bar import make_pool_shown
from hippomat_sim.learn.runs import Fleet, Run, missing
from hippomat_sim.learn.settings import WorldSettings

MISSED = 2
_SHOWN_RUN = Run("paper", Fleet(10, kinds.CONTINUOUS_TASKS, "on_claim"))  # whose curves the report shows
DEFAULT_OUT, DEFAULT_RUNS = Path("build/tables"), Path("build/runs")
MARKDOWN, CSV, JSON = "results.md", "results.csv", "results.json"
TRAIN = "hippomat-bench tables --train"
TEST_WORLDS = 32  # intervals are as good as the number of worlds is large; each takes a second to prepare
MOST_AGENTS = 64  # the air's limit


@dataclass(frozen=True, slots=True)
class Output:
    """Where the report goes. resume: what the directory's store holds is not measured again."""

    directory: Path
    resume: bool
    json: bool
    jobs: int


def run(options: argparse.Namespace) -> int:
    """The exit code: MISSED when a judged goal was."""
    plan = _plan(options)
    if options.train is not None and options.train < 0:
        raise ConfigError(f"--train {options.train}: must be above 0, or be left out")
    for option, value in (("--jobs", options.jobs), ("--worlds", options.worlds)):
        if value < 1:
            raise ConfigError(f"{option} {value}: must be at least 1")
    world = WorldSettings(worlds=options.worlds)
    bench = Bench(world, Sources(options.runs, options.policy), options.seed)
    if options.train is not None:
        _train(plan, options.runs, options.train or None, options.jobs)
    return report(plan, bench, Output(options.out, options.resume, options.json, options.jobs))


def _train(plan: Plan, runs: Path, agent_steps: int | None, jobs: int) -> None:
    """Trains what the plan's methods miss."""
    from hippomat_sim.learn.train_missing import train_missing  # here: only training needs torch

    wanted = [run_of(cell.method, fleet_of(cell)) for cell in plan.cells() if cell.method != kinds.OPTIMUM]
    due = missing([run for run in wanted if run is not None], runs)
    train_missing(due, runs, agent_steps, Console(file=sys.stderr), jobs)


def report(plan: Plan, bench: Bench, output: Output) -> int:
    """Measures, writes the files, shows the tables; the exit code."""
    import_module("matplotlib")  # before the run, not after it
    output.directory.mkdir(parents=True, exist_ok=True)
    results = _measure(plan, bench, Store(output.directory, fresh=not output.resume), output.jobs)
    book = _book(results)
    ours = any(method.startswith(OURS) for method in plan.methods)
    manifest = policy_manifest(bench.sources) if ours else {}
    goals = goals_of(book, plan.episodes, manifest)
    untrained, curves = _missing(results), _curves(bench.sources.runs, output.directory)
    sections = [*sections_of(book, goals, untrained, curves), trained_networks(bench.sources)]
    written = _write(output.directory, preface(plan, bench), sections, book)
    whole = as_json(_settings(plan, results), book.figures, goals, untrained)
    (output.directory / JSON).write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    met = not any(goal.missed for goal in goals)
    if output.json:
        print(json.dumps(whole))
    else:
        show(sections, verdict(goals), met, Console(highlight=False))
        print(f"written: {', '.join(map(str, written))}")
    return 0 if met else MISSED


def _plan(options: argparse.Namespace) -> Plan:
    """What was asked for; ConfigError for what cannot be."""
    methods = _names("--methods", options.methods, tuple(METHODS))
    parts = _names("--only", options.only, PARTS)
    agents = tuple(dict.fromkeys(_whole_numbers(options.agents)))
    for size in agents:
        if not 1 <= size <= MOST_AGENTS:
            raise ConfigError(f"--agents {size}: must be 1 to {MOST_AGENTS}")
    if not options.episodes >= 2:
        raise ConfigError(f"--episodes {options.episodes}: must be at least 2, for an interval")
    if options.loss is not None and not 0.0 < options.loss < 1.0:
        raise ConfigError(f"--loss {options.loss:g}: must be above 0 and below 1")
    if not options.seed >= 0:
        raise ConfigError(f"--seed {options.seed}: must be 0 or more")
    return Plan(methods, agents, options.episodes, options.seed, options.loss, parts)


def _names(option: str, text: str | None, known: tuple[str, ...]) -> tuple[str, ...]:
    """The known names among comma-separated ones, all of them where there are none."""
    if text is None:
        return known
    wanted = [name.strip() for name in text.split(",") if name.strip()]
    for name in wanted:
        if name not in known:
            raise ConfigError(f"{option} {name}: unknown; known: {', '.join(known)}")
    if not wanted:
        raise ConfigError(f"{option}: name at least one of {', '.join(known)}")
    return tuple(name for name in known if name in wanted)


def _whole_numbers(text: str | None) -> Sequence[int]:
    try:
        return [int(part) for part in (text or "").split(",") if part.strip()]
    except ValueError:
        raise ConfigError(f"--agents {text}: must be whole numbers with commas between them") from None


def _measure(plan: Plan, bench: Bench, store: Store, jobs: int) -> Results:
    """With bars on stderr: first for the worlds, where they have to be made, then for the cells."""
    console = Console(file=sys.stderr)
    pool = make_pool_shown(bench.world, TEST_SPLIT, console)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("measuring", total=None)

        def tell(about: str, done: int, total: int) -> None:
            bar.update(task, description=about, completed=done, total=total)

        return measure_all(plan, bench, pool, store, jobs, tell)


def _book(results: Results) -> Book:
    untrained = frozenset((cell.kind, cell.method, cell.agents, cell.tasks) for cell in results.missing)
    return Book(figures_of(results), untrained)


def _missing(results: Results) -> dict[str, str]:
    """Method -> the sizes that it was not trained for, and what to run."""
    sizes: dict[str, dict[str, None]] = {}
    for cell in results.missing:
        turnover = {"never": "fixed", "on_claim": "continuous"}[fleet_of(cell).turnover]
        sizes.setdefault(cell.method, {})[f"{turnover} {cell.agents} x {cell.tasks}"] = None
    return {method: f"{', '.join(found)}: run `{TRAIN}`" for method, found in sizes.items()}


def _curves(runs: Path, directory: Path) -> list[str]:
    """Copies the curves of the paper's network beside the report; names of those that there are."""
    found = []
    for curve in ("reward", "entropy"):
        source = runs / _SHOWN_RUN.name / f"{curve}.png"
        if source.is_file():
            found.append(f"results_paper_{curve}.png")
            copyfile(source, directory / found[-1])
    return found


def _settings(plan: Plan, results: Results) -> dict[str, object]:
    """For programs: what this run was asked for."""
    return {
        "methods": list(plan.methods),
        "agents": list(plan.agents),
        "episodes": plan.episodes,
        "seed": plan.seed,
        "loss": plan.loss,
        "only": list(plan.parts),
        "weights": results.fingerprints,
    }


def _write(directory: Path, text: str, sections: Sequence[Section], book: Book) -> list[Path]:
    """Markdown, CSV and pictures."""
    from hippomat_sim.bench.tables_plots import draw  # here, because matplotlib loads slowly

    pictures = draw(book, directory)
    kept = [
        replace(one, plots=[plot for plot in one.plots if (directory / plot).exists()]) for one in sections
    ]
    (directory / MARKDOWN).write_text(as_markdown(TITLE, text, kept), encoding="utf-8")
    (directory / CSV).write_text(as_csv(book.figures), encoding="utf-8")
    return [directory / MARKDOWN, directory / CSV, *pictures]


def add_options(parser: argparse.ArgumentParser) -> None:
    """What run() reads."""
    plan = Plan()
    add = parser.add_argument
    add("--methods", metavar="A,B", help=f"{', '.join(METHODS)} (default all; {kinds.REFERENCE} always)")
    add("--agents", metavar="5,10", help="fleet sizes of all tables (default: each table has its own)")
    text = f"instances of fixed tasks; {kinds.MORE_COPIES} K / N copies of continuous ones"
    text = f"{text} (default {plan.episodes})"
    add("--episodes", type=int, default=plan.episodes, metavar="K", help=text)
    add("--seed", type=int, default=plan.seed, metavar="N", help="of the instances (default 0)")
    add("--loss", type=float, metavar="P", help="this loss alone instead of 10 to 50 %%")
    add("--only", metavar="A,B", help=f"parts: {', '.join(PARTS)} (default all)")
    text = f"test worlds (default {TEST_WORLDS})"
    add("--worlds", type=int, default=TEST_WORLDS, metavar="K", help=text)
    text = "our policy, instead of the packaged one"
    add("--policy", type=Path, metavar="FILE", help=text)
    text = f"training runs of the other learned methods (default {DEFAULT_RUNS})"
    add("--runs", type=Path, default=DEFAULT_RUNS, metavar="DIR", help=text)
    text = f"for {MARKDOWN}, {CSV}, {JSON}, pictures and {STORE_NAME} (default {DEFAULT_OUT})"
    add("--out", type=Path, default=DEFAULT_OUT, metavar="DIR", help=text)
    text = "first train what is missing in --runs, each run for N agent steps (default: its preset's)"
    add("--train", type=int, nargs="?", const=0, metavar="N", help=text)
    add("--resume", action="store_true", help=f"measure only what {STORE_NAME} in --out does not hold yet")
    cores = os.cpu_count() or 1
    text = f"processes that train and measure (default {cores}, the cores)"
    add("--jobs", type=int, default=cores, metavar="K", help=text)
    add("--json", action="store_true", help="one JSON object instead of tables")
