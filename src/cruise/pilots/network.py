"""The policy and value networks: two separate multilayer perceptrons, as in the paper."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Params = "ActorCritic"


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
            layers.append(eqx.tree_at(lambda la: (la.weight, la.bias), layer, (weight, jnp.zeros(fan_out))))
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


class ActorCritic(eqx.Module):
    """A Gaussian policy with a state-independent standard deviation, and a value function."""

    actor: Perceptron
    critic: Perceptron
    log_std: Float[Array, "A"]

    def __init__(
        self, observation_size: int, action_size: int, hidden: Sequence[int], initial_log_std: float, key: Array
    ) -> None:
        """Initialise both networks; the actor's head starts near zero."""
        actor_key, critic_key = jax.random.split(key)
        self.actor = Perceptron((observation_size, *hidden, action_size), 0.01, actor_key)
        self.critic = Perceptron((observation_size, *hidden, 1), 1.0, critic_key)
        self.log_std = jnp.full(action_size, initial_log_std, jnp.float32)  # not weakly typed, as updates make it

    def mean_action(self, observation: Float[Array, "O *B"]) -> Float[Array, "A *B"]:
        """The deterministic action, not yet clipped."""
        return self.actor(observation)

    def value(self, observation: Float[Array, "O *B"]) -> Float[Array, "*B"]:
        """Expected discounted return."""
        return self.critic(observation)[0]

    def mean_and_value(self, observation: Float[Array, "O *B"]) -> tuple[Float[Array, "A *B"], Float[Array, "*B"]]:
        """Both at once: the first layers see the same numbers, so that one product serves them."""
        actor, critic = self.actor.layers[0], self.critic.layers[0]
        parts = (actor.weight, actor.bias), (critic.weight, critic.bias)
        weight, bias = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), *parts)
        hidden = jnp.tanh(jnp.tensordot(weight, observation, axes=1) + bias.reshape(-1, *(1,) * (observation.ndim - 1)))
        width = len(actor.weight)
        return self.actor(hidden[:width], 1), self.critic(hidden[width:], 1)[0]
