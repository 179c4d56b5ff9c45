"""The paper's four tables with our figures, and the paper's own beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from hippomat_logs import paper_values as paper
from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_layout import NO_FIGURE, Book, Section, Table, beside_paper, number
from hippomat_sim.learn.method_registry import METHODS


def paper_section(book: Book) -> Section:
    text = (
        "Ours beside what the paper prints. Its instances, its unit of cost and its machine are not "
        "known, so only the order of the methods and their ratios within a column compare; (+x %) is "
        "the cost above Hungarian's in the same column. Success is the share of tasks that exactly one "
        "agent requested: in the first round of the fixed problems (CF1), over all rounds of continuous "
        "ones (CF)."
    )
    return Section("The paper's tables", text, list(_paper_tables(book)))


def _paper_tables(book: Book) -> Iterator[Table]:
    methods = book.methods(kinds.ONE_SHOT)
    measured = {agents for agents, _ in book.sizes(kinds.ONE_SHOT, square=True)}

    def beside(table: str, digits: int, reference: str = "") -> Callable[[str, int], str]:
        def text(name: str, agents: int) -> str:
            return _paper_text(table, METHODS[name].paper, agents, digits, reference)

        return text

    def fixed_cost(name: str, agents: int) -> str:
        text = book.text(kinds.ONE_SHOT, "cost", name, agents, agents, 1)
        return text + _over(book, kinds.ONE_SHOT, "cost", name, agents, agents)

    sizes = [agents for agents in kinds.PAPER_COST_AGENTS if agents in measured]
    title = "Total travel cost of fixed tasks [s] (N = M)"
    yield beside_paper(title, sizes, methods, fixed_cost, beside(paper.FIXED_COST, 1, "Hungarian"))

    def fixed_success(name: str, agents: int) -> str:
        return book.text(kinds.ONE_SHOT, "cf1", name, agents, agents, 1)

    sizes = [agents for agents in kinds.AGENTS if agents in measured]
    title = "Conflict-free success rate, fixed tasks [%] (N = M)"
    yield beside_paper(title, sizes, methods, fixed_success, beside(paper.FIXED_SUCCESS, 0))
    yield _allocation_time(book, beside(paper.FIXED_TIME, 1))

    def travel(name: str, agents: int) -> str:
        text = book.text(kinds.CONTINUOUS, "travel", name, agents, kinds.CONTINUOUS_TASKS, 3)
        return text + _over(book, kinds.CONTINUOUS, "travel", name, agents, kinds.CONTINUOUS_TASKS)

    methods = book.methods(kinds.CONTINUOUS)
    sizes = [agents for agents, _ in book.sizes(kinds.CONTINUOUS)]
    note = (
        "Cost per task alone flatters a method that allocates fewer tasks; see agent-seconds per task "
        "below. The paper prints a total over an unknown number of tasks."
    )
    title = "Travel cost of continuous tasks, per task [s] (M = 30)"
    yield beside_paper(title, sizes, methods, travel, beside(paper.CONTINUOUS_COST, 1, "Hungarian"), note)

    def success(name: str, agents: int) -> str:
        return book.text(kinds.CONTINUOUS, "cf", name, agents, kinds.CONTINUOUS_TASKS, 2)

    title = "Conflict-free success rate, continuous tasks [%] (M = 30)"
    yield beside_paper(title, sizes, methods, success, beside(paper.CONTINUOUS_SUCCESS, 0))


def _allocation_time(book: Book, printed: Callable[[str, int], str]) -> Table:
    def ours(name: str, agents: int) -> str:
        found = book.find(kinds.TIME, "decision", name, agents, agents)
        messages = book.find(kinds.TIME, "messages", name, agents, agents)
        rounds = book.find(kinds.ONE_SHOT, "rounds", name, agents, agents)
        if found is None:
            return book.text(kinds.TIME, "decision", name, agents, agents, 3)
        asked = NO_FIGURE if rounds is None else number(rounds.value, 1)
        sent = "" if messages is None or messages.value == 1.0 else f" x {number(messages.value, 1)}"
        return f"{number(found.value, 3)} / {asked}{sent}"

    note = (
        "Ours: ms of one robot's decision (median, one thread of this machine) / messaging rounds until "
        "all are served, which take 100 ms each on the air; x k: an auction exchanges k times within "
        "each. The paper prints one time in seconds that does not tell the two apart."
    )
    sizes = [agents for agents, _ in book.sizes(kinds.TIME)]
    title = "Allocation time, fixed tasks: compute [ms] / messaging rounds (N = M); paper [s]"
    return beside_paper(title, sizes, book.methods(kinds.TIME), ours, printed, note)


def _over(book: Book, kind: str, metric: str, method: str, agents: int, tasks: int) -> str:
    """` (+x %)` above Hungarian on the same instances."""
    found = book.find(kind, f"{metric}_over", method, agents, tasks)
    if found is None or method == kinds.REFERENCE:
        return ""
    return f" ({number(found.value, 1, signed=True)} %)"


def _paper_text(table: str, method: str, agents: int, digits: int, reference: str) -> str:
    value = paper.paper_value(table, method, agents)
    if value is None:
        return NO_FIGURE
    other = paper.paper_value(table, reference, agents) if reference else None
    if other is None or method == reference:
        return number(value, digits)
    return f"{number(value, digits)} ({number(100.0 * (value / other - 1.0), 1, signed=True)} %)"
