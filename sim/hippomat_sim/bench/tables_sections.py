"""The chapters of the report: the goals, the paper's four tables, then ours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_goals import Goal
from hippomat_sim.bench.tables_layout import (
    NO_FIGURE,
    Book,
    Section,
    Table,
    by_size,
    number,
    shown,
    size_name,
)
from hippomat_sim.bench.tables_paper_section import paper_section
from hippomat_sim.learn.method_registry import METHODS

SWEEP = "results_loss.png"
FIXED_PLOT, CONTINUOUS_PLOT = "results_fixed.png", "results_continuous.png"
_CURVES = (
    "The paper's two figures, mean reward and entropy over training steps, of its own network with its own "
    "hyper-parameters, continuous tasks, N = 10, M = 30."
)
_LEARNING = ("graphsage", "graphsage_untrained", "graphsage_no_head", "learned_part")


def sections_of(
    book: Book, goals: Sequence[Goal], missing: Mapping[str, str], curves: Sequence[str] = ()
) -> list[Section]:
    """Chapters with something to say, in order.

    missing: method -> why it was not measured. curves: pictures of how the paper's network was trained.
    """
    made = [
        goals_section(goals),
        paper_section(book),
        _fixed(book),
        _learning(book),
        _continuous(book),
        _under_loss(book),
        _large(book),
        _permuted(book),
        Section("Training of the paper's network", _CURVES, plots=curves),
        _missing(missing),
    ]
    return [section for section in made if section.says_something]


def goals_section(goals: Sequence[Goal]) -> Section:
    """Met, missed, or why it was not judged."""
    rows = []
    for goal in goals:
        value = NO_FIGURE if goal.value != goal.value else f"{_sized(goal.value)} {goal.unit}"
        said = goal.not_judged and f"not judged: {goal.not_judged}"
        required = f"{'>=' if goal.at_least else '<='} {goal.bound:,g} {goal.unit}"
        rows.append([goal.name, value, required, said or ("met" if goal.met else "**missed**")])
    text = (
        "Each goal is judged by the value in the tables below, on the same frozen instances for all methods."
    )
    return Section("Goals", text, [Table("Goals", ["goal", "measured", "required", ""], rows)])


def _sized(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000.0 else number(value, 2)


def _fixed(book: Book) -> Section:
    sizes = [(agents, tasks) for agents, tasks in _square(book) if agents in kinds.AGENTS] or _square(book)
    kind, names = kinds.ONE_SHOT, "One task for each agent; losers ask again until all are served."
    text = (
        f"{names} CF1: tasks requested by exactly one agent in the first round, of min(N, M). EP: rounds "
        "without any conflict. Gap: total travel cost above that of the cheapest assignment by exact "
        "path times, which knows more than the 8-bit costs that all methods see, Hungarian included. "
        "Read it with the number of rounds."
    )
    tables = [
        by_size(book, "CF1 [%]", kind, "cf1", sizes, 2),
        by_size(book, "Gap [%]", kind, "gap", sizes, 2),
        by_size(book, "EP [%]", kind, "ep", sizes, 1),
        by_size(book, "Rounds until all are served", kind, "rounds", sizes, 2),
    ]
    if any(one.metric == "left" and one.kind == kind and one.estimate.value > 0 for one in book.figures):
        note = "They were given the remaining tasks in order of id, and the cost of that counts."
        title = "Agents that asked for nothing although a task was left [%]"
        tables.append(by_size(book, title, kind, "left", sizes, 1, note=note))
    return Section("Fixed tasks", text, tables, [FIXED_PLOT])


def _learning(book: Book) -> Section:
    sizes = _square(book)
    text = (
        "The head alone, untrained, beside what training makes of it, and the learned part without the head. "
        "Differences are paired; where a difference of CF1 is negative or one of the gap positive, training "
        "made it worse."
    )
    tables = [
        by_size(book, "CF1 [%]", kinds.ONE_SHOT, "cf1", sizes, 2, methods=_LEARNING),
        by_size(book, "Gap [%]", kinds.ONE_SHOT, "gap", sizes, 2, methods=_LEARNING),
        by_size(
            book, "CF1, trained minus untrained [points]", kinds.ONE_SHOT, "cf1_learned", sizes, 2, True,
            ("graphsage",),
        ),
        by_size(
            book, "Gap, trained minus untrained [points]", kinds.ONE_SHOT, "gap_learned", sizes, 2, True,
            ("graphsage",),
        ),
    ]  # fmt: skip
    return Section("What learning adds", text, tables)


def _continuous(book: Book) -> Section:
    kind, sizes = kinds.CONTINUOUS, book.sizes(kinds.CONTINUOUS)
    text = (
        "M = 30 open tasks, each replaced as soon as it is allocated; 100 s count after 10 s that do "
        "not. Agent-seconds per task = N T / tasks allocated: what a task costs the fleet, waiting "
        "included. Methods that look ahead reckon with the arrival times of busy agents."
    )
    tables = [
        by_size(book, "Agent-seconds per task [s]", kind, "agent_s", sizes, 3),
        by_size(book, "Agent-seconds per task, above Hungarian [%]", kind, "agent_s_over", sizes, 2, True),
        by_size(book, "Throughput [tasks/s]", kind, "throughput", sizes, 3),
        by_size(book, "CF: requested tasks that one agent requested [%]", kind, "cf", sizes, 2),
        by_size(book, "EP: rounds without any conflict [%]", kind, "ep", sizes, 2),
    ]
    return Section("Continuous tasks", text, tables, [CONTINUOUS_PLOT])


def _under_loss(book: Book) -> Section:
    text = (
        "Every frame is lost at every receiver with this probability, independently. With relay: the "
        "rows that peers pass on within the round's airtime count too. Every robot decides on what it "
        "holds; all methods get the same views. First the first round of fixed problems, where a row "
        "that did not arrive is unknown; then continuous tasks, where it is stale."
    )
    tables = []
    for agents, tasks in book.sizes(kinds.LOSS):
        for relay in (True, False):
            said = f"{size_name(agents, tasks)}, {'with' if relay else 'without'} relay"
            tables.append(_sweep(book, f"CF1 [%], {said}", "cf1", agents, tasks, relay))
            title = f"CF1 minus Hungarian's from the same views [points], {said}"
            tables.append(_sweep(book, title, "cf1_over", agents, tasks, relay))
    tables += _continuous_loss(book)
    return Section("Under loss", text, tables, [SWEEP])


def _sweep(book: Book, title: str, metric: str, agents: int, tasks: int, relay: bool) -> Table:
    losses = sorted({one.loss for one in book.figures if one.kind == kinds.LOSS})
    signed = metric == "cf1_over"
    rows = []
    for name in book.methods(kinds.LOSS):
        if signed and name == kinds.REFERENCE:
            continue
        row = [METHODS[name].label]
        for loss in losses:
            found = book.find(kinds.LOSS, metric, name, agents, tasks, loss, relay or loss == 0.0)
            row.append(shown(found, 2, signed))
        rows.append(row)
    return Table(title, ["method", *(f"loss {loss:.0%}" for loss in losses)], rows)


def _continuous_loss(book: Book) -> Iterator[Table]:
    kind = kinds.LOSS_CONTINUOUS
    cases = sorted({(one.loss, not one.relay) for one in book.figures if one.kind == kind})
    for agents, tasks in book.sizes(kind):
        for metric, said, digits in (("cf", "CF [%]", 2), ("agent_s", "Agent-seconds per task [s]", 3)):
            rows = [
                [
                    METHODS[name].label,
                    *(
                        shown(book.find(kind, metric, name, agents, tasks, loss, not alone), digits)
                        for loss, alone in cases
                    ),
                ]
                for name in book.methods(kind)
            ]
            columns = [f"{loss:.0%} {'without' if alone else 'with'} relay" for loss, alone in cases]
            title = f"Continuous, {size_name(agents, tasks)}: {said}"
            yield Table(title, ["method", *columns], rows)


def _large(book: Book) -> Section:
    sizes = [size for size in book.sizes(kinds.ONE_SHOT) if size in kinds.LARGE]
    text = "Larger than anything that was trained on."
    tables = [
        by_size(book, title, kinds.ONE_SHOT, metric, sizes, digits)
        for title, metric, digits in (
            ("CF1 [%]", "cf1", 2),
            ("Gap [%]", "gap", 2),
            ("Rounds until all are served", "rounds", 2),
        )
    ]
    return Section("Generalisation", text, tables if sizes else [])


def _permuted(book: Book) -> Section:
    kind, sizes = kinds.PERMUTED, book.sizes(kinds.PERMUTED)
    text = (
        "The same tasks in other slots. A policy that looks at the tasks asks for the same task again, "
        "wherever it is now; one that has collapsed to a fixed permutation asks for the same slot, "
        "whatever is in it."
    )
    tables = [
        by_size(book, "Agents that ask for the same slot [%]", kind, "same_slot", sizes, 1),
        by_size(book, "Agents that ask for the same task [%]", kind, "same_task", sizes, 1),
    ]
    return Section("Slots permuted", text, tables)


def _missing(missing: Mapping[str, str]) -> Section:
    rows = [[METHODS[name].label, said] for name, said in missing.items()]
    text = "Nothing is shown for methods whose weights are not there."
    return Section("Not trained", text, [Table("Not trained", ["method", "what to run"], rows)])


def _square(book: Book) -> list[tuple[int, int]]:
    return [size for size in book.sizes(kinds.ONE_SHOT, square=True) if size not in kinds.LARGE]
