// Everything that is written over the picture.

import { Vector3 } from "three";
import { clock, number } from "../ui/words.js";

const EDGE = 0.6; // of half the picture: where an arrow points to a gate that is not seen
const MARK = 0.9; // a gate nearer to the middle than this share is marked where it is

export class Hud {
  constructor(root) {
    this.at = (id) => root.querySelector(`#${id}`);
    this.dots = [this.at("stick-left"), this.at("stick-right")].map((field) => field.querySelector("i"));
    this.texts = new Map();
  }

  /** Write only what has changed: the browser lays nothing out anew for the rest. */
  write(id, text) {
    if (this.texts.get(id) === text) return;
    this.texts.set(id, text);
    this.at(id).textContent = text;
  }

  /** Left yaw and throttle, right roll and pitch. */
  sticks([roll, pitch, yaw, throttle]) {
    const place = (dot, x, y) =>
      (dot.style.transform = `translate(${(x * 40).toFixed(1)}px, ${(-y * 40).toFixed(1)}px)`);
    place(this.dots[0], yaw, throttle);
    place(this.dots[1], roll, pitch);
  }

  flight(speed, height) {
    this.write("speed-now", number(speed, 1));
    this.write("height-now", `${number(height, 1)} m high`);
  }

  /** @param rows of the order, @param own drone, @param t of the race, @param laps of it */
  race(rows, own, t, laps) {
    const place = rows.findIndex(({ drone }) => drone === own);
    const row = rows[place];
    if (!row) return;
    this.write("place", `${place + 1}/${rows.length}`);
    this.write("lap-number", row.passed ? `lap ${row.lap}/${laps}` : laps === 1 ? "1 lap" : `${laps} laps`);
    const flying = row.status === "flying";
    this.write("lap-time", row.began !== null && flying ? clock(Math.max(0, t - row.began)) : clock(Math.max(t, 0)));
    this.write("gap", place === 0 ? aheadOf(rows[1]) : row.gap === null ? "" : `+${row.gap.toFixed(2)} s`);
    const best = row.laps.length ? Math.min(...row.laps) : NaN;
    this.write("last-lap", row.laps.length ? `last ${clock(row.laps.at(-1))}  best ${clock(best)}` : "");
  }

  say(text, more = "") {
    this.write("message", text);
    this.write("message-more", more);
  }

  /** Where the next gate is: marked in the picture, or an arrow towards it. */
  gate(name, centre, position, { camera, width, height }) {
    const mark = this.at("next-gate");
    mark.hidden = centre === null;
    if (centre === null) return;
    const view = point.copy(centre).applyMatrix4(camera.matrixWorldInverse);
    const behind = view.z > 0;
    const at = point.copy(centre).project(camera);
    let [x, y] = behind ? [-at.x, -at.y] : [at.x, at.y];
    const seen = !behind && Math.abs(x) < MARK && Math.abs(y) < MARK;
    if (!seen) {
      const most = Math.max(Math.abs(x), Math.abs(y), 1e-6);
      [x, y] = [(x / most) * EDGE, (y / most) * EDGE];
    }
    const turn = Math.atan2(x * width, y * height);
    mark.dataset.seen = String(seen);
    mark.style.transform = `translate(${(((x + 1) / 2) * width).toFixed(1)}px, ${(((1 - y) / 2) * height).toFixed(1)}px)`;
    mark.querySelector("i").style.transform = `rotate(${turn.toFixed(3)}rad)`;
    this.write("gate-name", `${name} · ${centre.distanceTo(position).toFixed(0)} m`);
  }

  results(rows, own) {
    const table = this.at("results");
    table.hidden = rows === null;
    if (rows === null) return;
    const time = (value) => (value === null ? "–" : clock(value));
    const lines = rows.map((row, k) =>
      line([k + 1, row.pilot, time(row.time), time(row.best), row.fate], row.drone === own),
    );
    table.querySelector("tbody").replaceChildren(...lines);
  }

  board(rows, newest) {
    const table = this.at("best-laps");
    const lines = rows
      .slice(0, 5)
      .map((row, k) => line([k + 1, row.name, clock(row.time, 3), row.mode], row === newest));
    table.querySelector("tbody").replaceChildren(...lines);
    table.hidden = rows.length === 0;
  }
}

const point = new Vector3();

function aheadOf(second) {
  return second && second.gap !== null && second.gap > 0 ? `${second.gap.toFixed(2)} s ahead` : "";
}

function line(cells, own) {
  const row = document.createElement("tr");
  row.classList.toggle("own", own);
  row.append(...cells.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
  return row;
}
