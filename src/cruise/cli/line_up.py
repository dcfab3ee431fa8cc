"""Who races where: the flags that `cruise race` and `cruise evaluate` share."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cruise.config import OUR_SIMULATOR, Firmware, FirmwareSettings, Sensing, Track
from cruise.errors import CruiseError
from cruise.presets import TRACKS
from cruise.racing.track_file import RANDOM_KINDS, load_track

if TYPE_CHECKING:
    from cruise.evaluation.matches import Match
    from cruise.storage.policy_file import PolicyMeta

DEFAULT_TRACK = "ring"
DEFAULT_DRONES = 4


def described(metavar: str) -> Any:
    """How help shows a flag whose description says its default."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


@dataclass(frozen=True)
class LineUp:
    """Who races where."""

    track: Annotated[str | None, described("NAME|FILE")] = None
    """Built-in track, or path of a TOML file. By default the one the policy was trained on, or ring."""
    drones: Annotated[int | None, described("N")] = None
    """How many drones race. By default as many as the policy was trained for; one per --pilot, where several are given
    and none needs a field of its size; or 4."""
    policy: Annotated[str | None, described("NAME|PATH")] = None
    """Flies every drone: a shipped policy, a .safetensors file or the folder of a run. By default the one shipped."""
    pilot: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("NAME|PATH|FILE.py:NAME")] = ()
    """Flies one drone: a policy as above, an exported .onnx file, one of chaser, hover, se-ibr and se-ibr-tuned, or a
    pilot of your own in Python, as FILE.py:NAME or MODULE:NAME, whose code is run. Repeat it, once per drone; fewer
    take turns."""
    vehicle: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("NAME|FILE")] = ()
    """What all of them fly: a built-in vehicle (`cruise vehicles` lists them), or path of a TOML file. By default what
    the pilots were made for, or paper. Repeat it for a mixed field, once per drone as --pilot; fewer take turns."""
    terms: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, described("FILE.py")] = ()
    """Python file that declares observations of your own, which a policy observes by; its code is run. Repeatable."""
    randomise: Annotated[float, described("SHARE")] = 0.0
    """Strength of the domain randomisation: 0 is off, 1 is all that a real drone may differ by, 2 the most."""
    simulator: Annotated[str, described("NAME")] = OUR_SIMULATOR
    """What moves the drones: cruise, or one of mujoco, rotorpy, crazyflow and betaflight, each an extra of that name;
    betaflight is the firmware of racing drones."""
    betaflight_settings: FirmwareSettings = "matched"
    """Gains of the firmware: computed from the vehicle, or those it comes with."""
    betaflight_cli: Annotated[Path | None, described("FILE")] = None
    """Output of `diff all` of a real drone: the firmware is set as that is."""
    budget_ms: float = 10_000.0
    """Time for each action of a pilot in Python; one that takes longer ends the race with an error [ms]."""
    spread_starts: Annotated[float, described("SHARE")] = 0.0
    """Share of races that start all along a track which has a start of its own."""
    sensing: Sensing = field(default_factory=Sensing)

    def match(self, laps: int | None = None) -> "Match":
        """The match that the flags describe. Raises CruiseError where they do not go together."""
        from cruise.evaluation.matches import make_match  # noqa: PLC0415  (imports JAX)
        from cruise.evaluation.race_choices import find_sensing, find_spread  # noqa: PLC0415
        from cruise.pilots.terms_file import load_all_terms  # noqa: PLC0415

        if self.policy is not None and self.pilot:
            raise CruiseError("--policy flies every drone and --pilot one of them: give one or the other")
        load_all_terms(self.terms)
        choices = [self.policy] if self.policy is not None else list(self.pilot)
        metas = _metas(choices)
        track = load_track(self.track) if self.track is not None else usual_track(*metas[:1])
        drones = self.drones if self.drones is not None else _usual_drones(metas, choices, len(self.vehicle))
        vehicle = self.vehicle or None
        match = make_match(track, drones, choices or None, laps, self.budget_ms / 1e3, vehicle, self.randomise)
        sensing, spread = find_sensing(self.sensing), find_spread(self.spread_starts, track)
        match = replace(match, sensing=sensing, spread_starts=spread)
        return replace(match, simulator=self.simulator, firmware=self.firmware())

    def firmware(self) -> Firmware:
        """How the firmware is set. Raises CruiseError where its file is no output of `diff all`."""
        if self.betaflight_cli is None:
            return Firmware(self.betaflight_settings)
        from cruise.interop.betaflight.settings import read_cli  # noqa: PLC0415  (imports JAX)

        return Firmware("stock", read_cli(self.betaflight_cli))


def _metas(choices: list[str]) -> "list[PolicyMeta]":
    """What the trained ones among the pilots are."""
    from cruise.evaluation.pilot_choice import pilot_meta  # noqa: PLC0415

    metas = [pilot_meta(choice) for choice in dict.fromkeys(choices)]
    return [meta for meta in metas if meta is not None]


def usual_track(meta: "PolicyMeta | None" = None) -> Track:
    """The track that a policy was trained on, which it has kept. Raises CruiseError where it is not at hand."""
    if meta is None:
        return TRACKS[DEFAULT_TRACK]
    if meta.flown_on is not None:
        return meta.flown_on
    trained_on = meta.config.get("track", meta.track)
    if meta.track in (*TRACKS, *RANDOM_KINDS):
        return load_track(meta.track)
    if isinstance(trained_on, str) and Path(trained_on).is_file():
        track = load_track(trained_on)  # of a policy from before they kept their tracks
        if track.name == meta.track:
            return track
    raise CruiseError(f"policy {meta.name!r} was trained on track {meta.track!r}, not a built-in one: give its --track")


def _usual_drones(metas: "list[PolicyMeta]", choices: list[str], vehicles: int) -> int:
    from cruise.env.observation import for_any_field  # noqa: PLC0415  (imports JAX)

    if max(len(choices), vehicles) > 1 and all(for_any_field(meta.observation) for meta in metas):
        return max(len(choices), vehicles)
    return metas[0].drones if metas else DEFAULT_DRONES
