// The camera in the nose, and the one behind.

import { MathUtils, Quaternion, Vector3 } from "three";

const NOSE = [0.08, 0.05]; // of the camera, forward and up [m]
const CHASE = { behind: 2.4, above: 0.8, ahead: 2 }; // [m]
const SMOOTH = 0.12; // of the chasing camera's turns [s]
const SLOW = 1.5; // who flies slower looks to the next gate [m/s]
const TALLEST = 100; // field of view from top to bottom, at most [deg]

export class PilotCamera {
  constructor(camera) {
    this.camera = camera;
    this.heading = null;
  }

  /** @param fov across the picture [deg] */
  project({ width, height }, fov) {
    const { camera } = this;
    camera.aspect = width / height;
    const across = Math.tan(MathUtils.degToRad(fov) / 2);
    camera.fov = Math.min(MathUtils.radToDeg(2 * Math.atan(across / camera.aspect)), TALLEST);
    camera.near = 0.03;
    camera.updateProjectionMatrix();
  }

  /** @param nose "body" where the drone turns its nose to where it flies  @param gate to look to, or null */
  ride({ position, velocity, attitude }, uptilt, nose, gate) {
    const turn = quaternion.set(...attitude);
    const up = new Vector3(0, 0, 1).applyQuaternion(turn);
    const forward = new Vector3(1, 0, 0).applyQuaternion(turn);
    if (nose === "flight") this.#ahead(forward, up, position, velocity, gate);
    const tilt = MathUtils.degToRad(uptilt);
    const look = forward.clone().multiplyScalar(Math.cos(tilt)).addScaledVector(up, Math.sin(tilt));
    this.camera.position
      .set(...position)
      .addScaledVector(forward, NOSE[0])
      .addScaledVector(up, NOSE[1]);
    this.camera.up.copy(up);
    this.camera.lookAt(look.add(this.camera.position));
    this.camera.updateMatrixWorld();
  }

  #ahead(forward, up, position, velocity, gate) {
    const way = new Vector3(velocity[0], velocity[1], 0);
    if (way.length() < SLOW && gate) way.set(gate.x - position[0], gate.y - position[1], 0);
    const wanted = Math.atan2(way.y, way.x);
    this.#turn(wanted, 0.02);
    forward.set(Math.cos(this.heading), Math.sin(this.heading), 0);
    forward.addScaledVector(up, -forward.dot(up)).normalize();
  }

  #turn(wanted, dt) {
    if (this.heading === null) this.heading = wanted;
    const error = Math.atan2(Math.sin(wanted - this.heading), Math.cos(wanted - this.heading));
    this.heading += error * Math.min(1, dt / SMOOTH);
  }

  /** From behind, level. */
  chase({ position: [x, y, z], velocity, attitude }, gate, dt) {
    const forward = new Vector3(1, 0, 0).applyQuaternion(quaternion.set(...attitude));
    const way = Math.hypot(velocity[0], velocity[1]) > SLOW ? velocity : [forward.x, forward.y];
    this.#turn(Math.atan2(way[1], way[0]), dt);
    const [hx, hy] = [Math.cos(this.heading), Math.sin(this.heading)];
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(x - CHASE.behind * hx, y - CHASE.behind * hy, Math.max(z + CHASE.above, 0.3));
    this.camera.lookAt(x + CHASE.ahead * hx, y + CHASE.ahead * hy, z + 0.2);
    this.camera.updateMatrixWorld();
  }
}

const quaternion = new Quaternion();
