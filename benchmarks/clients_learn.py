"""What goes on where a snippet of docs/clients.md ends: each library's own learner, for `STEPS` environment steps.

Each takes the names that the snippet has made. It gives steps and their rate where no counter of ours sees them.
"""

import contextlib
import os
import sys
import time
from pathlib import Path
from typing import Any

STEPS = 10_000
ROLLOUT = 128
Names = dict[str, Any]


def used(process: int) -> float:
    """Processor time of a process and of all that it has started [s], from /proc: a busy machine has no other clock."""
    told = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            words = file.read_text().rpartition(")")[2].split()
            told[int(file.parent.name)] = int(words[1]), sum(map(int, words[11:15]))
    family, grown = {process}, 0
    while len(family) > grown:
        grown = len(family)
        family |= {one for one, (parent, _) in told.items() if parent in family}
    return sum(told[one][1] for one in family if one in told) / os.sysconf("SC_CLK_TCK")


def as_cleanrl(names: Names) -> None:
    """PPO in one file: a rollout, advantages, minibatches, as CleanRL's `ppo_continuous_action.py` has them."""
    import numpy as np
    import torch
    from torch import nn

    envs = names["envs"]
    size, acts = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]

    def network(out: int) -> nn.Module:
        return nn.Sequential(nn.Linear(size, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, out))

    actor, critic, log_std = network(acts), network(1), nn.Parameter(torch.zeros(acts))
    parameters = [*actor.parameters(), *critic.parameters(), log_std]
    optimiser = torch.optim.Adam(parameters, lr=3e-4)
    seen = torch.as_tensor(envs.reset(seed=1)[0])
    for _ in range(STEPS // (ROLLOUT * envs.num_envs) + 1):
        rows = []
        for _ in range(ROLLOUT):
            with torch.no_grad():
                policy = torch.distributions.Normal(actor(seen), log_std.exp())
                action, value = policy.sample(), critic(seen)[:, 0]
            after, reward, terminated, truncated, _ = envs.step(action.numpy())
            ended = torch.as_tensor(np.logical_or(terminated, truncated)).float()
            rows.append((seen, action, policy.log_prob(action).sum(-1), value, torch.as_tensor(reward).float(), ended))
            seen = torch.as_tensor(after)
        following, later, advantages = critic(seen)[:, 0].detach(), torch.zeros(envs.num_envs), []
        for _, _, _, value, reward, ended in reversed(rows):
            later = reward + 0.99 * following * (1 - ended) - value + 0.99 * 0.95 * (1 - ended) * later
            following = value
            advantages.insert(0, later)
        flown = [torch.cat(column) for column in zip(*rows, strict=True)]
        gain = torch.cat(advantages)
        for batch in torch.randperm(len(gain)).chunk(4):
            policy = torch.distributions.Normal(actor(flown[0][batch]), log_std.exp())
            ratio = (policy.log_prob(flown[1][batch]).sum(-1) - flown[2][batch]).exp()
            better = (gain[batch] - gain[batch].mean()) / (gain[batch].std() + 1e-8)
            loss = -torch.min(ratio * better, ratio.clamp(0.8, 1.2) * better).mean()
            loss = loss + 0.5 * ((critic(flown[0][batch])[:, 0] - (gain + flown[3])[batch]) ** 2).mean()
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(parameters, 0.5)
            optimiser.step()


def supersuit(names: Names) -> None:
    """Stable-Baselines3's PPO."""
    from stable_baselines3 import PPO

    env = names["env"]
    PPO("MlpPolicy", env, n_steps=256, batch_size=256, device="cpu").learn(STEPS)
    env.close()  # or its workers, and this process, never end


def rllib(names: Names) -> tuple[int, float]:
    """Its PPO."""
    config = names["config"].training(train_batch_size=2000, minibatch_size=500, num_epochs=2)
    algorithm = config.build_algo()
    steps, began, first = 0, 0.0, 0
    while steps < STEPS:
        steps = int(algorithm.train()["num_env_steps_sampled_lifetime"])
        if not began:
            began, first = used(os.getpid()), steps
    rate = (steps - first) / (used(os.getpid()) - began)
    algorithm.stop()
    return steps, rate


def torchrl(names: Names) -> None:
    """Its collector, estimator and PPO loss."""
    import torch
    from tensordict.nn import NormalParamExtractor, TensorDictModule
    from torch import nn
    from torchrl.collectors import Collector
    from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator
    from torchrl.objectives import ClipPPOLoss
    from torchrl.objectives.value import GAE

    env = names["env"]
    acts = env.action_spec.shape[-1]
    mean = nn.Sequential(MLP(out_features=2 * acts, num_cells=[64, 64]), NormalParamExtractor())
    module = TensorDictModule(mean, in_keys=["observation"], out_keys=["loc", "scale"])
    actor = ProbabilisticActor(
        module, in_keys=["loc", "scale"], distribution_class=TanhNormal, return_log_prob=True, spec=env.action_spec
    )
    critic = ValueOperator(MLP(out_features=1, num_cells=[64, 64]), in_keys=["observation"])
    for part in (actor, critic):
        part(env.reset())  # sizes of lazy layers
    loss, estimate = ClipPPOLoss(actor, critic), GAE(gamma=0.99, lmbda=0.95, value_network=critic)
    optimiser = torch.optim.Adam(loss.parameters(), lr=3e-4)
    for batch in Collector(env, actor, frames_per_batch=1000, total_frames=STEPS):
        estimate(batch)
        for rows in torch.randperm(len(batch)).chunk(4):
            parts = loss(batch[rows])
            optimiser.zero_grad()
            sum(value for name, value in parts.items() if name.startswith("loss_")).backward()
            optimiser.step()


def torchrl_agents(names: Names) -> None:
    """Rollouts of all agents."""
    steps = 0
    while steps < STEPS:
        steps += 2 * len(names["env"].rollout(500))


def tianshou(names: Names) -> None:
    """Its PPO and trainer."""
    import torch
    from tianshou.algorithm import PPO
    from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.data import Collector, VectorReplayBuffer
    from tianshou.trainer import OnPolicyTrainerParams
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic

    env, envs = names["env"], names["envs"]
    shape, acts = env.observation_space.shape, env.action_space.shape
    actor = ContinuousActorProbabilistic(
        preprocess_net=Net(state_shape=shape, hidden_sizes=[64, 64]), action_shape=acts, unbounded=True
    )
    critic = ContinuousCritic(preprocess_net=Net(state_shape=shape, hidden_sizes=[64, 64]))
    policy = ProbabilisticActorPolicy(
        actor=actor,
        dist_fn=lambda both: torch.distributions.Independent(torch.distributions.Normal(*both), 1),
        action_space=env.action_space,
    )
    ppo = PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=3e-4))
    collector = Collector(ppo, envs, VectorReplayBuffer(4096, len(envs)))
    collector.reset()
    ppo.run_training(
        OnPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=STEPS,
            collection_step_num_env_steps=1000,
            update_step_num_repetitions=2,
            batch_size=250,
        )
    )
    envs.close()


def skrl(names: Names) -> None:
    """Its PPO and trainer."""
    from skrl.agents.torch.ppo import PPO
    from skrl.memories.torch import RandomMemory
    from skrl.trainers.torch import SequentialTrainer
    from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

    env = names["env"]
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    network = [{"name": "net", "input": "OBSERVATIONS", "layers": [64, 64], "activations": "tanh"}]
    models = {
        "policy": gaussian_model(**spaces, network=network, output="ACTIONS"),
        "value": deterministic_model(**spaces, network=network, output="ONE"),
    }
    memory = RandomMemory(memory_size=ROLLOUT, num_envs=env.num_envs, device=env.device)
    quiet = {"write_interval": 0, "checkpoint_interval": 0}
    agent = PPO(models=models, memory=memory, cfg={"rollouts": ROLLOUT, "experiment": quiet}, **spaces)
    trainer = SequentialTrainer(env=env, agents=agent, cfg={"timesteps": STEPS // env.num_envs + 1, "headless": True})
    trainer.train()


def skrl_agents(names: Names) -> None:
    """Its IPPO and trainer."""
    from skrl.memories.torch import RandomMemory
    from skrl.multi_agents.torch.ippo import IPPO
    from skrl.trainers.torch import SequentialTrainer
    from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

    env, models = names["env"], {}
    network = [{"name": "net", "input": "OBSERVATIONS", "layers": [64, 64], "activations": "tanh"}]
    for agent in env.possible_agents:
        spaces = {"observation_space": env.observation_spaces[agent], "action_space": env.action_spaces[agent]}
        models[agent] = {
            "policy": gaussian_model(**spaces, device=env.device, network=network, output="ACTIONS"),
            "value": deterministic_model(**spaces, device=env.device, network=network, output="ONE"),
        }
    settings = {"rollouts": ROLLOUT, "experiment": {"write_interval": 0, "checkpoint_interval": 0}}
    for given in ("learning_rate_scheduler", "observation_preprocessor", "state_preprocessor", "value_preprocessor"):
        settings[f"{given}_kwargs"] = {agent: {} for agent in models}  # by agent, as its own defaults are not
    agents = IPPO(
        possible_agents=env.possible_agents,
        models=models,
        memories={agent: RandomMemory(memory_size=ROLLOUT, num_envs=1, device=env.device) for agent in models},
        cfg=settings,
        observation_spaces=env.observation_spaces,
        state_spaces=env.state_spaces,
        action_spaces=env.action_spaces,
        device=env.device,
    )
    SequentialTrainer(env=env, agents=agents, cfg={"timesteps": STEPS // len(models), "headless": True}).train()


def agilerl(names: Names) -> None:
    """Its PPO and training loop, a population of one."""
    from agilerl.algorithms import PPO
    from agilerl.training.train_on_policy import train_on_policy

    env = names["env"]
    spaces = (env.single_observation_space, env.single_action_space)
    agent = PPO(*spaces, num_envs=env.num_envs, learn_step=1000, batch_size=250)
    train_on_policy(
        env, "race", "PPO", [agent], max_steps=STEPS, evo_steps=STEPS, eval_steps=100, eval_loop=1, verbose=False
    )
    env.close()


def jaxmarl(names: Names) -> tuple[int, float]:
    """Its script IPPO of continuous actions, unchanged, from the folder `JAXMARL`: a clone of its repository.

    Without one, random actions under its `LogWrapper`.
    """
    import jax
    from jaxmarl.wrappers.baselines import LogWrapper

    scripts = Path(os.environ.get("JAXMARL", "")) / "baselines" / "IPPO"
    if not (scripts / "ippo_ff_mabrax.py").is_file():
        return _timed(
            LogWrapper(names["env"]), lambda env, key: {a: env.action_space(a).sample(key) for a in env.agents}
        )
    sys.path.insert(0, str(scripts))
    import ippo_ff_mabrax as ippo
    import wandb

    wandb.init(mode="disabled")  # as its main does by default

    races, config = 64, {"LR": 1e-3, "NUM_STEPS": 40, "UPDATE_EPOCHS": 4, "NUM_MINIBATCHES": 4, "GAMMA": 0.99}
    config |= {"GAE_LAMBDA": 0.95, "CLIP_EPS": 0.2, "ENT_COEF": 0.0, "VF_COEF": 4.5, "MAX_GRAD_NORM": 0.5}
    config |= {"ACTIVATION": "tanh", "ANNEAL_LR": True, "ENV_NAME": "ring", "ENV_KWARGS": {"drones": 2}}
    config |= {"NUM_ENVS": races, "TOTAL_TIMESTEPS": STEPS}
    first, second = jax.random.split(jax.random.PRNGKey(30))
    train = jax.jit(ippo.make_train(config, first)).lower(second).compile()
    began = time.process_time()
    jax.block_until_ready(train(second))
    steps = STEPS // (races * 40) * races * 40 * 2
    return steps, steps / (time.process_time() - began)


def gymnax(names: Names) -> tuple[int, float]:
    """Random actions under its `LogWrapper`, as PureJaxRL's scripts wrap it."""
    from gymnax.wrappers.purerl import LogWrapper

    return _timed(LogWrapper(names["env"]), lambda env, key: env.action_space(None).sample(key))


def _timed(env: Any, act: Any) -> tuple[int, float]:
    """64 races under `vmap` in one compiled program."""
    import jax

    races, drones = 64, env.num_agents
    length = STEPS // (races * drones) + 1

    def fly(key: Any) -> Any:
        def step(state: Any, key: Any) -> Any:
            keys = jax.random.split(key, races)
            action = jax.vmap(lambda key: act(env, key))(keys)
            _, state, reward, *_ = jax.vmap(env.step)(keys, state, action)
            return state, reward

        _, state = jax.vmap(env.reset)(jax.random.split(key, races))
        return jax.lax.scan(step, state, jax.random.split(key, length))[1]

    flown = jax.jit(fly).lower(jax.random.PRNGKey(0)).compile()
    began = time.process_time()
    jax.block_until_ready(flown(jax.random.PRNGKey(0)))
    steps = length * races * drones
    return steps, steps / (time.process_time() - began)
