// The latest event in words, for a moment.

import { describe } from "./words.js";

const SHOWN = 2.5; // [s] of the race, at least
const MOST = 3;

export class Ticker {
  constructor(element) {
    this.element = element;
    this.text = "";
  }

  /** @param t time of the race; @param speed faster replays show events for longer */
  update(race, t, speed) {
    const from = t - SHOWN * Math.max(1, speed);
    const recent = race.events.filter(({ time }) => time > from && time <= t);
    const lines = [...new Set(recent.map((event) => describe(race, event)))].slice(-MOST);
    const text = lines.join("\n");
    if (text === this.text) return;
    this.text = text;
    this.element.replaceChildren(
      ...lines.map((line) => {
        const item = document.createElement("div");
        item.textContent = line;
        return item;
      }),
    );
  }
}
