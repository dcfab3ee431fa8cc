// Four ways to look at a race. All but the free one are functions of time alone, so a seek shows what playing shows.

import { MathUtils, Matrix4, Quaternion, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { poses } from "../data/motion.js";
import { rim } from "./gates.js";
import { cornersOf } from "./solids.js";

export const CAMERAS = ["orbit", "chase", "first-person", "top"];

const FIELDS = { orbit: 32, chase: 60, "first-person": 80, top: 30 }; // of view, vertical or across the narrow side [deg]
const WIDEST = 88; // a tall picture shows less at the sides instead of bending what it shows [deg]
const HOME = { azimuth: -62, elevation: 30 }; // of the free camera at first [deg]
const CHASE = { behind: 2.3, above: 0.75, ahead: 1.6 }; // [m]
const UPTILT = { body: 25, flight: 10 }; // of the camera in the nose against the body [deg]
const LEAST_HEIGHT = 0.25; // of the chasing camera [m]
const ROOM = 0.2; // beside the frames of gates [m]
const SPARE = 0.9; // above gates, for their numbers [m]
const TALLEST = 2.5; // solids are looked for no higher than this above the highest gate [m]
const SMALLEST = 4; // reach of a scene from its middle, at least [m]
const FARTHEST = 12; // the free camera can go away, over the reach of the scene
const HORIZON = 40; // how far is seen, over the reach of the scene
const NEAR = { least: 0.05, share: 2e-3 }; // what is nearer is not drawn [m], over the distance of what is looked at
const UP = new Vector3(0, 0, 1);

export class Cameras {
  constructor(camera, element) {
    this.camera = camera;
    this.mode = "orbit";
    this.orbit = new OrbitControls(camera, element);
    Object.assign(this.orbit, { enableDamping: false, minDistance: 0.5, maxPolarAngle: 1.55 });
    this.home = null; // where the free camera is; null until it is placed
    this.moved = false; // by the user
    this.orbit.addEventListener("start", () => (this.moved = true));
    this.free = { left: 0, right: 0, top: 0, bottom: 0 }; // pixels covered by panels
    this.size = { width: 1, height: 1 };
    this.shift = [0, 0]; // of the picture's middle, away from the panels [px]
    this.points = [];
    this.middle = new Vector3();
    this.reach = SMALLEST;
  }

  /** What the free camera and the one above must show: the track's gates down to the ground. */
  frame(race) {
    const rims = race.gates.flatMap(poses).flatMap((gate) => rim(gate, race.frame_width + ROOM));
    const tops = rims.map(({ x, y, z }) => new Vector3(x, y, z + SPARE));
    const highest = Math.max(...rims.map(({ z }) => z)) + TALLEST;
    const corners = race.solids.flatMap(cornersOf);
    corners.forEach((corner) => (corner.z = Math.min(Math.max(corner.z, 0), highest)));
    this.points = [...rims, ...corners].map(({ x, y }) => new Vector3(x, y, 0)).concat(tops, corners);
    this.middle = this.points.reduce((sum, point) => sum.add(point), new Vector3()).divideScalar(this.points.length);
    this.reach = Math.max(SMALLEST, ...this.points.map((point) => point.distanceTo(this.middle)));
    this.orbit.maxDistance = FARTHEST * this.reach;
    this.camera.far = HORIZON * this.reach;
    this.reset();
  }

  reset() {
    this.home = null;
    this.moved = false;
  }

  /** The size of the canvas and how far panels reach into it from each side [px]. */
  resize(size, free) {
    this.size = size;
    this.free = free;
    if (!this.moved) this.home = null;
  }

  choose(mode) {
    if (this.mode === "orbit" && this.home) this.#keepHome();
    this.mode = mode;
  }

  #keepHome() {
    this.home = { position: this.camera.position.clone(), target: this.orbit.target.clone() };
  }

  /** Place the camera for a drone of a race at a time. */
  place(race, drone, t) {
    const { camera } = this;
    const centred = this.mode === "chase" || this.mode === "first-person";
    this.orbit.enabled = this.mode === "orbit";
    camera.up.copy(UP);
    this.#project(FIELDS[this.mode], centred ? { left: 0, right: 0, top: 0, bottom: 0 } : this.free);
    if (this.mode === "orbit") this.#free();
    if (this.mode === "chase") this.#chase(race, drone, t);
    if (this.mode === "first-person") this.#ride(race, drone, t);
    if (this.mode === "top") this.#above();
    // A scene of a kilometre and one of a room: as near as the picture needs, or distant things flicker.
    const away = centred ? 0 : camera.position.distanceTo(this.middle) - this.reach;
    camera.near = Math.max(NEAR.least, NEAR.share * away);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }

  /** A field of view across the narrow side of what panels leave free, and its middle as the middle of the picture. */
  #project(field, { left, right, top, bottom }) {
    const { width, height } = this.size;
    const { camera } = this;
    camera.aspect = width / height;
    const narrow = Math.min(1, camera.aspect);
    camera.fov = MathUtils.radToDeg(2 * Math.atan(Math.tan(MathUtils.degToRad(field) / 2) / narrow));
    camera.fov = Math.min(camera.fov, WIDEST);
    this.shift = [(left - right) / 2, (top - bottom) / 2];
    camera.setViewOffset(width, height, -this.shift[0], -this.shift[1], width, height);
  }

  #free() {
    if (this.home === null) {
      const [azimuth, elevation] = [HOME.azimuth, HOME.elevation].map(MathUtils.degToRad);
      const flat = Math.cos(elevation);
      const direction = new Vector3(Math.cos(azimuth) * flat, Math.sin(azimuth) * flat, Math.sin(elevation));
      this.home = this.#fit(direction, UP);
      this.camera.position.copy(this.home.position);
      this.orbit.target.copy(this.home.target);
    } else if (this.restore) {
      this.camera.position.copy(this.home.position);
      this.orbit.target.copy(this.home.target);
    }
    this.restore = false;
    this.orbit.update();
    this.#keepHome();
  }

  #above() {
    this.restore = true;
    const { width, height } = this.#freeSize();
    const [low, high] = extent(this.points);
    const turned = high.x - low.x > high.y - low.y !== width > height;
    const up = turned ? new Vector3(-1, 0, 0) : new Vector3(0, 1, 0);
    const { position, target } = this.#fit(new Vector3(0, 0, 1), up);
    this.camera.up.copy(up);
    this.camera.position.copy(position);
    this.camera.lookAt(target);
  }

  #freeSize() {
    const { left, right, top, bottom } = this.free;
    return {
      width: Math.max(1, this.size.width - left - right),
      height: Math.max(1, this.size.height - top - bottom),
    };
  }

  /** Position and target from which a direction shows all points as large as the free part of the picture allows. */
  #fit(direction, up) {
    const view = new Matrix4().lookAt(direction, new Vector3(), up).invert();
    const seen = this.points.map((point) => point.clone().applyMatrix4(view));
    const { width, height } = this.#freeSize();
    const tangent = Math.tan(MathUtils.degToRad(this.camera.fov) / 2);
    const limit = [(tangent * width) / this.size.height, (tangent * height) / this.size.height];
    const target = this.middle.clone().applyMatrix4(view);
    const low = 0.1;
    let distance = 4 * this.reach;
    for (let round = 0; round < 40; round++) {
      const [share, middle] = spread(seen, target, distance, limit);
      target.x += middle[0];
      target.y += middle[1];
      const nearest = Math.max(...seen.map((point) => point.z - target.z));
      distance = Math.max(nearest + low, distance * (0.25 + 0.75 * share));
    }
    const back = view.clone().invert();
    const aim = target.clone().applyMatrix4(back);
    return { position: aim.clone().addScaledVector(direction, distance), target: aim };
  }

  #chase(race, drone, t) {
    this.restore = true;
    const [x, y, z] = drone.flight.at(t).position;
    const [hx, hy] = race.headingAt(drone, t);
    const height = Math.max(z + CHASE.above, LEAST_HEIGHT);
    this.camera.position.set(x - CHASE.behind * hx, y - CHASE.behind * hy, height);
    this.camera.lookAt(x + CHASE.ahead * hx, y + CHASE.ahead * hy, z + 0.25);
  }

  #ride(race, drone, t) {
    this.restore = true;
    const { position, attitude } = drone.flight.at(t);
    const turn = new Quaternion(...attitude);
    const up = new Vector3(0, 0, 1).applyQuaternion(turn);
    const forward = new Vector3(1, 0, 0).applyQuaternion(turn);
    if (race.first_person === "flight") {
      forward.set(...race.headingAt(drone, t), 0);
      forward.addScaledVector(up, -forward.dot(up)).normalize();
    }
    const tilt = MathUtils.degToRad(UPTILT[race.first_person]);
    const look = forward.clone().multiplyScalar(Math.cos(tilt)).addScaledVector(up, Math.sin(tilt));
    this.camera.position
      .set(...position)
      .addScaledVector(forward, 0.08)
      .addScaledVector(up, 0.05);
    this.camera.up.copy(up);
    this.camera.lookAt(look.add(this.camera.position));
  }
}

/** How much of the limits points take seen from a distance, and where the middle of what they take lies [m]. */
function spread(points, target, distance, limit) {
  const [low, high] = [
    [Infinity, Infinity],
    [-Infinity, -Infinity],
  ];
  for (const point of points) {
    const depth = Math.max(distance - (point.z - target.z), 0.05);
    [point.x - target.x, point.y - target.y].forEach((offset, axis) => {
      low[axis] = Math.min(low[axis], offset / depth);
      high[axis] = Math.max(high[axis], offset / depth);
    });
  }
  const share = Math.max(...limit.map((most, axis) => (high[axis] - low[axis]) / 2 / most));
  return [share, limit.map((_, axis) => ((low[axis] + high[axis]) / 2) * distance)];
}

function extent(points) {
  const [low, high] = [new Vector3(Infinity, Infinity, Infinity), new Vector3(-Infinity, -Infinity, -Infinity)];
  points.forEach((point) => (low.min(point), high.max(point)));
  return [low, high];
}
