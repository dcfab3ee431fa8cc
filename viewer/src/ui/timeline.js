// Speeds and events over time, and the line that says now. Dragging anywhere on it scrubs.

import { describe, clock } from "./words.js";

const LEFT = 36; // of the drawing, room for what the lines mean; page.css puts the ends of the slider there [px]
const RIGHT = 12;
const REACH = 9; // how near the pointer must be to a mark [px]
const MOST_LANES = 8;
const TICK = 1.5; // width of a crossing's mark [px]

export class Timeline {
  /** @param seek called with a time while scrubbing */
  constructor(root, seek) {
    this.root = root;
    this.canvas = root.querySelector("canvas");
    this.now = root.querySelector("#now");
    this.tip = root.querySelector("#tip");
    this.slider = root.querySelector("#scrub");
    this.seek = seek;
    this.marks = [];
    this.slider.addEventListener("input", () => seek(Number(this.slider.value)));
    this.canvas.addEventListener("pointerdown", (event) => this.#drag(event));
    this.canvas.addEventListener("pointermove", (event) => this.#point(event));
    this.canvas.addEventListener("pointerleave", () => (this.tip.hidden = true));
  }

  load(race) {
    this.race = race;
    this.slider.max = race.duration;
    this.slider.step = "any";
    this.lanes = Math.min(MOST_LANES, race.racers.length);
    this.root.style.setProperty("--lanes", this.lanes);
  }

  get width() {
    return this.canvas.clientWidth - LEFT - RIGHT;
  }

  x(t) {
    return LEFT + (t / this.race.duration) * this.width;
  }

  #time(event) {
    const x = event.clientX - this.canvas.getBoundingClientRect().left - LEFT;
    return Math.min(Math.max(x / this.width, 0), 1) * this.race.duration;
  }

  #drag(event) {
    const near = this.#nearest(event);
    this.seek(near ? near.time : this.#time(event));
    this.canvas.setPointerCapture(event.pointerId);
  }

  #point(event) {
    if (event.buttons & 1) this.seek(this.#time(event));
    const near = event.buttons ? null : this.#nearest(event);
    this.tip.hidden = !near;
    if (!near) return;
    this.tip.textContent = `${clock(near.time)} s  ${describe(this.race, near)}`;
    const half = this.tip.offsetWidth / 2;
    const x = Math.min(Math.max(near.x, half), this.canvas.clientWidth - half);
    this.tip.style.transform = `translate(${x}px, 0) translate(-50%, -100%)`;
  }

  #nearest(event) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let best = null;
    let least = REACH;
    for (const mark of this.marks) {
      const distance = Math.hypot(mark.x - x, mark.y - y) + (mark.kind === "crossing" ? 2 : 0);
      if (distance < least) [best, least] = [mark, distance];
    }
    return best;
  }

  update(t) {
    this.now.style.transform = `translateX(${this.x(t)}px)`;
    this.slider.value = t;
    this.slider.style.setProperty("--done", t / this.race.duration);
    const said = `${clock(t)} of ${clock(this.race.duration)} seconds`;
    if (this.slider.getAttribute("aria-valuetext") !== said) this.slider.setAttribute("aria-valuetext", said);
  }

  /** Draw everything but the line that says now. */
  draw(colourOf, followed) {
    const { canvas, race } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!race || width === 0) return;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d", { willReadFrequently: true }); // drawn by the processor, seldom
    context.scale(ratio, ratio);
    const style = getComputedStyle(this.root);
    const colours = { line: style.getPropertyValue("--line"), muted: style.getPropertyValue("--muted") };
    this.lane = Number.parseFloat(style.getPropertyValue("--lane"));
    this.plotHeight = height - this.lanes * this.lane - 6;
    context.font = `10px ${style.fontFamily}`;
    this.#drawScale(context, colours);
    this.#drawSpeeds(context, colourOf, followed);
    this.#drawMarks(context, colourOf, colours, followed);
  }

  #y(speed) {
    return this.plotHeight - 1 - (speed / this.race.topSpeed) * (this.plotHeight - 14);
  }

  #drawScale(context, { line, muted }) {
    const { race, plotHeight } = this;
    context.lineWidth = 1;
    context.strokeStyle = line;
    context.fillStyle = muted;
    context.textAlign = "right";
    const step = [1, 2, 5, 10, 20].find((size) => race.topSpeed / size <= 4.5) ?? 50;
    for (let speed = 0; speed <= race.topSpeed; speed += step) {
      const y = Math.round(this.#y(speed)) + 0.5;
      stroke(context, [LEFT, y], [LEFT + this.width, y]);
      if (speed) context.fillText(speed, LEFT - 6, y + 3.5);
    }
    context.fillText("m/s", LEFT - 6, 9);
    context.textAlign = "left";
    const first = race.racers[race.ranking[0]].crossings;
    const bottom = plotHeight + 6 + this.lanes * this.lane;
    for (let c = 0; c < first.length; c += race.gates.length) {
      const x = Math.round(this.x(first[c])) + 0.5;
      stroke(context, [x, 0], [x, bottom]);
      const lap = c / race.gates.length + 1;
      const end = first[c + race.gates.length] ?? race.duration;
      if (lap <= race.laps && this.x(end) - x > 34) context.fillText(`lap ${lap}`, x + 4, 9);
    }
  }

  #drawSpeeds(context, colourOf, followed) {
    const { race } = this;
    const order = [...race.drones].sort((a, b) => (a === followed) - (b === followed));
    const points = Math.max(2, Math.round(this.width / 1.5));
    context.lineJoin = "round";
    for (const drone of order) {
      context.beginPath();
      for (let k = 0; k < points; k++) {
        const t = (race.duration * k) / (points - 1);
        if (t > drone.flight.end) break;
        context.lineTo(this.x(t), this.#y(drone.flight.speedAt(t)));
      }
      context.strokeStyle = colourOf(drone).colour;
      context.lineWidth = drone === followed ? 2 : 1;
      context.globalAlpha = drone === followed ? 1 : drone.ghost ? 0.3 : 0.75;
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** A lane for each drone: gates as ticks, everything else as signs. */
  #drawMarks(context, colourOf, { line }, followed) {
    const { race } = this;
    const top = this.plotHeight + 6;
    const lane = (index) => top + ((index + 0.5) * this.lanes * this.lane) / race.racers.length;
    this.marks = [];
    for (const drone of race.racers) {
      const y = lane(drone.index);
      context.strokeStyle = line;
      context.lineWidth = 1;
      stroke(context, [LEFT, y], [this.x(drone.flight.end), y]);
      if (race.racers.length <= MOST_LANES) this.#nameLane(context, y, drone, colourOf(drone));
      context.strokeStyle = colourOf(drone).colour;
      context.lineWidth = TICK;
      context.globalAlpha = followed && drone !== followed ? 0.75 : 1;
      drone.crossings.forEach((time, k) => {
        const [x, half] = [this.x(time), k % race.gates.length ? 2.5 : 4.5];
        stroke(context, [x, y - half], [x, y + half]);
        this.marks.push({ x, y, time, kind: "crossing", drone: drone.index, gate: race.gateOf(k + 1), other: -1 });
      });
      context.globalAlpha = 1;
    }
    for (const event of race.events) {
      const drone = race.racers[event.drone];
      const [x, y] = [this.x(event.time), lane(event.drone)];
      const draw = event.kind.startsWith("collision") ? cross : (SIGNS[event.kind] ?? ring);
      draw(context, x, y, colourOf(drone).colour, getComputedStyle(this.root).getPropertyValue("--dock"));
      this.marks.push({ ...event, x, y });
    }
  }

  #nameLane(context, y, drone, { colour }) {
    context.fillStyle = colour;
    context.fillRect(LEFT - 12, y - 3, 6, 6);
    context.fillStyle = getComputedStyle(this.root).getPropertyValue("--muted");
    context.textAlign = "right";
    context.fillText(drone.number, LEFT - 16, y + 3.5);
  }
}

const SIGNS = { overtake: triangle, finish: flag, missed_gate: ring };

function stroke(context, from, to) {
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
}

function triangle(context, x, y, colour, back) {
  context.beginPath();
  context.moveTo(x, y - 5);
  context.lineTo(x + 5, y + 4);
  context.lineTo(x - 5, y + 4);
  context.closePath();
  edge(context, colour, back);
}

function cross(context, x, y, colour, back) {
  for (const [style, width] of [
    [back, 5.5],
    [colour, 2.6],
  ]) {
    context.strokeStyle = style;
    context.lineWidth = width;
    stroke(context, [x - 4, y - 4], [x + 4, y + 4]);
    stroke(context, [x - 4, y + 4], [x + 4, y - 4]);
  }
}

function ring(context, x, y, colour, back) {
  context.beginPath();
  context.arc(x, y, 3.6, 0, 2 * Math.PI);
  context.fillStyle = back;
  context.fill();
  context.strokeStyle = colour;
  context.lineWidth = 1.6;
  context.stroke();
}

function flag(context, x, y, colour, back) {
  context.beginPath();
  context.rect(x - 4, y - 4, 8, 8);
  edge(context, colour, back);
  context.fillStyle = back;
  context.fillRect(x - 3, y - 3, 3, 3);
  context.fillRect(x, y, 3, 3);
}

function edge(context, colour, back) {
  context.fillStyle = colour;
  context.strokeStyle = back;
  context.lineWidth = 1.5;
  context.stroke();
  context.fill();
}
