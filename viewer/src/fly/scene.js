// The race as it is flown: gates, drones where they are now, ghosts of laps.

import { Color, Vector3 } from "three";
import { Flight } from "../data/flight.js";
import { unpackSamples } from "../data/samples.js";
import { Theme } from "../ui/theme.js";
import { Drone } from "../view/drone.js";
import { Gates } from "../view/gates.js";
import { Labels } from "../view/labels.js";
import { Solids } from "../view/solids.js";
import { Stage } from "../view/stage.js";
import { Clock, LiveFlight } from "./live_flight.js";

const GHOSTS = { best: "#c79bff", limit: "#4fd08b" };
const HORIZON = 400; // how far is seen [m]

export class Scene {
  constructor(canvas, labels) {
    this.stage = new Stage(canvas);
    this.stage.camera.far = HORIZON;
    this.labels = new Labels(labels);
    this.clock = new Clock();
    this.drones = [];
    this.flights = [];
    this.models = [];
    this.ghosts = [];
    this.showGhosts = true;
    this.theme = new Theme(() => this.#paint());
  }

  loadTrack({ gates, solids, frame_width }) {
    this.gates = gates;
    this.frameWidth = frame_width;
    this.solidsData = solids;
    const places = gates.map(({ position }) => new Vector3(...position));
    const middle = places.reduce((sum, place) => sum.add(place), new Vector3()).divideScalar(places.length);
    const radius = Math.max(...places.map((place) => Math.hypot(place.x - middle.x, place.y - middle.y)), 4);
    this.stage.lightUp(middle, radius + 4);
  }

  loadRace({ first_gate, drones }) {
    this.firstGate = first_gate;
    this.drones = drones.map((drone, index) => ({ ...drone, index, ghost: false }));
    this.flights = drones.map(() => new LiveFlight());
    this.clock.reset();
    this.#build();
  }

  async loadGhosts(ghosts) {
    const known = Object.entries(ghosts).filter(([, ghost]) => ghost);
    const columns = await Promise.all(known.map(([, ghost]) => unpackSamples(ghost.samples)));
    this.ghosts = known.map(([name, { time }], k) => {
      const flight = new Flight(columns[k]);
      const model = new Drone({ ghost: true, colour: GHOSTS[name], flight });
      return { name, time, model };
    });
    if (this.gates) this.#build();
  }

  #build() {
    const { stage } = this;
    stage.race.clear();
    const race = {
      gates: this.gates,
      solids: this.solidsData,
      frame_width: this.frameWidth,
      first_gate: this.firstGate ?? 0,
      drones: this.drones,
      racers: [], // whoever passes a gate is told to it as the race goes on
    };
    this.frames = new Gates(race);
    this.solids = new Solids(race);
    this.models = this.drones.map((drone, k) => new Drone({ ...drone, flight: this.flights[k] }));
    const models = [...this.models, ...this.ghosts.map(({ model }) => model)];
    stage.race.add(this.frames.group, this.solids.group, ...models.map(({ group }) => group));
    this.labels.load(race, this.frames);
    this.#paint();
  }

  #paint() {
    const { scene } = this.theme ?? {};
    if (!scene) return;
    this.stage.paint(scene);
    this.frames?.paint(scene);
    this.solids?.paint(scene);
    this.models.forEach((model, k) => model.paint(scene, this.theme.colourOf(this.drones[k]).colour));
    this.ghosts.forEach(({ name, model }) => model.paint(scene, GHOSTS[name]));
  }

  take({ t, drones }, dt, now) {
    this.clock.take(t, dt, now);
    drones.forEach((row, k) => this.flights[k]?.take(t, row));
  }

  /** The gate to pass after so many. */
  gateAfter(passed) {
    return (this.firstGate + passed) % this.gates.length;
  }

  /** @param rows of the order  @param own drone  @param inside whether its camera is in its nose */
  update(t, rows, own, inside, camera) {
    const byDrone = new Map(rows.map((row) => [row.drone, row]));
    const row = byDrone.get(own);
    const target = row?.status === "flying" ? this.gateAfter(row.passed) : -1;
    this.frames.update(t, target, (drone) => colour.set(this.theme.colourOf(drone).colour));
    this.models.forEach((model, k) => {
      model.update(t, look(byDrone.get(k)?.status));
      model.hide(inside && k === own);
    });
    const since = row && row.began !== null ? t - row.began : -1;
    for (const { time, model } of this.ghosts) {
      model.group.visible = this.showGhosts && row?.status === "flying" && since >= 0 && since <= time;
      if (model.group.visible) model.update(since, "flying");
    }
    const places = this.models.map(({ group }) => group.position);
    this.labels.update(this.stage, places, (drone) => ({
      ...this.theme.colourOf(drone),
      focus: false,
      hidden: drone.index === own || camera.position.distanceTo(places[drone.index]) < 0.5,
    }));
  }
}

function look(status) {
  if (status === "flying" || status === undefined) return "flying";
  return status === "finished" || status === "retired" ? "finished" : "crashed";
}

const colour = new Color();
