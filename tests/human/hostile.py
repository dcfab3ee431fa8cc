"""Fifty messages that no page of ours sends."""

import json

USUAL = {
    "mode": "assisted",
    "rates": [[100, 500, 0.3]] * 3,
    "tilt": 50,
    "speed": 8,
    "centred": True,
    "name": "Ada",
}


def settings(**changed):
    return json.dumps({"settings": USUAL | changed})


def sticks(values, n=1):
    return json.dumps({"n": n, "sticks": values})


HOSTILE = [
    b"",
    b"\x00\xff\xfe",
    b'{"ready":true}',
    "",
    "ready",
    "{",
    "[" * 1000,
    '{"a":' * 300,
    "null",
    "[]",
    "0",
    '"sticks"',
    "{}",
    '{"ready":false}',
    '{"ready":1}',
    '{"ready":"true"}',
    '{"ready":true,"seat":1}',
    '{"sticks":[0,0,0,0]}',
    '{"n":1}',
    '{"n":1,"sticks":[0,0,0,0],"drone":2}',
    sticks([0, 0, 0, 0], n=-1),
    sticks([0, 0, 0, 0], n=1.5),
    sticks([0, 0, 0, 0], n=2**31),
    sticks([0, 0, 0, 0], n=10**300),
    sticks([0, 0, 0, 0], n=True),
    sticks([0, 0, 0, 0], n=None),
    sticks([0, 0, 0]),
    sticks([0, 0, 0, 0, 0]),
    sticks([0, 0, 0, 1.0001]),
    sticks([-2, 0, 0, 0]),
    sticks([0, 0, 0, None]),
    sticks([0, 0, 0, "0"]),
    sticks([0, 0, 0, True]),
    sticks([0, 0, 0, [0]]),
    sticks({"0": 0}),
    '{"n":1,"sticks":[NaN,0,0,0]}',
    '{"n":1,"sticks":[0,Infinity,0,0]}',
    '{"n":1,"sticks":[0,0,-Infinity,0]}',
    '{"n":1,"sticks":[0,0,0,1e999]}',
    '{"settings":{}}',
    '{"settings":null}',
    settings(mode="hold"),
    settings(mode="__class__"),
    settings(rates=[[100, 500, 0.3]] * 2),
    settings(rates=[[100, 5000, 0.3]] * 3),
    settings(tilt=90),
    settings(speed=-1),
    settings(centred=1),
    settings(name="x" * 25),
    settings(name="a\x1b[2J"),
]
