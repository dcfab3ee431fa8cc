"""Which stage is trained when: the paper's five, VANILLA's one, and where self-play comes in."""

from dataclasses import dataclass, replace

from cruise.config import Stage, TrainConfig
from cruise.presets import curriculum_of
from cruise.vehicles import find_vehicle

AFTER_SHARE = 0.5  # of the last stage's budget that `self_play="after"` gives to the phase with opponents


@dataclass(frozen=True)
class Phase:
    """A stretch of training under one set of rules."""

    number: int  # of the stage, from 1
    stage: Stage
    alone: bool  # opponents stay on the ground
    self_play: bool  # opponents are replaced by Algorithm 1
    first_update: int
    last_update: int  # exclusive


def _stages(config: TrainConfig) -> list[tuple[int, Stage, bool, bool]]:
    """(number, stage, alone, self_play) in order."""
    curriculum = curriculum_of(find_vehicle(config.vehicle))
    numbered = list(enumerate(curriculum, start=1))
    mode = config.opponents.self_play
    if config.vanilla:
        total = sum(stage.steps for stage in curriculum)
        numbered = [(len(curriculum), replace(curriculum[-1], steps=total))]
    if mode == "within":
        return [(k, stage, False, True) for k, stage in numbered]
    plan = [(k, stage, True, False) for k, stage in numbered]
    if mode == "after":
        k, last, _, _ = plan.pop()
        shared = int(last.steps * AFTER_SHARE)
        plan.append((k, replace(last, steps=last.steps - shared), True, False))
        plan.append((k, replace(last, name=f"{last.name} self-play", steps=shared), False, True))
    return plan


def plan_phases(config: TrainConfig) -> tuple[Phase, ...]:
    """The phases of a run in whole updates, never more steps than the budget."""
    per_update = config.steps_per_update
    phases, steps, start = [], 0.0, 0
    for number, stage, alone, self_play in _stages(config):
        steps += stage.steps * config.step_scale
        end = int(steps // per_update)
        phases.append(Phase(number, stage, alone or config.drones == 1, self_play and config.drones > 1, start, end))
        start = end
    return tuple(phases)
