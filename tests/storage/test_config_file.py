"""Configurations survive the way to disk, and what does not fit is named."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.config import Track, TrainConfig, Vehicle
from cruise.errors import CruiseError
from cruise.presets import REWARDS, TRACKS
from cruise.storage.config_file import from_json, load_config, save_config, to_data, to_json

CONFIG = TrainConfig(reward=REWARDS["paper"])


@pytest.mark.parametrize("value", [CONFIG, TrainConfig(), Vehicle(), *TRACKS.values()], ids=lambda v: type(v).__name__)
def test_round_trip(value, tmp_path):
    save_config(tmp_path / "config.json", value)
    assert load_config(tmp_path / "config.json", type(value)) == value


@given(st.floats(allow_nan=False), st.integers(), st.text(max_size=20))
def test_every_value_survives(number, integer, text):
    config = TrainConfig(step_scale=number, seed=integer, track=text)
    assert from_json(to_json(config), TrainConfig, "") == config


def changed(**changes):
    """JSON of the configuration with values replaced; `a__b` is key b of key a."""
    data = to_data(CONFIG)
    for path, value in changes.items():
        *groups, key = path.split("__")
        place = data
        for group in groups:
            place = place[group]
        place[key] = value
    return json.dumps(data)


MALFORMED = {
    "text for an integer": (changed(seed="3"), "seed: expected an integer, got '3'"),
    "truth for an integer": (changed(seed=True), "seed: expected an integer, got True"),
    "fraction for an integer": (changed(ppo__epochs=1.5), "ppo.epochs: expected an integer, got 1.5"),
    "nothing for an integer": (changed(ppo__epochs=None), "ppo.epochs: expected an integer, got None"),
    "list for a number": (changed(reward__w_prox=[]), "reward.w_prox: expected a number, got []"),
    "number for text": (changed(track=4), "track: expected a string, got 4"),
    "number for truth": (changed(vanilla=1), "vanilla: expected true or false, got 1"),
    "not one of the choices": (changed(ppo__network="all"), "ppo.network: expected one of mlp, gru"),
    "unknown key": (changed(drone=4), "unknown key 'drone'"),
    "unknown keys": (changed(b=4, a=5), "unknown key 'a', 'b'"),
    "unknown nested key": (changed(ppo__epoch=4), "ppo: unknown key 'epoch'"),
    "number for a list": (changed(ppo__hidden=64), "ppo.hidden: expected a list"),
    "text in a list": (changed(ppo__hidden=[64, "x"]), "ppo.hidden[1]: expected an integer, got 'x'"),
    "list for an object": (changed(ppo=[1]), "ppo: expected an object"),
    "not an object": ("[1]", "expected a JSON object, got [1]"),
    "NaN": (changed(reward__w_prox=float("nan")), "not valid JSON (NaN is not a number of JSON)"),
    "key twice": ('{"seed": 1, "seed": 2}', "not valid JSON (key 'seed' occurs twice)"),
    "cut short": (changed()[:-20], "not valid JSON (line 1, column"),
    "empty": ("", "not valid JSON (line 1, column 1"),
    "not text": (b"\xff\x00\x01", "not valid JSON ("),
    "too deep": ("[" * 100_000, "not valid JSON ("),
    "huge integer": ('{"seed": ' + "9" * 10_000 + "}", "not valid JSON ("),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed(case):
    text, message = MALFORMED[case]
    with pytest.raises(CruiseError) as error:
        from_json(text, TrainConfig, "config x.json")
    assert str(error.value).startswith(f"config x.json: {message}")
    assert "\n" not in str(error.value)


def test_fixed_length_and_required_keys():
    data = to_data(TRACKS["ring"])
    data["gates"][1]["position_w"] = [1.0, 2.0]
    with pytest.raises(CruiseError, match=r"^t: gates\[1\].position_w: wrong number of values$"):
        from_json(json.dumps(data), Track, "t")
    del data["gates"][1]["position_w"]
    with pytest.raises(CruiseError, match=r"^t: gates\[1\].position_w: missing$"):
        from_json(json.dumps(data), Track, "t")
