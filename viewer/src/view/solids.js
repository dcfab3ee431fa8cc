// Poles and walls, and whatever else a drone can hit: upright cylinders and boxes.

import { BoxGeometry, CylinderGeometry, Group, Mesh, MeshStandardMaterial, Vector3 } from "three";

const CORNERS = [-0.5, 0.5].flatMap((x) => [-0.5, 0.5].flatMap((y) => [-0.5, 0.5].map((z) => [x, y, z])));

export class Solids {
  /** @param race whose `solids` are {shape, centre, size, yaw} */
  constructor(race) {
    this.group = new Group();
    this.material = new MeshStandardMaterial({ roughness: 0.85, metalness: 0.0 });
    for (const solid of race.solids) this.group.add(this.#build(solid));
  }

  #build(solid) {
    const mesh = new Mesh(geometryOf(solid), this.material);
    mesh.position.set(...solid.centre);
    mesh.rotation.z = solid.yaw;
    return mesh;
  }

  paint(theme) {
    this.material.color.set(theme.solid);
  }
}

function geometryOf({ shape, size: [length, thickness, height] }) {
  if (shape === "cylinder") return new CylinderGeometry(length / 2, length / 2, height, 32).rotateX(Math.PI / 2);
  return new BoxGeometry(length, thickness, height);
}

/** Corners of the box that encloses a solid, in the world. */
export function cornersOf({ centre: [x, y, z], size: [length, thickness, height], yaw }) {
  const up = new Vector3(0, 0, 1);
  return CORNERS.map(([a, b, c]) =>
    new Vector3(a * length, b * thickness, c * height).applyAxisAngle(up, yaw).add(new Vector3(x, y, z)),
  );
}
