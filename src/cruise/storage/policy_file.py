"""Trained policies on disk: parameters in `NAME.safetensors`, what they are in `NAME.json` beside it."""

import dataclasses
import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import ObservationKind, Track, Vehicle
from cruise.env.observation import check_observation
from cruise.errors import CruiseError
from cruise.pilots.network import ActorCritic, NetworkShape
from cruise.pilots.neural import NeuralPilot
from cruise.racing.track_file import track_faults
from cruise.storage import policy_paths, tensors
from cruise.storage.atomic import read_bytes, write_atomically
from cruise.storage.config_file import from_json, to_json
from cruise.storage.policy_paths import StrPath, find_policy, stem_of, with_ending
from cruise.terms import Entry
from cruise.vehicles import VEHICLES, name_of, vehicle_faults

FORMAT_VERSION = 2  # 1: an extended observation in which opponents did not fade with distance
MAX_WIDTH = 65_536  # of a layer
STORED = np.float32  # whatever JAX computes with
USUAL_VEHICLE = "paper"  # where nobody names another
GENERALIST = "generalist"  # the shipped policy that flies tracks it has never seen


@dataclass(frozen=True)
class PolicyMeta:
    """What one must know to fly a policy, and where it comes from."""

    name: str
    track: str
    drones: int  # in the races it was trained for
    vehicle: str | Vehicle  # name of the preset, or all numbers of a vehicle of one's own
    observation: ObservationKind
    agility: float  # scale of its actions
    steps: int  # environment steps of all who learned in training
    seed: int  # of the training
    version: str  # of the program that trained it
    config: Any = field(default_factory=dict)  # of the run, resolved: a dataclass, read back as nested dictionaries
    results: dict[str, Any] = field(default_factory=dict)  # as `cruise evaluate --json` measured it
    steps_before: int = 0  # of the policy that this one learned on from, and of those before it
    flown_on: Track | None = None  # the track itself, where it was kept; None where every race had another one
    layout: tuple[Entry, ...] = ()  # of its observation; files from before 0.2 have none

    @property
    def all_steps(self) -> int:
        """Environment steps of all who learned since its networks were random."""
        return self.steps_before + self.steps

    @property
    def critic_observation(self) -> str:
        """What its value network observed; empty: the same as the policy."""
        return self.config.get("critic_observation", "") if isinstance(self.config, dict) else ""


@dataclass(frozen=True)
class _Description:
    """The JSON file."""

    format: int
    policy: PolicyMeta
    network: NetworkShape
    sha256: str  # of the parameters' file


@dataclass(frozen=True)
class Policy:
    """Parameters and what belongs to them."""

    meta: PolicyMeta
    params: ActorCritic

    def pilot(self) -> NeuralPilot:
        """The policy as a pilot."""
        meta = self.meta
        seen = (meta.observation, meta.drones, meta.agility, meta.name, meta.vehicle, meta.layout)
        return NeuralPilot(self.params, *seen)


def save_policy(path: StrPath, params: ActorCritic, meta: PolicyMeta) -> Path:
    """Write a policy as `.safetensors` and `.json`, each whole or not at all, and give the path of the first.

    The JSON is written last and holds the checksum of the parameters, so halves of two policies do not pass for one.

    Args:
        path: where; its ending does not matter.
        params: the networks; finite.
        meta: what the policy is.

    Raises:
        CruiseError: parameters or `meta` are not sound, or the files cannot be written.
    """
    stem = stem_of(Path(path))
    where = f"policy {stem}"
    arrays = {name: _as_stored(np.asarray(leaf)) for name, leaf in _named(params).items()}
    network = params.shape
    _check_meta(meta, network, where)
    _check_params(arrays, network, where)
    data = tensors.encode(arrays)
    text = to_json(_Description(FORMAT_VERSION, meta, network, hashlib.sha256(data).hexdigest()))
    write_atomically(with_ending(stem, ".safetensors"), data)
    write_atomically(with_ending(stem, ".json"), text.encode())
    return with_ending(stem, ".safetensors")


def load_policy(name_or_path: StrPath) -> NeuralPilot:
    """A policy, ready to fly.

    Args:
        name_or_path: name of a shipped policy (`ring-4`; see `list_policies`), path of a `.safetensors` or `.json`
            file or of both without their ending, or the folder of a training run.

    Raises:
        CruiseError: there is no such policy, or its files are damaged or do not belong together.
    """
    policy = read_policy(name_or_path)
    check_observation(f"policy {stem_of(Path(name_or_path))}", policy.meta.observation)
    return policy.pilot()


def read_policy(name_or_path: StrPath) -> Policy:
    """Parameters and what belongs to them; see `load_policy`."""
    stem = find_policy(name_or_path)
    description = _read_description(stem)
    where = f"policy {with_ending(stem, '.safetensors')}"
    data = read_bytes(with_ending(stem, ".safetensors"), "policy")
    arrays, _ = tensors.decode(data, where)
    _check_params(arrays, description.network, where)
    if hashlib.sha256(data).hexdigest() != description.sha256:
        raise CruiseError(
            f"{where}: checksum differs from that in {with_ending(stem, '.json').name}; they are not one policy"
        )
    template = _template(description.network)
    leaves = [jnp.asarray(arrays[name]) for name in _named(template)]
    return Policy(description.policy, jax.tree.unflatten(jax.tree.structure(template), leaves))


def read_meta(name_or_path: StrPath) -> PolicyMeta:
    """What a policy is, without its parameters. Raises CruiseError as `load_policy` does."""
    return _read_description(find_policy(name_or_path)).policy


def _read_description(stem: Path) -> _Description:
    path = with_ending(stem, ".json")
    where = f"policy description {path}"
    description = from_json(read_bytes(path, "policy description"), _Description, where)
    if description.format != FORMAT_VERSION:
        raise CruiseError(f"{where}: format {description.format}, this program reads {FORMAT_VERSION}")
    _check_meta(description.policy, description.network, where)
    if not isinstance(description.policy.config, dict):
        raise CruiseError(f"{where}: policy.config: expected an object")
    if stem.parent == policy_paths.SHIPPED:  # known by the name of its file
        return dataclasses.replace(description, policy=dataclasses.replace(description.policy, name=stem.name))
    return description


def list_policies() -> dict[str, PolicyMeta]:
    """Names of the shipped policies and what they are, in order of track and number of drones."""
    metas = {path.stem: read_meta(path) for path in policy_paths.SHIPPED.glob("*.json")}
    return dict(sorted(metas.items(), key=lambda item: (item[1].track, item[1].drones, item[0])))


def shipped_name(track: str, drones: int, vehicle: str | Vehicle = USUAL_VEHICLE) -> str:
    """Name of the shipped policy of a track and a vehicle: `TRACK-DRONES` for the paper's, `VEHICLE-TRACK` for others.

    One that was trained alone is for a drone alone: it has met nobody. Then the one for several is VEHICLE-TRACK-field.
    For a drone alone on a track for which there is none it is the `GENERALIST`, where that flies the vehicle. For a
    vehicle that is no preset none is shipped.

    Raises:
        CruiseError: there is none; it names those there are.
    """
    names = [] if isinstance(vehicle, Vehicle) else _names(track, drones, vehicle)
    there = [name for name in names if with_ending(policy_paths.SHIPPED / name, ".json").is_file()]
    name = next((name for name in there if _is_for(read_meta(name), drones, vehicle)), None)
    if name is None:
        known = ", ".join(list_policies()) or "none"
        raise CruiseError(
            f"no policy is shipped for {_asked(track, drones, vehicle)}; shipped: {known}; "
            f"name another, or another pilot, or train one: {_training(track, drones, vehicle)}"
        )
    return name


def _names(track: str, drones: int, vehicle: str) -> list[str]:
    first = f"{track}-{drones}" if vehicle == USUAL_VEHICLE else f"{vehicle}-{track}"
    return [first, GENERALIST if drones == 1 else f"{vehicle}-{track}-field"]


def _is_for(meta: PolicyMeta, drones: int, vehicle: str | Vehicle) -> bool:
    return meta.vehicle == vehicle and (drones == 1 or meta.drones > 1)


def _asked(track: str, drones: int, vehicle: str | Vehicle) -> str:
    other = "" if vehicle == USUAL_VEHICLE else f" and vehicle {name_of(vehicle)!r}"
    return f"track {track!r} with {drones} drone{'s' * (drones != 1)}{other}"


def _training(track: str, drones: int, vehicle: str | Vehicle) -> str:
    """The command that trains one; a vehicle of one's own has a file, whose name nobody remembers here."""
    choice = "FILE.toml" if isinstance(vehicle, Vehicle) else vehicle
    return f"cruise train --vehicle {choice} --track {track} --drones {drones}"


def _template(network: NetworkShape) -> ActorCritic:
    """The networks as shapes."""
    shapes = eqx.filter_eval_shape(ActorCritic, network, 0.0, jax.random.key(0))
    return jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, STORED), shapes)


def _as_stored(array: np.ndarray) -> np.ndarray:
    """What was trained in double precision is rounded; what is too great for that is infinite, and refused as such."""
    with np.errstate(over="ignore"):
        return array.astype(STORED) if array.dtype == np.float64 else array


def _named(params: Any) -> dict[str, Any]:
    """Leaves by names such as `actor.layers[0].weight`."""
    leaves = jax.tree_util.tree_leaves_with_path(params)
    return {jax.tree_util.keystr(path).removeprefix("."): leaf for path, leaf in leaves}


def _check_meta(meta: PolicyMeta, network: NetworkShape, where: str) -> None:
    sizes = {"drones": meta.drones, "observation_size": network.observation_size, "action_size": network.action_size}
    sizes |= {f"hidden[{i}]": size for i, size in enumerate(network.hidden)}
    sizes |= {"memory_size": network.memory_size} if network.kind == "gru" else {}
    sizes |= {"critic_observation_size": network.critic_observation_size} if network.critic_observation_size else {}
    for name, size in sizes.items():
        if not 1 <= size <= MAX_WIDTH:
            raise CruiseError(f"{where}: {name} must be from 1 to {MAX_WIDTH}, got {size}")
    if not 0 < meta.agility < np.inf:
        raise CruiseError(f"{where}: agility must be above 0 and finite, got {meta.agility}")
    if meta.flown_on is not None and (faults := track_faults(meta.flown_on)):
        raise CruiseError(f"{where}: flown_on: {faults[0]}")
    if isinstance(meta.vehicle, Vehicle):
        for fault in vehicle_faults(meta.vehicle):
            raise CruiseError(f"{where}: vehicle {meta.vehicle.name!r}: {fault}")
    elif meta.vehicle not in VEHICLES:
        raise CruiseError(f"{where}: unknown vehicle {meta.vehicle!r}; vehicles: {', '.join(VEHICLES)}")


def _check_params(arrays: dict[str, np.ndarray], network: NetworkShape, where: str) -> None:
    wanted = _named(_template(network))
    tensors.check_names(arrays, wanted, where)
    for name, leaf in wanted.items():
        tensors.check_array(name, arrays[name], leaf.shape, np.dtype(leaf.dtype), where)
        if not np.isfinite(arrays[name]).all():
            raise CruiseError(f"{where}: array {name!r} holds numbers that are not finite")
