"""The rigid body against MuJoCo's free body under the same wrench."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cruise.dynamics import FreeBody
from cruise.dynamics.integrators import make_integrator
from cruise.dynamics.parameters import physics_of
from cruise.dynamics.rigid_body import Wrench, make_free_derivative
from tests.dynamics.bodies import UNEVEN, body, integrate, wrench
from tests.dynamics.quadrotors import BARE

DT, STEPS = 5e-4, 3000  # 1.5 s

MODEL = """
<mujoco>
  <option timestep="{dt}" integrator="RK4" gravity="0 0 -{g}"/>
  <worldbody>
    <body pos="0 0 0">
      <freejoint/>
      <inertial pos="0 0 0" mass="{m}" diaginertia="{jx} {jy} {jz}"/>
      <site name="centre"/>
    </body>
  </worldbody>
  <actuator>
    <motor site="centre" gear="0 0 1 0 0 0"/>
    <motor site="centre" gear="0 0 0 1 0 0"/>
    <motor site="centre" gear="0 0 0 0 1 0"/>
    <motor site="centre" gear="0 0 0 0 0 1"/>
  </actuator>
</mujoco>
"""

# thrust [N], torque [N m], initial roll, pitch, yaw [rad], initial body rates [rad/s]
CASES = {
    "torque-free wobble": (0.0, (0, 0, 0), (0.1, -0.2, 0.4), (0.5, 0.6, 5.0)),
    "middle axis, unstable": (7.0, (0, 0, 0), (0.0, 0.1, 0.0), (0.05, 2.5, 0.1)),
    "pure yaw torque": (UNEVEN.mass * UNEVEN.gravity, (0, 0, 0.02), (0, 0, -1.0), (0, 0, 0)),
    "everything at once": (9.0, (3e-3, -2e-3, 5e-3), (0.3, 0.2, -0.8), (-1.0, 0.8, 2.0)),
    "hard roll": (12.0, (0.02, 0.0, 0.0), (-0.5, 0.2, 0.3), (0.0, 0.3, -0.5)),
}


def fly_mujoco(thrust: float, torque: tuple, euler: tuple, rates: tuple) -> dict[str, np.ndarray]:
    jx, jy, jz = UNEVEN.inertia
    xml = MODEL.format(dt=DT, g=UNEVEN.gravity, m=UNEVEN.mass, jx=jx, jy=jy, jz=jz)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:3] = 1, 2, 3
    data.qpos[3:] = Rotation.from_euler("ZYX", euler[::-1]).as_quat(scalar_first=True)
    data.qvel[:3] = 1, -2, 0.5  # world
    data.qvel[3:] = rates  # body
    data.ctrl[:] = thrust, *torque  # in the frame of the site, that is of the body
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
    rotation = Rotation.from_quat(data.qpos[3:], scalar_first=True).as_matrix()
    return {"position": data.qpos[:3], "velocity": data.qvel[:3], "rotation": rotation, "rates": data.qvel[3:]}


@pytest.mark.parametrize("case", CASES)
def test_equals_mujocos_free_body(case: str) -> None:
    thrust, torque, euler, rates = CASES[case]
    expected = fly_mujoco(thrust, torque, euler, rates)
    with jax.enable_x64(True):
        start = body((1, 2, 3), (1, -2, 0.5), euler, rates)
        end = integrate(UNEVEN, "rk4", start, wrench(thrust, torque), DT * STEPS, STEPS)
    rotation = Rotation.from_euler("ZYX", np.asarray(end.euler)[::-1]).as_matrix()
    np.testing.assert_allclose(end.position_w, expected["position"], atol=2e-6)
    np.testing.assert_allclose(end.velocity_w, expected["velocity"], atol=5e-6)
    np.testing.assert_allclose(rotation, expected["rotation"], atol=2e-6)
    np.testing.assert_allclose(end.angular_velocity_b, expected["rates"], atol=2e-6)


# The same for a body whose attitude is a quaternion: any attitude and fast tumbling, where Euler angles would end.
TUMBLING = {
    "on its back": (9.0, (3e-3, -2e-3, 5e-3), (3.0, 0.2, -0.8), (-1.0, 0.8, 2.0)),
    "through the vertical": (7.0, (0.0, 0.01, 0.0), (0.0, 1.5, 0.5), (0.5, 6.0, -1.0)),
    "tumbling": (12.0, (0.02, -0.03, 0.01), (-0.5, 0.2, 0.3), (8.0, -5.0, 3.0)),
}


@pytest.fixture(scope="module")
def fly_free():
    """Compiled once for all cases."""
    physics = physics_of(BARE)._replace(mass=UNEVEN.mass, inertia=UNEVEN.inertia)
    step = make_integrator("rk4", make_free_derivative(physics, UNEVEN.gravity, None), DT, substeps=1)

    def fly(start: FreeBody, push: Wrench) -> FreeBody:
        apart = FreeBody(*(tuple(part) for part in start))
        end = jax.lax.fori_loop(0, STEPS, lambda _, body: step(body, push), apart)
        return FreeBody(*(jnp.stack(list(part)) for part in end))

    return jax.jit(fly)


@pytest.mark.parametrize("case", TUMBLING)
def test_a_quaternion_equals_mujocos_free_body(case: str, fly_free) -> None:
    thrust, torque, euler, rates = TUMBLING[case]
    expected = fly_mujoco(thrust, torque, euler, rates)
    with jax.enable_x64(True):
        attitude = Rotation.from_euler("ZYX", euler[::-1]).as_quat(scalar_first=True)
        start = FreeBody(*(jnp.asarray(np.asarray(x, float)) for x in ((1, 2, 3), (1, -2, 0.5), attitude, rates)))
        end = fly_free(start, Wrench(jnp.asarray(float(thrust)), jnp.asarray(torque)))
    rotation = Rotation.from_quat(np.asarray(end.attitude), scalar_first=True).as_matrix()
    np.testing.assert_allclose(end.position_w, expected["position"], atol=2e-5)
    np.testing.assert_allclose(end.velocity_w, expected["velocity"], atol=5e-5)
    np.testing.assert_allclose(rotation, expected["rotation"], atol=2e-5)
    np.testing.assert_allclose(end.angular_velocity_b, expected["rates"], atol=2e-5)
