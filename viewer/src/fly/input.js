// Which device is held, and where its sticks are; asked often, told to whoever flies.

import { Gamepads, Keyboard, LAYOUTS, Touch } from "./devices.js";

const PERIOD = 5; // between two looks [ms]
const REPEAT = 50; // sticks that rest are said again so often [ms]
const STEP = 0.002; // what moves less has not moved

export class Input {
  /** @param settings as chosen  @param send called with {n, sticks}  @param start called when a race is to begin */
  constructor(settings, touch, send, start) {
    this.settings = settings;
    this.gamepads = new Gamepads();
    this.keyboard = new Keyboard();
    this.touch = new Touch(...touch);
    this.send = send;
    this.start = start;
    this.device = window.matchMedia("(pointer: coarse)").matches ? "touch" : "keyboard";
    this.sticks = [0, 0, 0, 0];
    this.number = 0;
    this.sent = this.looked = -Infinity;
    window.addEventListener("blur", () => this.keyboard.release());
    setInterval(() => this.#look(performance.now()), PERIOD);
  }

  /** A key went down or up; whether it is a stick. */
  key(code, down) {
    const ours = this.keyboard.press(code, down);
    if (ours && down) this.device = "keyboard";
    return ours;
  }

  get centred() {
    const { throttle } = this.settings.value;
    return throttle === "auto" ? this.device !== "transmitter" : throttle === "centred";
  }

  get layout() {
    return this.settings.value.layouts[this.gamepads.kind] ?? LAYOUTS[this.gamepads.kind];
  }

  #look(now) {
    const dt = Math.min((now - this.looked) / 1000, 0.1);
    this.looked = now;
    const sticks = this.#read(dt);
    const moved = sticks.some((value, k) => Math.abs(value - this.sticks[k]) > STEP);
    if (!moved && now - this.sent < REPEAT) return;
    this.sticks = sticks.map((value) => Number(value.toFixed(4)));
    this.sent = now;
    this.number = (this.number + 1) % 2 ** 31;
    this.send({ n: this.number, sticks: this.sticks });
  }

  #read(dt) {
    const { gamepads } = this;
    if (gamepads.find()) {
      if (gamepads.started()) this.start();
      if (gamepads.touched) this.device = gamepads.kind;
    } else if (this.device === "gamepad" || this.device === "transmitter") this.device = "keyboard";
    if (this.touch.used) {
      this.touch.used = false;
      this.device = "touch";
    }
    if (this.device === "touch") return this.touch.sticks();
    if (this.device === "keyboard") return this.keyboard.sticks(dt);
    return gamepads.sticks(this.layout, this.settings.value.deadband);
  }
}
