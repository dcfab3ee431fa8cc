// Flying: what comes from the race, what goes to it, and a picture for every frame.

import { Vector3 } from "three";
import { gateAt } from "../data/motion.js";
import { Hud } from "./hud.js";
import { Input } from "./input.js";
import { Line } from "./line.js";
import { PilotCamera } from "./pilot_camera.js";
import { Scene } from "./scene.js";
import { Settings } from "./settings.js";
import { Sound } from "./sound.js";

const MODES = { Digit1: "assisted", Digit2: "angle", Digit3: "acro" };
const DEVICES = { gamepad: "gamepad", transmitter: "transmitter", keyboard: "keys", touch: "touch" };
const HELD = 0.25; // a race whose newest state is older is said to be waited for [s]
const GATE_SEEN = 1.2; // how long a message about a lap is shown [s]

export class Fly {
  /** @param path of the WebSocket */
  constructor(root, path) {
    this.element = (id) => root.querySelector(`#${id}`);
    this.scene = new Scene(this.element("view"), this.element("labels"));
    this.camera = new PilotCamera(this.scene.stage.camera);
    this.hud = new Hud(root);
    this.sound = new Sound();
    this.settings = new Settings();
    this.settings.changed = () => this.#settle();
    this.rows = [];
    this.phase = { name: "connecting" };
    this.waiting = [];
    this.own = null;
    this.chase = false;
    this.frames = 0;
    this.drawn = () => {}; // called after every picture, with the number of the sticks that it shows
    this.#listen(root);
    this.#arrange();
    new ResizeObserver(() => this.#resize()).observe(this.element("stage"));
    this.#resize();
    this.last = performance.now();
    requestAnimationFrame((now) => this.#frame(now));
    const touch = [this.element("stick-left"), this.element("stick-right")];
    const send = (message) => this.own !== null && this.line?.send(message);
    this.input = new Input(this.settings, touch, send, () => this.ready());
    this.line = new Line(path, this.#handlers(), (state, why) => this.#connected(state, why));
  }

  // What comes in

  #handlers() {
    return {
      hello: (hello) => this.#hello(hello),
      race: (race) => this.#race(race),
      ghosts: (ghosts) => this.scene.loadGhosts(ghosts),
      board: (rows) => this.hud.board(rows),
      state: (state) => this.#state(state),
      order: (rows) => this.#order(rows),
      waiting: (drones) => (this.waiting = drones),
      results: (rows) => (this.results = rows),
      phase: (phase) => this.#enter(phase),
      notice: (text) => this.hud.write("notice", text),
    };
  }

  #connected(state, why) {
    if (state === "open") return;
    this.own = null;
    this.phase = { name: "lost", why: state === "over" ? `The race closed the line: ${why}` : why };
  }

  #hello({ seat, track, laps, scene, dt, vehicle, nose }) {
    Object.assign(this, { own: seat, laps, dt, nose, vehicle });
    this.settings.load(vehicle);
    this.scene.loadTrack(scene);
    this.hud.write("title", `${track} · ${vehicle.name}`);
    this.element("modes").replaceChildren(...vehicle.modes.map((mode) => this.#modeButton(mode)));
    this.#settle();
  }

  #modeButton(mode) {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: mode });
    button.dataset.mode = mode;
    button.addEventListener("click", () => this.setMode(mode));
    return button;
  }

  #race(race) {
    this.race = race;
    this.results = null;
    this.scene.loadRace(race);
    this.rows = [];
    this.hud.results(null);
  }

  #state(state) {
    this.heard = state.heard[this.own] ?? 0;
    this.received = performance.now() / 1000;
    this.scene.take(state, this.dt, this.received);
  }

  #order(rows) {
    const before = new Map(this.rows.map((row) => [row.drone, row]));
    this.rows = rows;
    for (const row of rows) {
      const old = before.get(row.drone);
      if (!old) continue;
      if (row.passed > old.passed) {
        const gate = this.scene.gateAfter(row.passed - 1);
        this.scene.frames.crossings[gate].push({ time: row.last, drone: this.scene.drones[row.drone] });
      }
      if (row.drone !== this.own) continue;
      if (row.passed > old.passed) this.sound.gate();
      if (row.laps.length > old.laps.length) this.#lapDone(row);
      if (row.status !== old.status && row.status !== "finished") this.sound.crash();
    }
  }

  #lapDone({ laps }) {
    this.lapShown = { text: `${laps.at(-1).toFixed(2)} s`, until: performance.now() / 1000 + GATE_SEEN };
  }

  #enter(phase) {
    this.phase = phase;
    this.began = performance.now() / 1000;
    this.counted = null;
    if (phase.name === "racing") this.sound.count(true);
    this.hud.results(phase.name === "over" ? (this.results ?? null) : null, this.own);
    document.documentElement.dataset.phase = phase.name;
  }

  // What a person does

  ready() {
    this.line.send({ ready: true });
  }

  setMode(mode) {
    if (this.settings.modes?.includes(mode)) this.settings.change({ mode });
  }

  #settle() {
    this.sound.loudness(this.settings.value.volume);
    this.centred = this.input?.centred ?? true;
    if (this.own !== null) this.line?.send(this.settings.message(this.centred));
    for (const button of this.element("modes").children)
      button.setAttribute("aria-pressed", String(button.dataset.mode === this.settings.value.mode));
  }

  #listen(root) {
    window.addEventListener("keydown", (event) => this.#key(event));
    window.addEventListener("keyup", ({ code }) => this.input.key(code, false));
    const click = (id, act) => this.element(id).addEventListener("click", act);
    click("start", () => this.ready());
    click("sound", () => this.mute());
    click("choose", () => this.openSettings());
    click("view-button", () => (this.chase = !this.chase));
    root.querySelector("#settings form").addEventListener("submit", () => this.element("settings").close());
  }

  #key(event) {
    const { code, ctrlKey, altKey, metaKey, target } = event;
    if (ctrlKey || altKey || metaKey || target.closest?.("dialog[open]")) return;
    const acts = {
      KeyR: () => event.repeat || this.ready(),
      Enter: () => event.repeat || this.ready(),
      KeyM: () => this.mute(),
      KeyC: () => (this.chase = !this.chase),
      KeyG: () => (this.scene.showGhosts = !this.scene.showGhosts),
      KeyO: () => this.openSettings(),
    };
    if (code in MODES) this.setMode(MODES[code]);
    else if (acts[code]) acts[code]();
    else if (!this.input.key(code, true)) return;
    event.preventDefault();
  }

  mute() {
    this.sound.turn(!this.sound.muted);
    this.element("sound").setAttribute("aria-pressed", String(!this.sound.muted));
  }

  openSettings() {
    if (this.own === null) return;
    const kind = this.input.gamepads.find() ? this.input.gamepads.kind : "gamepad";
    this.settings.show(this.element("settings").querySelector("form"), kind);
    this.element("settings").showModal();
  }

  // What is seen

  #resize() {
    const box = this.element("stage").getBoundingClientRect();
    this.scene.stage.resize(Math.max(1, Math.floor(box.width)), Math.max(1, Math.floor(box.height)));
  }

  #arrange() {
    const device = this.input?.device ?? "keyboard";
    if (document.documentElement.dataset.device !== device) {
      document.documentElement.dataset.device = device;
      this.hud.write("device", DEVICES[device]);
    }
    if (this.input && this.input.centred !== this.centred) this.#settle();
  }

  #frame(milliseconds) {
    const now = performance.now() / 1000;
    const dt = Math.min((milliseconds - this.last) / 1000, 0.1);
    this.last = milliseconds;
    this.#arrange();
    if (this.scene.gates && this.race) this.#draw(now, dt);
    this.#speak(now);
    requestAnimationFrame((later) => this.#frame(later));
  }

  #draw(now, dt) {
    const { scene, hud } = this;
    const t = scene.clock.at(now);
    this.t = t;
    const row = this.rows.find(({ drone }) => drone === this.own);
    const racing = !row || row.status === "flying";
    const subject = racing ? this.own : (this.rows.find(({ status }) => status === "flying")?.drone ?? this.own);
    const state = scene.flights[subject ?? 0].at(t);
    const target = row && racing ? gate.set(...gateAt(scene.gates[scene.gateAfter(row.passed)], t).position) : null;
    const inside = racing && !this.chase && this.own !== null;
    const { uptilt, fov } = this.settings.value;
    this.camera.project(scene.stage, inside ? (fov ?? 100) : 90);
    if (inside) this.camera.ride(state, uptilt ?? 15, this.nose, target);
    else this.camera.chase(state, target, dt);
    scene.update(t, this.rows, this.own, inside, scene.stage.camera);
    scene.stage.render();
    this.frames += 1;
    hud.sticks(this.input.sticks);
    hud.flight(Math.hypot(...state.velocity), state.position[2]);
    if (this.own !== null) hud.race(this.rows, this.own, t, this.laps);
    const name = target ? `gate ${scene.gateAfter(row.passed) + 1}` : "";
    hud.gate(name, target, here.set(...state.position), scene.stage);
    this.#hum(racing && this.phase.name === "racing", t);
    this.drawn(this.heard, t);
  }

  #hum(flying, t) {
    const [roll, pitch, , throttle] = this.input.sticks;
    const effort = 0.35 + 0.4 * throttle + 0.15 * Math.max(Math.abs(roll), Math.abs(pitch));
    const own = this.scene.models[this.own]?.group.position;
    const distance = this.rows
      .filter(({ drone, status }) => drone !== this.own && status === "flying")
      .map(({ drone }) => here.set(...this.scene.flights[drone].at(t).position).distanceTo(own ?? here));
    this.sound.fly(flying ? Math.min(Math.max(effort, 0.05), 1) : null, flying ? Math.min(...distance) : Infinity);
  }

  /** The sentence in the middle. */
  #speak(now) {
    const start = this.element("start");
    const own = this.rows.find(({ drone }) => drone === this.own);
    const begin = this.input?.device === "touch" ? "Touch start" : "Press R, Enter or Start";
    const others = this.waiting.filter((drone) => drone !== this.own).map((drone) => drone + 1);
    start.hidden = !["grid", "over"].includes(this.phase.name) && (!own || own.status === "flying");
    if (this.phase.name === "lost") return this.hud.say("No line to the race", this.phase.why || "Trying again");
    if (this.phase.name === "connecting") return this.hud.say("Connecting");
    if (this.phase.name === "grid" || this.phase.name === "over") {
      const text = this.phase.name === "grid" ? "Ready?" : "";
      if (this.own !== null && !this.waiting.includes(this.own) && others.length)
        return this.hud.say(text, `Waiting for drone ${others.join(", ")}`);
      return this.hud.say(text, this.phase.name === "grid" ? begin : `${begin} to fly again`);
    }
    if (this.phase.name === "countdown") return this.#count(Math.ceil(this.phase.seconds - (now - this.began)));
    if (now - this.began < 0.8) return this.hud.say("Go");
    if (own && own.status !== "flying") return this.hud.say(said(own.status), begin);
    if (this.lapShown && now < this.lapShown.until) return this.hud.say(this.lapShown.text);
    if (now - this.received > HELD) return this.hud.say("", "Waiting for the race");
    this.hud.say("");
  }

  #count(left) {
    if (left !== this.counted && left > 0) this.sound.count(false);
    this.counted = left;
    this.hud.say(String(Math.max(left, 1)));
  }
}

function said(status) {
  if (status === "finished") return "Finished";
  return status === "retired" ? "Out of the race" : `You ${status}`;
}

const gate = new Vector3();
const here = new Vector3();
