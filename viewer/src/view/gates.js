// Gates: solid frames, a strip of light round the opening, lines to the ground and an arrow in the direction of flight.

import {
  BoxGeometry,
  BufferGeometry,
  Color,
  DoubleSide,
  ExtrudeGeometry,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  Path,
  Shape,
  ShapeGeometry,
  Vector3,
} from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
import { gateAt } from "../data/motion.js";

const DEPTH = 0.12; // of a frame along the direction of flight; the simulated one has none [m]
const STRIP = 0.05; // width of the strip of light [m]
const GLOW = 0.9; // how long a gate keeps the colour of the drone that flew through [s]

export class Gates {
  constructor(race) {
    this.group = new Group();
    this.frameMaterial = new MeshStandardMaterial({ roughness: 0.7, metalness: 0.0 });
    this.lineMaterial = new LineBasicMaterial({ transparent: true, opacity: 0.5 });
    this.arrowMaterial = new MeshBasicMaterial({ transparent: true, opacity: 0.55, side: DoubleSide });
    this.frame = race.frame_width;
    this.gates = race.gates.map((gate) => this.#build(gate));
    this.#add(
      this.group,
      race.gates.filter(({ motion }) => !motion),
    );
    this.moving = race.gates.flatMap((gate, index) => (gate.motion ? [this.#mover(gate, index)] : []));
    this.crossings = race.gates.map(() => []); // {time, drone} of every gate
    for (const drone of race.racers)
      drone.crossings.forEach((time, k) => this.crossings[race.gateOf(k + 1)].push({ time, drone }));
    this.crossings.forEach((crossings) => crossings.sort((a, b) => a.time - b.time));
    this.colours = { idle: new Color(), next: new Color() };
  }

  /** What has a colour of its own. */
  #build(gate) {
    const strip = new Mesh(border(gate, 0, STRIP, DEPTH + 0.02), new MeshBasicMaterial());
    this.group.add(strip);
    return { top: topOf(gate, this.frame), light: strip.material, strip };
  }

  /** The rest of some gates, each kind drawn at once: what costs time is how often something is drawn. */
  #add(group, gates) {
    if (!gates.length) return [];
    const beam = Math.max(this.frame - STRIP, 0.01);
    const all = (build) => mergeGeometries(gates.map(build).map((one) => (one.index ? one.toNonIndexed() : one)));
    const parts = [
      new Mesh(
        all((gate) => border(gate, STRIP, beam, DEPTH)),
        this.frameMaterial,
      ),
      new LineSegments(mergeGeometries(gates.map((gate) => stilts(gate, this.frame))), this.lineMaterial),
      new Mesh(all(arrow), this.arrowMaterial),
    ];
    group.add(...parts);
    return parts;
  }

  /** A gate that moves: strip and frame are carried along, lines to the ground and arrow drawn anew. */
  #mover(gate, index) {
    const [frame, lines, arrows] = this.#add(this.group, [gate]);
    const carried = [this.gates[index].strip, frame];
    carried.forEach((mesh) => (mesh.matrixAutoUpdate = false));
    return { gate, index, carried, lines, arrows, fromRest: placed(gate).matrixWorld.invert() };
  }

  #move({ gate, index, carried, lines, arrows, fromRest }, t) {
    const now = gateAt(gate, t);
    const { matrixWorld } = placed(now);
    for (const mesh of carried) {
      mesh.matrix.multiplyMatrices(matrixWorld, fromRest);
      mesh.matrixWorldNeedsUpdate = true;
    }
    lines.geometry.dispose();
    lines.geometry = stilts(now, this.frame);
    arrows.geometry.dispose();
    arrows.geometry = arrow(now);
    this.gates[index].top.copy(topOf(now, this.frame));
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
    this.moving.forEach((mover) => this.#move(mover, t));
    this.gates.forEach(({ light }, index) => {
      light.color.copy(index === next ? this.colours.next : this.colours.idle);
      const last = lastBefore(this.crossings[index], t);
      if (last && t - last.time < GLOW) light.color.lerp(colourOf(last.drone), 1 - ((t - last.time) / GLOW) ** 2);
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

/** A group in the frame of a gate: x along its normal, y to the left, z up. */
function placed({ position, yaw, pitch, roll }) {
  const group = new Group();
  group.position.set(...position);
  group.rotation.set(roll, pitch, yaw, "ZYX"); // Rz(yaw) Ry(pitch) Rx(roll)
  group.updateMatrixWorld();
  return group;
}

/** The corners of an opening, or of its frame `beyond` it, in the world; of a round one its four extremes. */
export function rim(gate, beyond = 0) {
  const { matrixWorld } = placed(gate);
  const [side, height] = gate.size.map((size) => size / 2 + beyond);
  const corners = gate.shape === "round" ? ROUND : SQUARE;
  return corners.map(([y, z]) => new Vector3(0, y * side, z * height).applyMatrix4(matrixWorld));
}

/** Above the middle of a gate, as high as its frame. */
function topOf(gate, frame) {
  const [x, y] = gate.position;
  return new Vector3(x, y, Math.max(...rim(gate, frame).map(({ z }) => z)));
}

const SQUARE = [
  [1, -1],
  [-1, -1],
  [-1, 1],
  [1, 1],
];
const ROUND = [
  [1, 0],
  [-1, 0],
  [0, 1],
  [0, -1],
];

/** A border of a width round an opening, from `inner` beyond its edge on, where the gate stands. */
function border(gate, inner, beam, depth) {
  const flat =
    gate.shape === "round" ? ring(gate.size[0] / 2 + inner, beam, depth) : square(gate.size, inner, beam, depth);
  return flat.applyMatrix4(placed(gate).matrixWorld);
}

/** In the plane of y and z, round the origin. */
function square([width, height], inner, beam, depth) {
  const [across, up] = [width + 2 * inner, height + 2 * inner];
  const parts = [-1, 1].flatMap((side) => [
    new BoxGeometry(depth, across + 2 * beam, beam).translate(0, 0, (side * (up + beam)) / 2),
    new BoxGeometry(depth, beam, up).translate(0, (side * (across + beam)) / 2, 0),
  ]);
  return mergeGeometries(parts);
}

function ring(radius, beam, depth) {
  const disc = new Shape().absarc(0, 0, radius + beam, 0, 2 * Math.PI);
  disc.holes.push(new Path().absarc(0, 0, radius, 0, 2 * Math.PI));
  const options = { depth, bevelEnabled: false, curveSegments: 48 };
  return new ExtrudeGeometry(disc, options).translate(0, 0, -depth / 2).rotateY(Math.PI / 2);
}

/** Lines to the ground from the two lower corners of a frame, or from the sides of a round one. */
function stilts(gate, frame) {
  const corners = rim(gate, frame / 2);
  const feet = gate.shape === "round" ? corners.slice(0, 2) : corners.sort((a, b) => a.z - b.z).slice(0, 2);
  const points = feet.flatMap(({ x, y, z }) => [x, y, Math.max(z, 0), x, y, 0]);
  return new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
}

function arrow({ position: [x, y], yaw }) {
  const shape = new Shape();
  shape.moveTo(0.75, 0).lineTo(-0.35, 0.55).lineTo(-0.1, 0).lineTo(-0.35, -0.55).closePath();
  return new ShapeGeometry(shape).rotateZ(yaw).translate(x, y, 0.012);
}
