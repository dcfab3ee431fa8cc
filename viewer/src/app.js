// The page: which race, what time, which camera, who is followed; and everything drawn from that.

import { Color, Vector3 } from "three";
import { Race } from "./data/race.js";
import { Board } from "./ui/board.js";
import { Controls } from "./ui/controls.js";
import { keyRows, listenToKeys } from "./ui/keyboard.js";
import { Theme } from "./ui/theme.js";
import { Ticker } from "./ui/ticker.js";
import { Timeline } from "./ui/timeline.js";
import { CAMERAS, Cameras } from "./view/cameras.js";
import { Drone } from "./view/drone.js";
import { Gates } from "./view/gates.js";
import { Labels } from "./view/labels.js";
import { Solids } from "./view/solids.js";
import { Stage } from "./view/stage.js";
import { Trail } from "./view/trail.js";

const LEAST_PIXELS = 26; // a drone is drawn at least so large by the cameras that stand off
const LARGEST = 3.5; // times its size
const SPAN = 0.5; // of a drone [m]
const TRAIL_WIDTH = { followed: 4, other: 2.5 }; // [px]
const PAUSE = 1.5; // before a live page goes on to the next race [s]

export class App {
  constructor(root) {
    this.element = (id) => root.querySelector(`#${id}`);
    this.races = [];
    this.race = null;
    this.standings = [];
    this.time = 0;
    this.playing = false;
    this.speed = 1;
    this.followed = null; // index of a drone, or null for the leader
    this.trail = { length: 3, bySpeed: false };
    this.frames = 0;
    this.dirty = true;
    this.stage = new Stage(this.element("view"));
    this.cameras = new Cameras(this.stage.camera, this.element("view"));
    this.cameras.orbit.addEventListener("change", () => (this.dirty = true));
    this.labels = new Labels(this.element("labels"));
    this.board = new Board(this.element("board"), (drone) => this.follow(drone.index));
    this.timeline = new Timeline(this.element("timeline"), (t) => this.seek(t));
    this.ticker = new Ticker(this.element("ticker"));
    this.theme = new Theme((theme) => this.#paint(theme));
    this.controls = new Controls(root, this);
    this.element("keys").replaceChildren(...keyRows());
    listenToKeys(this);
    new ResizeObserver(() => this.resize()).observe(root);
    this.resize();
    this.last = performance.now();
    requestAnimationFrame((now) => this.#frame(now));
  }

  // What the page can be told

  async showRace(index, { play = false, time = 0 } = {}) {
    const data = this.races[index];
    if (!data) return;
    this.wanted = data;
    const race = await Race.unpack(data);
    if (this.wanted !== data) return; // another was chosen meanwhile
    this.#load(race, data);
    this.playing = play;
    this.#setTime(time);
    this.#changed();
  }

  /** Of the race that is shown, -1 before the first. */
  get index() {
    return this.races.indexOf(this.shown);
  }

  stepRace(by) {
    const index = this.races.indexOf(this.wanted) + by;
    return this.showRace(Math.min(Math.max(index, 0), this.races.length - 1), { play: this.playing });
  }

  listRaces() {
    this.controls.listRaces(this.races, this.index);
  }

  play(playing = true) {
    if (playing && this.atEnd) this.#setTime(0);
    this.playing = playing && this.race !== null;
    this.waited = 0;
    this.#changed();
  }

  toggle() {
    this.play(!this.playing);
  }

  seek(t) {
    if (!this.race) return;
    this.playing = false;
    this.#setTime(t);
    this.#changed();
  }

  /** A sample on or back. */
  step(by) {
    if (!this.race) return;
    const period = this.race.sample_period;
    this.seek((Math.round(this.time / period) + by) * period);
  }

  toEvent(direction) {
    const times = this.race.events.map(({ time }) => time);
    const found = direction > 0 ? times.find((t) => t > this.time + 1e-3) : times.findLast((t) => t < this.time - 1e-3);
    if (found !== undefined) this.seek(found);
  }

  setSpeed(speed) {
    this.speed = speed;
    this.#changed();
  }

  setCamera(mode) {
    if (!CAMERAS.includes(mode)) throw new Error(`no camera ${mode}`);
    this.cameras.choose(mode);
    this.#changed();
  }

  resetCamera() {
    this.cameras.reset();
    this.setCamera("orbit");
  }

  /** @param index of a drone, or null for the leader */
  follow(index) {
    if (index !== null && !this.race?.racers[index]) return;
    this.followed = index;
    this.#changed();
  }

  setTrail(trail) {
    Object.assign(this.trail, trail);
    this.#changed();
  }

  toggleHelp() {
    const help = this.element("help");
    if (help.open) help.close();
    else help.showModal();
  }

  get atEnd() {
    return this.race !== null && this.time >= this.race.duration;
  }

  /** The drone that is followed; where it is the leader, the first that still flies. */
  get subject() {
    if (this.followed !== null) return this.race.racers[this.followed];
    return (this.standings.find(({ status }) => status === "flying") ?? this.standings[0])?.drone;
  }

  // What follows from it

  #load(race, data) {
    this.shown = data;
    this.stage.race.clear();
    this.trails?.forEach((trail) => trail.dispose());
    this.race = race;
    this.standings = race.standings(0); // who asks before the first picture is told of this race, not of the one before
    this.gates = new Gates(race);
    this.solids = new Solids(race);
    this.models = race.drones.map((drone) => new Drone(drone));
    this.trails = race.drones.map((drone) => new Trail(drone, race.topSpeed));
    this.stage.race.add(
      this.gates.group,
      this.solids.group,
      ...this.models.map(({ group }) => group),
      ...this.trails.map((t) => t.mesh),
    );
    const sameTrack = this.framed === trackKey(race);
    this.framed = trackKey(race);
    if (!sameTrack) this.#frameTrack(race);
    if (this.followed !== null && !race.racers[this.followed]) this.followed = null;
    this.labels.load(race, this.gates);
    this.board.load(race, (drone) => this.theme.colourOf(drone));
    this.timeline.load(race);
    this.controls.load(race);
    this.listRaces();
    this.element("empty").hidden = true;
    document.documentElement.dataset.loaded = "true";
    this.#paint(this.theme);
    this.resize();
  }

  #frameTrack(race) {
    const places = race.gates.map(({ position }) => new Vector3(...position));
    const middle = places.reduce((sum, place) => sum.add(place), new Vector3()).divideScalar(places.length);
    const radius = Math.max(...places.map((place) => Math.hypot(place.x - middle.x, place.y - middle.y)), 4);
    this.stage.lightUp(middle, radius + 4);
    this.cameras.frame(race);
  }

  #paint(theme) {
    const { scene } = theme;
    this.stage.paint(scene);
    this.gates?.paint(scene);
    this.solids?.paint(scene);
    this.race?.drones.forEach((drone, k) => {
      const { colour } = theme.colourOf(drone);
      this.models[k].paint(scene, colour);
      this.trails[k].paint(scene, colour);
    });
    this.board.paint((drone) => theme.colourOf(drone));
    this.#changed();
  }

  resize() {
    const box = this.element("stage").getBoundingClientRect();
    this.stage.resize(Math.max(1, Math.floor(box.width)), Math.max(1, Math.floor(box.height)));
    this.cameras.resize({ width: this.stage.width, height: this.stage.height }, this.#covered(box));
    this.#changed();
  }

  /** How far the panels reach into the picture [px]. */
  #covered(box) {
    const panel = this.element("panel").getBoundingClientRect();
    const free = { left: 8, right: 8, top: 8, bottom: 8 };
    if (panel.width > 0.6 * box.width) free.top = panel.bottom - box.top + 8;
    else free.left = panel.right - box.left + 8;
    return free;
  }

  #setTime(t) {
    this.time = Math.min(Math.max(t, 0), this.race.duration);
    this.dirty = true;
  }

  /** Something other than time has changed: say so, and draw anew. */
  #changed() {
    this.dirty = this.stale = true;
  }

  #frame(now) {
    const passed = Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    if (this.playing) this.#advance(passed);
    if (this.dirty) this.draw();
    requestAnimationFrame((later) => this.#frame(later));
  }

  #advance(passed) {
    if (!this.atEnd) return this.#setTime(this.time + passed * this.speed);
    this.waited = (this.waited ?? 0) + passed;
    if (this.live && this.waited < PAUSE) return;
    this.waited = 0;
    if (!this.live) return this.play(false);
    if (this.index < this.races.length - 1) this.showRace(this.races.length - 1, { play: true });
    else this.play();
  }

  /** Draw the page as it is now. */
  draw() {
    this.dirty = false;
    this.frames += 1;
    if (this.race) this.#update();
    if (this.stale && this.controls) {
      this.controls.show();
      if (this.race) this.timeline.draw((drone) => this.theme.colourOf(drone), this.subject);
      this.drawnFor = this.subject;
      this.stale = false;
    }
    this.stage.render();
  }

  #update() {
    const { race, time, cameras, stage } = this;
    this.standings = race.standings(time);
    const { subject } = this;
    if (subject !== this.drawnFor) this.stale = true;
    cameras.place(race, subject, time);
    const next = this.standings.find(({ drone }) => drone === subject);
    const target = next && next.status === "flying" ? race.gateOf(next.passed + 1) : -1;
    this.gates.update(time, target, (drone) => colour.set(this.theme.colourOf(drone).colour));
    race.drones.forEach((drone, k) => this.#updateDrone(drone, k, subject));
    const places = this.models.map(({ group }) => group.position);
    this.labels.update(stage, places, (drone) => ({
      ...this.theme.colourOf(drone),
      focus: drone === subject,
      hidden: cameras.mode === "first-person" && drone === subject,
    }));
    this.board.update(time, this.standings, subject);
    this.timeline.update(time);
    this.controls.showTime(time);
    this.ticker.update(race, time, this.speed);
  }

  #updateDrone(drone, k, subject) {
    const { race, time, cameras, stage } = this;
    const model = this.models[k];
    const status = race.crashedAt(drone, time) ? "crashed" : race.statusAt(drone, time);
    model.enlarge(this.#enlargement(drone));
    model.update(time, status === "finished" || status === "crashed" ? status : "flying");
    model.hide(cameras.mode === "first-person" && drone === subject);
    const opacity = drone.ghost ? 0.4 : drone === subject ? 1 : 0.85;
    const width = drone === subject ? TRAIL_WIDTH.followed : TRAIL_WIDTH.other;
    this.trails[k].update(time, { ...this.trail, width, opacity }, stage.height);
  }

  #enlargement(drone) {
    const { camera, height } = this.stage;
    if (this.cameras.mode === "chase" || this.cameras.mode === "first-person") return 1;
    const distance = camera.position.distanceTo(here.set(...drone.flight.at(this.time).position));
    const pixels = (SPAN * height) / (2 * distance * Math.tan((camera.fov * Math.PI) / 360));
    return Math.min(Math.max(LEAST_PIXELS / pixels, 1), LARGEST);
  }
}

const colour = new Color();
const here = new Vector3();

function trackKey({ gates, solids }) {
  return JSON.stringify([gates, solids]);
}
