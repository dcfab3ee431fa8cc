"""The plan as data: what is trained, on what budget, in what order."""

import dataclasses

import pytest

from cruise.config import RewardWeights, TrainConfig
from cruise.errors import CruiseError
from cruise.presets import CURRICULUM, PAPER_TRACKS, REWARDS, training_config
from cruise.storage.config_file import to_data
from cruise.training.curriculum import plan_phases
from cruise.training.validation import check_config
from experiments.commands import reproduce_command, train_command
from experiments.plan import (
    ABLATIONS,
    ENTRANTS,
    KINDS,
    Job,
    choose,
    config_of,
    full_scale,
    make_plan,
    quick_scale,
)
from tests.helpers import flat

SCALES = {"full": full_scale(), "quick": quick_scale()}
LEARNED = [name for name, kind in KINDS.items() if kind.family == "learned"]


def steps_of(config: TrainConfig) -> int:
    return plan_phases(config)[-1].last_update * config.ppo.races * config.ppo.rollout_steps


@pytest.mark.parametrize("name", SCALES)
def test_every_job_has_a_name_of_its_own_and_a_configuration_that_works(name):
    scale = SCALES[name]
    plan = make_plan(scale)
    assert len({job.name for job in plan}) == len(plan)
    for job in plan:
        if job.family == "learned":
            check_config(config_of(job, scale))


def test_the_full_plan_is_the_one_asked_for():
    count = {kind: sum(job.kind == kind for job in make_plan(full_scale())) for kind in KINDS}
    six, ablation = 2 * 3 * 3, 2 * 3
    everywhere = dict.fromkeys((*ENTRANTS, "vanilla-stage5", "self-play-only"), six)
    assert count == dict.fromkeys(ABLATIONS, ablation) | everywhere | {"head-to-head": 2 * 2 * 3}


def test_something_whole_comes_first():
    plan = make_plan(full_scale())
    first = [(job.kind, job.seed) for job in plan]
    assert first[:12] == [("cruise", 0)] * 6 + [("vanilla", 0)] * 6
    seeds = [job.seed for job in plan if job.kind in ENTRANTS]
    assert seeds == sorted(seeds)
    last_entrant = max(i for i, job in enumerate(plan) if job.kind in ENTRANTS)
    assert last_entrant < min(i for i, job in enumerate(plan) if job.kind in ABLATIONS)


def test_races_come_after_those_who_race():
    plan = make_plan(full_scale())
    for i, job in enumerate(plan):
        if job.kind == "head-to-head":
            assert {Job(kind, job.track, job.drones, job.seed) for kind in ENTRANTS} <= set(plan[:i])


@pytest.mark.parametrize("name", SCALES)
def test_all_but_one_kind_train_for_as_many_steps(name):
    scale = SCALES[name]
    update = scale.base(4).ppo.races * scale.base(4).ppo.rollout_steps
    steps = {kind: steps_of(config_of(Job(kind, "ring", 4, 0), scale)) for kind in LEARNED}
    last = CURRICULUM[-1].steps / sum(stage.steps for stage in CURRICULUM)
    for kind, done in steps.items():
        budget = scale.steps * (last if kind == "vanilla-stage5" else 1)
        assert budget - update < done <= budget, kind


def changed(kind: str) -> dict:
    """What a kind's configuration changes."""
    mine = flat(to_data(config_of(Job(kind, "ring", 4, 0), full_scale())))
    usual = flat(to_data(TrainConfig()))
    return {key: value for key, value in mine.items() if value != usual[key]}


def test_kinds_differ_in_what_they_are_named_for():
    assert changed("cruise") == {}
    assert changed("vanilla") == {"vanilla": True, "opponents.self_play": "off"}
    assert changed("vanilla-stage5") == {"vanilla": True, "opponents.self_play": "off", "step_scale": 0.5}
    assert changed("self-play-only") == {"vanilla": True}
    assert changed("curriculum-only") == {"opponents.self_play": "off"}
    assert changed("self-play-after") == {"opponents.self_play": "after"}
    assert changed("copies-only") == {"opponents.sparring_share": 0.0}
    assert changed("paper-observation") == {"observation": "paper"}
    assert {key.partition(".")[0] for key in changed("paper-reward")} == {"reward", "ppo"}
    assert changed("paper-reward")["ppo.after_crash"] == "nothing"
    assert config_of(Job("paper-reward", "ring", 4, 0), full_scale()).reward == REWARDS["paper"]


def test_who_sees_opponents_in_training():
    for kind, sees in {"cruise": True, "self-play-only": True, "vanilla": False, "curriculum-only": False}.items():
        phases = plan_phases(config_of(Job(kind, "ring", 4, 0), full_scale()))
        assert all(phase.alone != sees and phase.self_play == sees for phase in phases)
        assert len(phases) == (1 if "vanilla" in kind or kind == "self-play-only" else len(CURRICULUM))


def test_words_choose_jobs():
    plan = make_plan(full_scale())
    assert choose(plan, []) == plan
    assert choose(plan, ["cruise", "ring", "4", "s0"]) == (Job("cruise", "ring", 4, 0),)
    both = choose(plan, ["cruise", "vanilla", "ring", "2"])
    assert {job.kind for job in both} == {"cruise", "vanilla"}
    assert {(job.track, job.drones) for job in both} == {("ring", 2)}
    assert len(both) == 2 * 3
    with pytest.raises(
        CruiseError, match=r"--only 'rnig' fits nothing: cruise, vanilla, .*; ring, figure-eight; 2, 3, 4;"
    ):
        choose(plan, ["rnig"])


def test_commands_say_what_differs():
    job = Job("cruise", "figure-eight", 3, 1)
    assert reproduce_command(job, full_scale()) == "cruise reproduce --only cruise figure-eight 3 s1"
    assert reproduce_command(job, quick_scale()) == "cruise reproduce --quick --only cruise figure-eight 3 s1"
    assert train_command(config_of(job, full_scale())) == "cruise train --track figure-eight --drones 3 --seed 1"
    vanilla = config_of(Job("vanilla-stage5", "ring", 2, 0), full_scale())
    assert train_command(vanilla) == (
        "cruise train --track ring --drones 2 --seed 0 --vanilla --step-scale 0.5 --self-play off"
    )
    assert vanilla.ppo == training_config(drones=2).ppo != TrainConfig().ppo
    preset = config_of(Job("paper-reward", "ring", 2, 0), full_scale())
    assert train_command(preset).endswith("--seed 0 --after-crash nothing --reward-preset paper")
    own = dataclasses.replace(TrainConfig(), reward=RewardWeights(w_prog=1.0))
    assert train_command(own).endswith("--seed 0 --w-prog 1.0")


def test_all_tracks_are_planned():
    assert full_scale().tracks == tuple(PAPER_TRACKS)
