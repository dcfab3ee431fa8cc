"""Tables of terms, in Markdown, from their declarations alone."""

from collections.abc import Iterable, Sequence

from cruise.config import RewardWeights
from cruise.env.payment import REWARD_TERMS, make_reward
from cruise.terms import FRAMES, PHASES, Entry, Observation, RewardTerm, Setting


def observation_table(observation: Observation, setting: Setting) -> str:
    """Every term of an observation, in the order of the vector."""
    rows, first = [], 0
    for term in observation.terms_for(setting):
        rows.append((_places(first, term.size), f"`{term.name}`", term.quantity, *_scaled(term), term.frame))
        first += term.size
    return markdown(("numbers", "term", "quantity", "divided by", "bounds", "frame"), rows)


def observation_size(observation: Observation, setting: Setting) -> int:
    """How many numbers it has."""
    return sum(term.size for term in observation.terms_for(setting))


def frames_table() -> str:
    """What the frames are."""
    return markdown(("frame", "axes"), [(name, axes) for name, axes in FRAMES.items()])


def reward_table(weights: Sequence[tuple[str, RewardWeights]]) -> str:
    """Every term of the reward, with its weight for each of some named weights, then the terms that users declared."""
    rewards = [make_reward(one) for _, one in weights]
    rows = [
        (f"`{term.name}`", term.phase, term.meaning, *(_weight(reward.terms[place]) for reward in rewards))
        for place, term in enumerate(rewards[0].terms)
    ]
    rows += [(f"`{t.name}`", t.phase, t.meaning, *[_weight(t)] * len(rewards)) for t in REWARD_TERMS.values()]
    return markdown(("term", "phase", "times the weight", *(name for name, _ in weights)), rows)


def phases_table() -> str:
    """When the terms of each phase count."""
    return markdown(("phase", "counts"), list(PHASES.items()))


def markdown(titles: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; bars within its cells are told from those between them."""
    listed = [tuple(titles), *(tuple(cell.replace("|", "\\|") for cell in row) for row in rows)]
    lines = ["| " + " | ".join(row) + " |" for row in listed]
    return "\n".join([lines[0], "|" + "---|" * len(listed[0]), *lines[1:]])


def _places(first: int, size: int) -> str:
    return str(first) if size == 1 else f"{first} to {first + size - 1}"


def _scaled(term: Entry) -> tuple[str, str]:
    return f"{term.scale:g} {term.unit}".strip(), f"{term.low:g} to {term.high:g}"


def _weight(term: RewardTerm) -> str:
    return "by stage" if callable(term.weight) else f"{term.weight + 0.0:g}"
