// The renderer, the lights and the ground: everything that is the same in every race.

import {
  Color,
  DirectionalLight,
  Group,
  HemisphereLight,
  Mesh,
  Object3D,
  PerspectiveCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  Vector2,
  WebGLRenderer,
} from "three";

Object3D.DEFAULT_UP.set(0, 0, 1);

const GROUND = 24; // half its side, over the radius of its bright part: beyond five of them nothing can be seen
const LARGEST_PIXEL_RATIO = 2; // beyond it nobody sees a difference, but every frame costs more

export class Stage {
  /** Throws where the browser has no WebGL. */
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.scene = new Scene();
    this.scene.background = new Color();
    this.camera = new PerspectiveCamera(40, 1, 0.05, 500);
    this.sky = new HemisphereLight();
    this.sun = new DirectionalLight();
    this.sun.position.set(6, -9, 14);
    this.ground = makeGround();
    this.race = new Group(); // what changes with the race
    this.scene.add(this.sky, this.sun, this.ground, this.race);
    this.width = this.height = 1;
  }

  resize(width, height) {
    this.width = width;
    this.height = height;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, LARGEST_PIXEL_RATIO));
    this.renderer.setSize(width, height, false);
  }

  /** The middle and the corner of the ground's bright part, round the track. */
  lightUp(centre, radius) {
    this.ground.material.uniforms.centre.value.set(centre.x, centre.y);
    this.ground.material.uniforms.radius.value = radius;
    this.ground.position.set(centre.x, centre.y, 0);
    this.ground.scale.setScalar(GROUND * radius);
  }

  paint(theme) {
    const { uniforms } = this.ground.material;
    this.scene.background.set(theme.background);
    uniforms.far.value.set(theme.background);
    uniforms.near.value.set(theme.ground);
    uniforms.line.value.set(theme.grid);
    this.sky.color.set(theme.sky);
    this.sky.groundColor.set(theme.ground);
    this.sky.intensity = theme.skyLight;
    this.sun.intensity = theme.sunLight;
  }

  render() {
    this.renderer.render(this.scene, this.camera);
  }
}

/** A plane with lines every metre and every five, which fades into the background. */
function makeGround() {
  const uniforms = {
    near: { value: new Color() },
    far: { value: new Color() },
    line: { value: new Color() },
    centre: { value: new Vector2() },
    radius: { value: 10 },
  };
  const material = new ShaderMaterial({ uniforms, vertexShader: GROUND_VERTEX, fragmentShader: GROUND_FRAGMENT });
  material.depthWrite = false;
  const mesh = new Mesh(new PlaneGeometry(2, 2), material);
  mesh.renderOrder = -2;
  return mesh;
}

const GROUND_VERTEX = /* glsl */ `
  varying vec2 place;
  varying float depth;
  void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    vec4 view = viewMatrix * world;
    place = world.xy;
    depth = -view.z;
    gl_Position = projectionMatrix * view;
  }`;

const GROUND_FRAGMENT = /* glsl */ `
  uniform vec3 near, far, line;
  uniform vec2 centre;
  uniform float radius;
  varying vec2 place;
  varying float depth;

  // How much of a pixel lines of a width [px] every 'step' metres cover; they vanish before they flicker.
  float lines(float step, float width) {
    vec2 at = place / step;
    vec2 pixel = fwidth(at);
    vec2 distance = abs(fract(at - 0.5) - 0.5) / pixel;
    vec2 cover = clamp(0.5 * width + 0.5 - distance, 0.0, 1.0) * (1.0 - smoothstep(0.08, 0.35, pixel));
    return max(cover.x, cover.y);
  }

  void main() {
    float away = distance(place, centre) / radius;
    float fade = 1.0 - smoothstep(0.9, 3.2, away);
    float grid = max(0.32 * lines(1.0, 1.0), lines(5.0, 1.0));
    vec3 colour = mix(far, near, fade);
    colour = mix(colour, line, grid * (0.25 + 0.75 * fade) * (1.0 - smoothstep(2.0, 5.0, away)));
    gl_FragColor = vec4(colour, 1.0);
    #include <colorspace_fragment>
  }`;
