// The order of the race, and the laps of the drone that is followed.

import { countUntil } from "../data/flight.js";
import { clock, number } from "./words.js";

export class Board {
  /** @param choose called with the drone of a row that was clicked */
  constructor(root, choose) {
    this.body = root.querySelector("tbody");
    this.laps = root.querySelector("#laps");
    this.choose = choose;
    this.rows = new Map();
  }

  load(race, colourOf) {
    this.race = race;
    this.rows = new Map(race.racers.map((drone) => [drone, this.#makeRow(drone)]));
    this.body.replaceChildren(...[...this.rows.values()].map(({ row }) => row));
    this.order = "";
    this.paint(colourOf);
  }

  paint(colourOf) {
    for (const [drone, { chip }] of this.rows) {
      const { colour, ink } = colourOf(drone);
      chip.style.background = colour;
      chip.style.color = ink;
    }
  }

  #makeRow(drone) {
    const row = document.createElement("tr");
    row.tabIndex = 0;
    row.setAttribute("aria-label", `Follow drone ${drone.number}`);
    const cells = Object.fromEntries(
      ["rank", "who", "lap", "gap", "split", "speed"].map((name) => {
        const cell = document.createElement("td");
        cell.className = name;
        row.append(cell);
        return [name, cell];
      }),
    );
    const chip = document.createElement("b");
    chip.className = "chip";
    chip.textContent = drone.number;
    const pilot = document.createElement("span");
    pilot.textContent = drone.pilot;
    pilot.title = drone.pilot;
    const who = document.createElement("div");
    who.append(chip, pilot);
    cells.who.append(who);
    row.addEventListener("click", () => this.choose(drone));
    row.addEventListener("keydown", (event) => event.key === "Enter" && this.choose(drone));
    return { row, chip, cells };
  }

  update(t, standings, followed) {
    const order = standings.map(({ drone }) => drone.number).join();
    if (order !== this.order) {
      this.order = order;
      this.body.append(...standings.map(({ drone }) => this.rows.get(drone).row));
    }
    for (const standing of standings) this.#fill(t, standing, followed);
    this.#fillLaps(t, followed);
  }

  #fill(t, { drone, rank, status, lap, gap, split, speed, passed }, followed) {
    const { row, cells } = this.rows.get(drone);
    row.classList.toggle("followed", drone === followed);
    row.classList.toggle("out", status !== "flying" && status !== "finished");
    const done = status === "finished";
    write(cells.rank, rank);
    write(cells.lap, passed === 0 ? "grid" : `${lap}/${this.race.laps}`);
    if (status !== "flying" && !done) write(cells.gap, status, "word");
    else if (done && rank === 1) write(cells.gap, clock(drone.finish));
    else if (rank === 1) write(cells.gap, passed ? "leader" : "–", "word");
    else write(cells.gap, number(Math.max(gap, 0), 2, "+"));
    write(cells.split, number(split, 2), this.#splitClass(drone, t));
    write(cells.speed, done ? "✓" : number(speed, 1), done ? "flag" : "");
  }

  /** "best" where nobody has flown between these two gates faster yet, "own" where the drone itself has not. */
  #splitClass(drone, t) {
    const passed = countUntil(drone.crossings, t);
    if (passed < 2) return "";
    const mine = drone.crossings[passed - 1] - drone.crossings[passed - 2];
    if (mine <= this.#fastest(this.race.racers, passed, t)) return "best";
    return passed > this.race.gates.length + 1 && mine <= this.#fastest([drone], passed, t) ? "own" : "";
  }

  #fastest(drones, passed, t) {
    const gates = this.race.gates.length;
    let best = Infinity;
    for (const { crossings } of drones)
      for (let c = ((passed - 2) % gates) + 1; c < crossings.length && crossings[c] <= t; c += gates)
        best = Math.min(best, crossings[c] - crossings[c - 1]);
    return best;
  }

  #fillLaps(t, drone) {
    if (!drone || drone.ghost) return void (this.laps.textContent = "");
    const laps = this.race.lapTimes(drone, t);
    const best = Math.min(...laps);
    const key = `${drone.number}:${laps.join()}`;
    if (key === this.lapsKey) return;
    this.lapsKey = key;
    const items = Array.from({ length: Math.min(this.race.laps, 12) }, (_, k) => lapItem(k, laps[k], laps[k] === best));
    const title = document.createElement("span");
    title.textContent = `Laps of drone ${drone.number}`;
    this.laps.replaceChildren(title, ...items);
  }
}

function lapItem(index, time, best) {
  const item = document.createElement("span");
  item.className = best ? "lap best" : "lap";
  const name = document.createElement("i");
  name.textContent = index + 1;
  item.append(name, number(time, 2));
  return item;
}

function write(cell, text, kind = "") {
  if (cell.textContent !== String(text)) cell.textContent = text;
  if (cell.dataset.kind !== kind) cell.dataset.kind = kind;
}
