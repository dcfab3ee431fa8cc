// Buttons and menus. They call the app, and `show` makes them say what the app does.

import { CAMERAS } from "../view/cameras.js";
import { viridisGradient } from "../view/viridis.js";
import { icon } from "./icons.js";
import { clock } from "./words.js";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
export const TRAILS = [0, 1, 3, 8, Infinity]; // lengths [s]
const TRAIL_NAMES = { 0: "no trail", [Infinity]: "whole trail" };

export class Controls {
  constructor(root, app) {
    this.app = app;
    this.at = (id) => root.querySelector(`#${id}`);
    for (const element of root.querySelectorAll("[data-icon]")) element.prepend(icon(element.dataset.icon));
    this.#options("speed", SPEEDS, (value) => `${value}×`);
    this.#options("trail", TRAILS, (value) => TRAIL_NAMES[value] ?? `trail ${value} s`);
    this.#cameras();
    this.#listen();
  }

  #options(id, values, name) {
    const options = values.map((value) => new Option(name(value), String(value)));
    this.at(id).replaceChildren(...options);
  }

  #cameras() {
    const buttons = CAMERAS.map((mode) => {
      const button = document.createElement("button");
      button.type = "button";
      button.dataset.camera = mode;
      button.textContent = mode;
      button.addEventListener("click", () => this.app.setCamera(mode));
      return button;
    });
    this.at("cameras").replaceChildren(...buttons);
  }

  #listen() {
    const { app } = this;
    const click = (id, action) => this.at(id).addEventListener("click", action);
    const change = (id, action) => this.at(id).addEventListener("change", (event) => action(event.target.value));
    click("play", () => app.toggle());
    click("back", () => app.step(-1));
    click("forward", () => app.step(1));
    click("scheme", () => app.theme.toggle());
    click("help-button", () => app.toggleHelp());
    click("full", () => toggleFullScreen());
    click("previous-race", () => app.stepRace(-1));
    click("next-race", () => app.stepRace(1));
    click("paint", () => app.setTrail({ bySpeed: !app.trail.bySpeed }));
    change("speed", (value) => app.setSpeed(Number(value)));
    change("trail", (value) => app.setTrail({ length: Number(value) }));
    change("follow", (value) => app.follow(value === "" ? null : Number(value)));
    change("races", (value) => app.showRace(Number(value)));
  }

  /** The races to choose from. */
  listRaces(races, current) {
    const options = races.map(({ label, outcome }, k) => new Option(`${label}: ${outcome}`, String(k)));
    this.at("races").replaceChildren(...options);
    this.at("races").value = String(current);
    this.at("chooser").hidden = races.length < 2;
    this.at("count").textContent = `${current + 1} of ${races.length}`;
    this.at("previous-race").disabled = current <= 0;
    this.at("next-race").disabled = current >= races.length - 1;
  }

  load(race) {
    const drones = race.racers.map((drone) => new Option(`drone ${drone.number}`, String(drone.index)));
    this.at("follow").replaceChildren(new Option("follow leader", ""), ...drones);
    const laps = race.laps === 1 ? "1 lap" : `${race.laps} laps`;
    this.at("title").textContent = race.track;
    this.at("subtitle").textContent = `${laps} · ${race.label}`;
    this.at("duration").textContent = ` / ${clock(race.duration, 1)} s`;
  }

  /** Make everything say what the app does. */
  show() {
    const { app } = this;
    this.at("speed").value = String(app.speed);
    this.at("trail").value = String(app.trail.length);
    this.at("follow").value = app.followed === null ? "" : String(app.followed);
    this.at("paint").setAttribute("aria-pressed", String(app.trail.bySpeed));
    this.#swap("play", app.playing ? "pause" : "play", app.playing ? "Pause" : "Play");
    this.#swap("scheme", app.theme.name === "dark" ? "sun" : "moon", "Light or dark");
    for (const button of this.at("cameras").children)
      button.setAttribute("aria-pressed", String(button.dataset.camera === app.cameras.mode));
    this.at("legend").hidden = !app.trail.bySpeed || app.trail.length === 0 || !app.race;
    this.at("scale").style.background = viridisGradient(app.theme.scene.speedScale);
    this.at("fastest").textContent = app.race ? `${app.race.topSpeed.toFixed(1)} m/s` : "";
  }

  #swap(id, name, label) {
    const button = this.at(id);
    if (button.dataset.shown === name) return;
    button.dataset.shown = name;
    button.replaceChildren(icon(name));
    button.setAttribute("aria-label", label);
  }

  showTime(t) {
    this.at("time").textContent = clock(t);
  }
}

function toggleFullScreen() {
  const change = document.fullscreenElement
    ? document.exitFullscreen()
    : document.documentElement.requestFullscreen?.();
  change?.catch(() => {}); // a browser may refuse; nothing is lost
}
