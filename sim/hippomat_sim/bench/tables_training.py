"""Which networks the tables measured: the preset, how long each was trained, and the hash of its weights."""

from __future__ import annotations

import math
from typing import Any

from hippomat_core.allocation.policy_file import PolicyFile, read_policy
from hippomat_logs.policy_files import naming
from hippomat_sim.bench.tables_layout import Section, Table
from hippomat_sim.learn.method_registry import Sources, our_policy
from hippomat_sim.learn.runs import POLICY_NAME

_COLUMNS = ("weights", "agent-steps", "updates", "minutes", "entropy coefficient", "learning rate", "hash")
_TEXT = (
    "The paper's networks are built for one fleet size, so each size has a run of its own: "
    "PRESET_TURNOVER_NxM. An agent-step is one decision of one agent. The paper does not say how long it "
    "trained; where the updates here are few, the tables show a network that has hardly begun to learn. The "
    "learner's speed among the goals counts every pass over a batch."
)


def trained_networks(sources: Sources) -> Section:
    """A row for our policy and for every run that has ended."""
    rows = [_row("ours (default)", our_policy(sources))]
    for path in sorted(sources.runs.glob(f"*/{POLICY_NAME}")):
        if path.parent.name != "default":
            with naming(str(path)):
                rows.append(_row(path.parent.name, read_policy(path.read_bytes())))
    return Section("Trained networks", _TEXT, [Table("Training runs", _COLUMNS, rows)])


def _row(name: str, policy: PolicyFile) -> list[str]:
    metrics, ppo = policy.metrics, policy.training.get("ppo", {})
    spent_s = float(metrics.get("collect_s", math.nan)) + float(metrics.get("learn_s", math.nan))
    return [
        name,
        _whole(metrics.get("agent_steps")),
        _whole(metrics.get("update")),
        f"{spent_s / 60.0:.1f}",
        f"{ppo.get('entropy', math.nan):g}",
        f"{ppo.get('learning_rate', math.nan):g}",
        f"`{policy.hash[:12]}`",
    ]


def _whole(value: Any) -> str:
    return "-" if value is None else f"{value:,}"
