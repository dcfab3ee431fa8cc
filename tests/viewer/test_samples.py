"""Samples come back as they were packed, to half a step."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from cruise.errors import CruiseError
from cruise.viewer.samples import STEPS, pack_samples, quaternions


def unpack(packed):
    """Columns [T, 11], read back by the words of the module's docstring."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), np.uint8)
    planes = planes.reshape(len(STEPS), 4, packed["count"]).astype(np.uint32)
    zigzag = sum(planes[:, byte] << (8 * byte) for byte in range(4)).astype(np.int64)
    differences = np.where(zigzag % 2 == 0, zigzag // 2, -(zigzag + 1) // 2)
    return (np.cumsum(differences, axis=1) * STEPS[:, None]).T


def flights(samples, size):
    numbers = st.floats(-size, size, width=32)
    return st.tuples(*(arrays(np.float32, (samples, 3), elements=numbers) for _ in range(3)))


@given(st.integers(1, 40).flatmap(lambda samples: flights(samples, 1e4)))
def test_what_was_packed_comes_back(flight):
    position, velocity, euler = flight
    time = 0.02 * np.arange(len(position))
    expected = np.column_stack([time, position, velocity, quaternions(euler)])
    assert (np.abs(unpack(pack_samples(time, *flight)) - expected) <= 0.5 * STEPS + 1e-9).all()


@given(arrays(np.float64, (9, 3), elements=st.floats(-10, 10)))
def test_quaternions_are_the_attitudes(euler):
    w, x, y, z = quaternions(euler).T
    actual = Rotation.from_quat(np.stack([x, y, z, w], axis=1)).as_matrix()
    np.testing.assert_allclose(actual, Rotation.from_euler("ZYX", euler[:, ::-1]).as_matrix(), atol=1e-12)


def test_quaternions_do_not_jump_while_a_drone_turns():
    euler = np.stack([np.zeros(500), np.zeros(500), np.linspace(-20, 20, 500)], axis=1)
    wrapped = np.remainder(euler + np.pi, 2 * np.pi) - np.pi
    assert np.abs(np.diff(quaternions(wrapped), axis=0)).max() < 0.05


def test_a_flight_that_cannot_be_packed_is_refused():
    far = np.full((2, 3), 1e8)
    with pytest.raises(CruiseError, match="cannot be replayed"):
        pack_samples(np.arange(2.0), far, far, np.zeros((2, 3)))
