// The way a drone has flown, as a ribbon of constant width on the screen that ends exactly at the drone.

import {
  BufferGeometry,
  Color,
  DataTexture,
  DoubleSide,
  Float32BufferAttribute,
  LinearFilter,
  Mesh,
  ShaderMaterial,
  SRGBColorSpace,
  Vector2,
} from "three";
import { viridisBytes } from "./viridis.js";

const RATE = 30; // points per second; in between the ribbon is straight
const MOST_POINTS = 8000; // of one trail

export class Trail {
  constructor(drone, topSpeed) {
    this.drone = drone;
    const uniforms = {
      now: { value: 0 },
      length: { value: 3 },
      width: { value: 0 },
      opacity: { value: 1 },
      colour: { value: new Color() },
      bySpeed: { value: false },
      topSpeed: { value: topSpeed },
      speeds: { value: new Vector2(0, 1) },
      scale: { value: scaleTexture() },
    };
    this.material = new ShaderMaterial({ uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT });
    this.material.transparent = true;
    this.material.depthWrite = false;
    this.material.side = DoubleSide;
    this.points = Math.max(2, Math.min(MOST_POINTS, Math.ceil(drone.flight.end * RATE) + 1));
    this.mesh = new Mesh(ribbon(drone.flight, this.points), this.material);
    this.mesh.frustumCulled = false;
  }

  /** @param look {length [s], bySpeed, width [px], opacity}; @param height of the canvas [px] */
  update(t, look, height) {
    const { uniforms } = this.material;
    uniforms.now.value = t;
    uniforms.length.value = look.length;
    uniforms.width.value = look.width / height;
    uniforms.opacity.value = look.opacity;
    uniforms.bySpeed.value = look.bySpeed;
    const point = (time) => (Math.min(Math.max(time / this.drone.flight.end, 0), 1) || 0) * (this.points - 1);
    const [from, to] = [Math.floor(point(t - look.length)), Math.ceil(point(t))];
    this.mesh.visible = look.length > 0 && to > from;
    this.mesh.geometry.setDrawRange(6 * from, 6 * (to - from));
  }

  paint(theme, colour) {
    this.material.uniforms.colour.value.set(colour);
    this.material.uniforms.speeds.value.set(...theme.speedScale);
  }

  dispose() {
    this.mesh.geometry.dispose();
    this.material.dispose();
  }
}

/** Two vertices at each point, one for either side. */
function ribbon(flight, points) {
  const place = (k) => flight.at((flight.end * Math.min(Math.max(k, 0), points - 1)) / (points - 1));
  const columns = { position: [], before: [], after: [], info: [], side: [] };
  const index = [];
  for (let k = 0; k < points; k++) {
    const { position, velocity } = place(k);
    const [before, after] = [place(k - 1).position, place(k + 1).position];
    for (const side of [-1, 1]) {
      columns.position.push(...position);
      columns.before.push(...before);
      columns.after.push(...after);
      columns.info.push((flight.end * k) / (points - 1), Math.hypot(...velocity));
      columns.side.push(side);
    }
    const at = 2 * k;
    if (k < points - 1) index.push(at, at + 1, at + 2, at + 1, at + 3, at + 2);
  }
  const geometry = new BufferGeometry().setIndex(index);
  for (const [name, values] of Object.entries(columns))
    geometry.setAttribute(name, new Float32BufferAttribute(values, values.length / (2 * points)));
  return geometry;
}

let texture = null;

function scaleTexture() {
  if (texture) return texture;
  const bytes = viridisBytes();
  texture = new DataTexture(bytes, bytes.length / 4, 1);
  texture.colorSpace = SRGBColorSpace;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

// The ribbon faces the camera and is as wide as so many pixels at its depth.
const VERTEX = /* glsl */ `
  attribute vec3 before, after;
  attribute vec2 info; // time, speed
  attribute float side;
  uniform float width; // of the height of the picture
  varying vec2 seen;

  void main() {
    seen = info;
    vec4 view = modelViewMatrix * vec4(position, 1.0);
    vec3 across = cross((modelViewMatrix * vec4(after - before, 0.0)).xyz, view.xyz);
    across *= inversesqrt(max(dot(across, across), 1e-12));
    view.xyz += across * side * width * max(-view.z, 0.0) / projectionMatrix[1][1];
    gl_Position = projectionMatrix * view;
  }`;

const FRAGMENT = /* glsl */ `
  uniform float now, length, opacity, topSpeed;
  uniform vec3 colour;
  uniform vec2 speeds;
  uniform bool bySpeed;
  uniform sampler2D scale;
  varying vec2 seen;

  void main() {
    float age = now - seen.x;
    if (age < 0.0 || age > length) discard;
    float share = mix(speeds.x, speeds.y, clamp(seen.y / topSpeed, 0.0, 1.0));
    vec3 paint = bySpeed ? texture2D(scale, vec2(share, 0.5)).rgb : colour;
    float fade = 1.0 - smoothstep(0.35, 1.0, age / length);
    gl_FragColor = vec4(paint, opacity * mix(0.12, 1.0, fade));
    #include <colorspace_fragment>
  }`;
