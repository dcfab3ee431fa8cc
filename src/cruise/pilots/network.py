"""The policy and value networks: two separate ones, multilayer perceptrons as in the paper or with a memory each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.config import NetworkKind

Carry = Any  # what a network remembers from step to step, batch axes last; () where it remembers nothing


class Perceptron(eqx.Module):
    """Tanh layers and a linear head. Features lead, batch axes trail."""

    layers: tuple[eqx.nn.Linear, ...]

    def __init__(self, sizes: Sequence[int], head_gain: float, key: Array) -> None:
        """Orthogonal weights with gain sqrt(2) (`head_gain` on the head), biases zero."""
        keys = jax.random.split(key, len(sizes) - 1)
        gains = [jnp.sqrt(2.0)] * (len(sizes) - 2) + [jnp.asarray(head_gain)]
        layers = []
        for fan_in, fan_out, gain, k in zip(sizes[:-1], sizes[1:], gains, keys, strict=True):
            layer = eqx.filter_eval_shape(eqx.nn.Linear, fan_in, fan_out, key=k)  # drawn here, not there
            weight = gain * jax.nn.initializers.orthogonal()(k, (fan_out, fan_in), jnp.float32)
            layers.append(
                eqx.tree_at(lambda la: (la.weight, la.bias), layer, (weight, jnp.zeros(fan_out, jnp.float32)))
            )
        self.layers = tuple(layers)

    def __call__(self, x: Float[Array, "I *B"], first: int = 0) -> Float[Array, "O *B"]:
        """Output for a batch whose axes trail: a matrix product per layer, no transpose, from layer `first` on."""
        ones = (1,) * (x.ndim - 1)
        for i, layer in enumerate(self.layers[first:], first):
            assert layer.bias is not None
            x = jnp.tensordot(layer.weight, x, axes=1) + layer.bias.reshape(-1, *ones)
            if i < len(self.layers) - 1:
                x = jnp.tanh(x)
        return x

    @property
    def sizes(self) -> tuple[int, ...]:
        """Of the input, of every layer, and of the output."""
        return (int(self.layers[0].in_features), *(int(layer.out_features) for layer in self.layers))

    def init_carry(self, batch: tuple[int, ...]) -> Carry:
        """It remembers nothing."""
        del batch
        return ()

    def step(self, carry: Carry, x: Float[Array, "I *B"]) -> tuple[Carry, Float[Array, "O *B"]]:
        """The output, whatever came before."""
        return carry, self(x)

    def unroll(
        self, carry: Carry, x: Float[Array, "T I E"], begins: Bool[Array, "T E"]
    ) -> tuple[Carry, Float[Array, "O T E"]]:
        """Outputs of a sequence; see `Recurrent.unroll`."""
        del begins
        return carry, self(jnp.moveaxis(x, 0, 1))


class Recurrent(eqx.Module):
    """A gated recurrent unit (Cho et al., 2014) and a perceptron that reads its state."""

    cell: eqx.nn.GRUCell
    head: Perceptron

    def __init__(self, sizes: Sequence[int], memory: int, head_gain: float, key: Array) -> None:
        """`sizes` as of a perceptron, whose first layer reads `memory` numbers. Orthogonal weights, biases zero."""
        keys = jax.random.split(key, 7)
        orthogonal = jax.nn.initializers.orthogonal()

        def weight(keys: Array, columns: int) -> Array:
            return jnp.concatenate([orthogonal(k, (memory, columns), jnp.float32) for k in keys])

        cell = eqx.filter_eval_shape(eqx.nn.GRUCell, sizes[0], memory, key=keys[0])
        parts = (
            weight(keys[0:3], sizes[0]),
            weight(keys[3:6], memory),
            jnp.zeros(3 * memory, jnp.float32),
            jnp.zeros(memory, jnp.float32),
        )
        self.cell = eqx.tree_at(lambda c: (c.weight_ih, c.weight_hh, c.bias, c.bias_n), cell, parts)
        self.head = Perceptron((memory, *sizes[1:]), head_gain, keys[6])

    @property
    def sizes(self) -> tuple[int, ...]:
        """Of the input, of the head's layers, and of the output."""
        return (int(self.cell.input_size), *self.head.sizes[1:])

    def init_carry(self, batch: tuple[int, ...]) -> Float[Array, "H *B"]:
        """The state before anything was seen."""
        return jnp.zeros((int(self.cell.hidden_size), *batch), jnp.float32)

    def step(self, carry: Float[Array, "H *B"], x: Float[Array, "I *B"]) -> tuple[Carry, Float[Array, "O *B"]]:
        """The state after seeing `x`, and the output."""
        carry = self._next(carry, self._read(x))
        return carry, self.head(carry)

    def unroll(
        self, carry: Float[Array, "H E"], x: Float[Array, "T I E"], begins: Bool[Array, "T E"]
    ) -> tuple[Carry, Float[Array, "O T E"]]:
        """The state after a sequence, and the outputs on the way; where an episode `begins` the state is empty."""
        read = jax.vmap(self._read)(x)

        def step(carry: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
            read, begins = row
            carry = self._next(jnp.where(begins, 0.0, carry), read)
            return carry, carry

        carry, states = jax.lax.scan(step, carry, (read, begins))
        return carry, self.head(jnp.moveaxis(states, 0, 1))

    def _read(self, x: Float[Array, "I *B"]) -> Float[Array, "R *B"]:
        """What the input contributes to reset gate, update gate and candidate."""
        assert self.cell.bias is not None
        return jnp.tensordot(self.cell.weight_ih, x, axes=1) + self.cell.bias.reshape(-1, *(1,) * (x.ndim - 1))

    def _next(self, state: Float[Array, "H *B"], read: Float[Array, "R *B"]) -> Float[Array, "H *B"]:
        """H' = (1 - z) n + z h, n = tanh(W x + r (U h + b)), as `equinox.nn.GRUCell` does for one."""
        assert self.cell.bias_n is not None
        reset, update, new = jnp.split(read, 3)
        of_reset, of_update, of_new = jnp.split(jnp.tensordot(self.cell.weight_hh, state, axes=1), 3)
        bias = self.cell.bias_n.reshape(-1, *(1,) * (state.ndim - 1))
        candidate = jnp.tanh(new + jax.nn.sigmoid(reset + of_reset) * (of_new + bias))
        return candidate + jax.nn.sigmoid(update + of_update) * (state - candidate)


Network = Perceptron | Recurrent


@dataclass(frozen=True)
class NetworkShape:
    """Kind and sizes of the networks, as policy files hold them."""

    observation_size: int  # of what the policy sees
    action_size: int
    hidden: tuple[int, ...]  # widths of the layers; in a recurrent network of those behind its memory
    kind: NetworkKind = "mlp"
    memory_size: int = 0  # numbers that each network remembers
    critic_observation_size: int = 0  # of what the value network sees; 0: as many numbers as the policy


class Carries(NamedTuple):
    """What both networks remember."""

    actor: Carry
    critic: Carry


class ActorCritic(eqx.Module):
    """A Gaussian policy with a state-independent standard deviation, and a value function."""

    actor: Any  # a Network
    critic: Any  # a Network
    log_std: Float[Array, "A"]

    def __init__(self, shape: NetworkShape, initial_log_std: float, key: Array) -> None:
        """Initialise both networks; the actor's head starts near zero."""
        actor_key, critic_key = jax.random.split(key)
        judged = shape.critic_observation_size or shape.observation_size

        def network(sizes: Sequence[int], head_gain: float, key: Array) -> Network:
            if shape.kind == "gru":
                return Recurrent(sizes, shape.memory_size, head_gain, key)
            return Perceptron(sizes, head_gain, key)

        self.actor = network((shape.observation_size, *shape.hidden, shape.action_size), 0.01, actor_key)
        self.critic = network((judged, *shape.hidden, 1), 1.0, critic_key)
        self.log_std = jnp.full(shape.action_size, initial_log_std, jnp.float32)  # not weakly typed, as updates make it

    @property
    def shape(self) -> NetworkShape:
        """What it was made with; a value network that sees as many numbers as the policy is said to see the same."""
        first, *hidden, last = self.actor.sizes
        critic = self.critic.sizes[0]
        memory = int(self.actor.cell.hidden_size) if isinstance(self.actor, Recurrent) else 0
        kind: NetworkKind = "gru" if self.has_memory else "mlp"
        return NetworkShape(first, last, tuple(hidden), kind, memory, 0 if critic == first else critic)

    @property
    def has_memory(self) -> bool:
        """Whether what it does depends on what it saw before."""
        return isinstance(self.actor, Recurrent)

    def init_carry(self, batch: tuple[int, ...] = ()) -> Carry:
        """What the policy remembers at the start of a race; nothing, at no cost, where it has no memory."""
        return self.actor.init_carry(batch)

    def apply(self, carry: Carry, observation: Float[Array, "O *B"]) -> tuple[Carry, Float[Array, "A *B"]]:
        """What the policy remembers after this observation, and the deterministic action, not yet clipped."""
        return self.actor.step(carry, observation)

    def init_carries(self, batch: tuple[int, ...] = ()) -> Carries:
        """What both networks remember at the start of a race."""
        return Carries(self.actor.init_carry(batch), self.critic.init_carry(batch))

    def act_and_judge(
        self, carries: Carries, observation: Float[Array, "O *B"], judged: Float[Array, "C *B"] | None = None
    ) -> tuple[Carries, Float[Array, "A *B"], Float[Array, "*B"]]:
        """Memories, deterministic action and expected return; the value network sees `judged`, or if None the same."""
        if judged is None and not self.has_memory:
            return carries, *self.mean_and_value(observation)
        actor, mean = self.actor.step(carries.actor, observation)
        critic, value = self.critic.step(carries.critic, observation if judged is None else judged)
        return Carries(actor, critic), mean, value[0]

    def unroll(
        self,
        carries: Carries,
        observation: Float[Array, "T O E"],
        judged: Float[Array, "T C E"] | None,
        begins: Bool[Array, "T E"],
    ) -> tuple[Float[Array, "A T E"], Float[Array, "T E"]]:
        """`act_and_judge` along whole sequences, from what both networks remembered before the first step."""
        _, mean = self.actor.unroll(carries.actor, observation, begins)
        _, value = self.critic.unroll(carries.critic, observation if judged is None else judged, begins)
        return mean, value[0]

    def mean_action(self, observation: Float[Array, "O *B"]) -> Float[Array, "A *B"]:
        """The deterministic action of a policy without memory, not yet clipped."""
        assert isinstance(self.actor, Perceptron), "a policy with memory is asked by `apply`"
        return self.actor(observation)

    def value(self, observation: Float[Array, "O *B"]) -> Float[Array, "*B"]:
        """Expected discounted return by a value network without memory."""
        assert isinstance(self.critic, Perceptron), "a value network with memory is asked by `act_and_judge`"
        return self.critic(observation)[0]

    def mean_and_value(self, observation: Float[Array, "O *B"]) -> tuple[Float[Array, "A *B"], Float[Array, "*B"]]:
        """Both at once: the first layers see the same numbers, so that one product serves them."""
        assert isinstance(self.actor, Perceptron)
        assert isinstance(self.critic, Perceptron)
        actor, critic = self.actor.layers[0], self.critic.layers[0]
        parts = (actor.weight, actor.bias), (critic.weight, critic.bias)
        weight, bias = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), *parts)
        hidden = jnp.tanh(jnp.tensordot(weight, observation, axes=1) + bias.reshape(-1, *(1,) * (observation.ndim - 1)))
        width = len(actor.weight)
        return self.actor(hidden[:width], 1), self.critic(hidden[width:], 1)[0]


def emptied(carry: Carry, begins: Bool[Array, "E"]) -> Carry:
    """What is remembered, nothing of the races that begin anew."""
    return jax.tree.map(lambda leaf: jnp.where(begins, 0.0, leaf), carry)
