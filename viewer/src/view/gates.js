// Gates: solid frames, a strip of light round the opening, lines to the ground and an arrow in the direction of flight.

import {
  BoxGeometry,
  BufferGeometry,
  Color,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  Shape,
  ShapeGeometry,
} from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";

const DEPTH = 0.12; // of a frame along the direction of flight; the simulated one has none [m]
const STRIP = 0.05; // width of the strip of light [m]
const GLOW = 0.9; // how long a gate keeps the colour of the drone that flew through [s]

export class Gates {
  constructor(race) {
    this.group = new Group();
    this.frameMaterial = new MeshStandardMaterial({ roughness: 0.7, metalness: 0.0 });
    this.lineMaterial = new LineBasicMaterial({ transparent: true, opacity: 0.5 });
    this.arrowMaterial = new MeshBasicMaterial({ transparent: true, opacity: 0.55, side: DoubleSide });
    this.gates = race.gates.map((gate) => this.#build(gate, race.frame_width));
    this.crossings = race.gates.map(() => []); // {time, drone} of every gate
    for (const drone of race.racers)
      drone.crossings.forEach((time, k) => this.crossings[race.gateOf(k + 1)].push({ time, drone }));
    this.crossings.forEach((crossings) => crossings.sort((a, b) => a.time - b.time));
    this.colours = { idle: new Color(), next: new Color() };
  }

  #build({ position, yaw, size: [width, height] }, frame) {
    const [x, y, z] = position;
    const group = new Group();
    group.position.set(x, y, z);
    group.rotation.z = yaw;
    const strip = new MeshBasicMaterial();
    group.add(new Mesh(border(width + 2 * STRIP, height + 2 * STRIP, frame - STRIP, DEPTH), this.frameMaterial));
    group.add(new Mesh(border(width, height, STRIP, DEPTH + 0.02), strip));
    group.add(new LineSegments(stilts(width, height, frame, z), this.lineMaterial));
    const arrow = new Mesh(arrowGeometry(), this.arrowMaterial);
    arrow.position.z = 0.012 - z;
    group.add(arrow);
    this.group.add(group);
    return { position, top: [x, y, z + height / 2 + frame], strip };
  }

  paint(theme) {
    this.frameMaterial.color.set(theme.gate);
    this.lineMaterial.color.set(theme.gate);
    this.arrowMaterial.color.set(theme.gate);
    this.colours.idle.set(theme.gateStrip);
    this.colours.next.set(theme.highlight);
  }

  /** Light the gate that `next` (an index, or -1) flies to, and those just flown through in the colour of the drone. */
  update(t, next, colourOf) {
    this.gates.forEach(({ strip }, index) => {
      strip.color.copy(index === next ? this.colours.next : this.colours.idle);
      const last = lastBefore(this.crossings[index], t);
      if (last && t - last.time < GLOW) strip.color.lerp(colourOf(last.drone), 1 - ((t - last.time) / GLOW) ** 2);
    });
  }
}

function lastBefore(crossings, t) {
  let found = null;
  for (const crossing of crossings) {
    if (crossing.time > t) break;
    found = crossing;
  }
  return found;
}

/** Four beams of a width round an opening, in the plane of y and z. */
function border(width, height, beam, depth) {
  const parts = [-1, 1].flatMap((side) => [
    new BoxGeometry(depth, width + 2 * beam, beam).translate(0, 0, (side * (height + beam)) / 2),
    new BoxGeometry(depth, beam, height).translate(0, (side * (width + beam)) / 2, 0),
  ]);
  return mergeGeometries(parts);
}

/** Lines from the lower corners to the ground, where the gate hangs above it. */
function stilts(width, height, frame, z) {
  const [side, low] = [width / 2 + frame / 2, -height / 2 - frame];
  const ground = Math.min(-z, low);
  const points = [-side, side].flatMap((y) => [0, y, low, 0, y, ground]);
  return new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
}

function arrowGeometry() {
  const shape = new Shape();
  shape.moveTo(0.75, 0).lineTo(-0.35, 0.55).lineTo(-0.1, 0).lineTo(-0.35, -0.55).closePath();
  return new ShapeGeometry(shape);
}
