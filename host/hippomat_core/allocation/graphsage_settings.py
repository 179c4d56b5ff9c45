"""What shapes the edge network and its head, as a policy file's manifest says it. Knows no weights.

The trained weights hold for these settings alone; torch and the robots read them from the same place.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from hippomat_core.allocation.quantise import FULL_SCALE
from hippomat_core.errors import ConfigError

FRACTION = 1.0 / FULL_SCALE  # cost in c_max = (code x FRACTION)^2
FEATURES = 10  # of an edge, in the order of edge_features
AGE = 8  # the one of them that says how old the row is
NEAREST = 3  # the scale is the mean of every row's so many smallest costs
LEAST_SCALE = 1e-4  # of c_max: below the cost of code 3, where rounding is all there is
COST_SPAN, DIFFERENCE_SPAN, RATIO_SPAN, AGE_SPAN_ROUNDS = (
    20.0,
    4.0,
    4.0,
    40.0,
)  # features are clipped to these
WEAKEST_SHARE = -8.0  # a log-softmax below this says no more
SHARE_SIZE = 0.3  # brings a log-softmax to the size of the embeddings
PRICE_SIZE = 2.0  # in the scale: what one unit of learned price counts
LOGIT_SPAN = 30.0  # the head's logits end so far below the best: exp(-30) is as good as never
WAIT_EXTRA = 1e-3  # in the scale: at equal totals an available robot requests
CLOSED_EXTRA = 4.0  # in the scale: a task out of reach costs so much more than the dearest one in reach


@dataclass(frozen=True, slots=True)
class GraphSageSettings:
    """Temperatures count in the snapshot's scale (graphsage_edges)."""

    hops: int = 5  # rounds of message passing between the edges of a row and of a column
    width: int = 16  # of an edge's embedding
    hidden: int = 32  # of the edge net and of every hop's residual net
    heads: int = 4  # attention heads of a hop
    head: bool = True  # annealed potentials, from the learned prices; False: the learned scores alone
    head_steps: int = 48
    tau_first: float = 1.0
    tau_last: float = 0.001
    relaxation: float = 1.75  # of every step of the potentials; 1 = plain, below 2
    head_temperature: float = 0.05  # of the head's logits; changes what is drawn, never the best action
    look_ahead: bool = True  # busy robots take part with the time until they could be at each task
    wait_factor: float = 2.0  # waiting costs so many times the mean over tasks of the soonest arrival

    def __post_init__(self) -> None:
        for name, low, high in _RANGES:
            value = getattr(self, name)
            if not low <= value <= high:
                raise ConfigError(
                    f"policy setting {name} = {value!r} is outside {low} .. {high}: export the policy again"
                )

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> GraphSageSettings:
        """ConfigError names a setting that is unknown or of another type, or too large."""
        types = {name: type(default) for name, default in asdict(cls()).items()}
        for name, value in values.items():
            if name not in types:
                raise ConfigError(f"policy setting {name!r} is unknown; known: {', '.join(types)}")
            if not _fits(value, types[name]):
                raise ConfigError(f"policy setting {name} = {value!r} is not {types[name].__name__}")
        try:
            return cls(**{name: types[name](value) for name, value in values.items()})
        except OverflowError:  # JSON knows integers that no float holds
            raise ConfigError("a policy setting is too large a number: export the policy again") from None


_RANGES = (
    ("hops", 0, 16),
    ("width", 1, 128),
    ("hidden", 1, 256),
    ("heads", 1, 16),
    ("head_steps", 1, 1000),
    ("tau_first", 1e-3, 100.0),
    ("tau_last", 1e-4, 100.0),
    ("relaxation", 0.5, 1.95),
    ("head_temperature", 1e-3, 100.0),
    ("wait_factor", 0.0, 1e3),
)


def _fits(value: object, kind: type) -> bool:
    if kind is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
