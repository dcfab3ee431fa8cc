// A drone: body, arms and spinning rotors, a shadow under it and a line down to the ground.

import {
  BoxGeometry,
  BufferGeometry,
  CanvasTexture,
  CapsuleGeometry,
  CircleGeometry,
  Color,
  CylinderGeometry,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  Line,
  LineBasicMaterial,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  PlaneGeometry,
} from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

const ARM = 0.17; // from the middle to a rotor [m]
const ROTOR = 0.085; // radius [m]
const ABOVE = 0.045; // rotors are above the middle [m]
const SPIN = 47; // as fast as a blade can turn before the eye sees it turn back [rad/s]
const CORNERS = [45, 135, 225, 315].map((degrees) => (degrees * Math.PI) / 180);
const FADED = 0.3; // opacity of who is no longer in the race
const GHOST = 0.35; // opacity of a ghost

export class Drone {
  constructor(drone) {
    this.drone = drone;
    this.group = new Group(); // at the drone's place
    this.body = new Group(); // turned and scaled
    this.own = new MeshStandardMaterial({ roughness: 0.45, emissiveIntensity: 0.45, transparent: true });
    this.dark = new MeshStandardMaterial({ roughness: 0.6, transparent: true });
    this.disc = new MeshBasicMaterial({ transparent: true, side: DoubleSide, depthWrite: false });
    this.body.add(new Mesh(SHELL, this.own), new Mesh(ARMS, this.dark), new Mesh(DISCS, this.disc));
    this.rotors = CORNERS.map((angle, k) => this.#addRotor(angle, k));
    this.shadow = new Mesh(SHADOW, new MeshBasicMaterial({ transparent: true, depthWrite: false, color: 0 }));
    this.shadow.renderOrder = -1;
    this.plumb = new Line(PLUMB, new LineBasicMaterial({ transparent: true, opacity: 0.35 }));
    this.group.add(this.body, this.plumb);
    this.group.add(this.shadow);
    this.colour = new Color();
    this.grey = new Color();
  }

  #addRotor(angle, k) {
    const rotor = new Group();
    rotor.position.set(ARM * Math.cos(angle), ARM * Math.sin(angle), ABOVE);
    rotor.add(new Mesh(BLADES, Math.cos(angle) > 0 ? this.own : this.dark));
    rotor.userData.turn = k % 2 ? 1 : -1;
    this.body.add(rotor);
    return rotor;
  }

  paint(theme, colour) {
    this.colour.set(colour);
    this.grey.set(theme.crashed);
    this.dark.color.set(theme.arms);
    this.plumb.material.color.set(theme.gate);
    this.shadowOpacity = theme.shadow;
    this.shadow.material.map = shadowTexture();
  }

  /** Put it where the flight has it at `t`; `status` is "flying", "finished" or "crashed". */
  update(t, status) {
    const { position, attitude } = this.drone.flight.at(t);
    this.group.position.set(...position);
    this.body.quaternion.set(...attitude);
    const turning = status === "flying" && t > 0;
    this.rotors.forEach((rotor, k) => (rotor.rotation.z = rotor.userData.turn * (turning ? SPIN * t + k : k)));
    this.#dress(status);
    this.shadow.position.z = this.plumb.position.z = 0.02 - position[2];
    this.plumb.scale.z = Math.max(position[2] - 0.02, 0.001);
    const spread = 1 + position[2] / 6;
    this.shadow.scale.setScalar(spread * this.body.scale.x);
    this.shadow.material.opacity = (this.shadowOpacity * this.own.opacity) / spread;
  }

  #dress(status) {
    const opacity = this.drone.ghost ? GHOST : status === "finished" ? FADED : 1;
    const colour = status === "crashed" ? this.grey : this.colour;
    this.own.color.copy(colour);
    this.own.emissive.copy(colour);
    this.disc.color.copy(colour);
    this.own.opacity = this.dark.opacity = opacity;
    this.disc.opacity = (status === "flying" ? 0.28 : 0.08) * opacity;
    this.plumb.visible = status === "flying" && !this.drone.ghost;
  }

  /** Draw it larger than it is, so that it can be found from afar. */
  enlarge(scale) {
    this.body.scale.setScalar(scale);
  }

  /** From inside, a drone does not see itself. */
  hide(hidden) {
    this.body.visible = !hidden;
  }
}

const SHELL = mergeGeometries([
  new CapsuleGeometry(0.055, 0.12, 6, 14).rotateZ(Math.PI / 2).scale(1, 1, 0.62),
  new BoxGeometry(0.05, 0.06, 0.04).translate(0.085, 0, 0.03),
]);
const ARMS = mergeGeometries(
  CORNERS.flatMap((angle) => [
    new BoxGeometry(ARM, 0.022, 0.016).translate(ARM / 2, 0, 0).rotateZ(angle),
    new CylinderGeometry(0.018, 0.022, 0.045, 12)
      .rotateX(Math.PI / 2)
      .translate(ARM * Math.cos(angle), ARM * Math.sin(angle), 0.02),
  ]),
);
const BLADES = mergeGeometries([
  new BoxGeometry(2 * ROTOR, 0.016, 0.006),
  new CylinderGeometry(0.012, 0.012, 0.014, 10).rotateX(Math.PI / 2),
]);
const DISCS = mergeGeometries(
  CORNERS.map((angle) => new CircleGeometry(ROTOR, 28).translate(ARM * Math.cos(angle), ARM * Math.sin(angle), ABOVE)),
);
const SHADOW = new PlaneGeometry(0.9, 0.9);
const PLUMB = new BufferGeometry().setAttribute("position", new Float32BufferAttribute([0, 0, 0, 0, 0, 1], 3));

let texture = null;

/** A soft round spot. */
function shadowTexture() {
  if (texture) return texture;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const context = canvas.getContext("2d");
  const gradient = context.createRadialGradient(32, 32, 0, 32, 32, 32);
  gradient.addColorStop(0, "rgba(255,255,255,1)");
  gradient.addColorStop(1, "rgba(255,255,255,0)");
  context.fillStyle = gradient;
  context.fillRect(0, 0, 64, 64);
  texture = new CanvasTexture(canvas);
  return texture;
}
