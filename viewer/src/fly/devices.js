// What a person holds: a gamepad or transmitter, a keyboard, or a screen. Each gives four sticks in [-1, 1]:
// roll right, pitch forward, yaw right, throttle up.

export const CHANNELS = ["roll", "pitch", "yaw", "throttle"];

// Axis and sign of every channel. Gamepads as pilots fly them (mode 2); transmitters in the usual order AETR.
export const LAYOUTS = {
  gamepad: { roll: [2, 1], pitch: [3, -1], yaw: [0, 1], throttle: [1, -1] },
  transmitter: { roll: [0, 1], pitch: [1, 1], yaw: [3, 1], throttle: [2, 1] },
};
const START = [0, 9]; // buttons that begin a race
const MOVED = 0.12; // of an axis, to tell that somebody holds it

export class Gamepads {
  constructor() {
    this.rest = new Map(); // axes as they were first seen, by index of the gamepad
    this.pressed = false;
  }

  /** The gamepad that is held, or null. */
  find() {
    const pads = [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad?.connected && pad.axes.length >= 4);
    for (const pad of pads) if (!this.rest.has(pad.index)) this.rest.set(pad.index, [...pad.axes]);
    this.pad = pads.find(({ index }) => index === this.pad?.index) ?? pads[0] ?? null;
    return this.pad;
  }

  get kind() {
    return this.pad?.mapping === "standard" ? "gamepad" : "transmitter";
  }

  /** Whether an axis has moved since it was first seen, or a button is down. */
  get touched() {
    const rest = this.rest.get(this.pad.index);
    return this.pad.axes.some((axis, k) => Math.abs(axis - rest[k]) > MOVED) || this.pad.buttons.some((b) => b.pressed);
  }

  /** @param layout as in `LAYOUTS`  @param deadband of every stick */
  sticks(layout, deadband) {
    return CHANNELS.map((channel) => {
      const [axis, sign] = layout[channel];
      return beyond(sign * (this.pad.axes[axis] ?? 0), channel === "throttle" ? 0 : deadband);
    });
  }

  /** Whether a button that begins a race has just been pressed. */
  started() {
    const down = this.kind === "gamepad" && START.some((k) => this.pad.buttons[k]?.pressed);
    const now = down && !this.pressed;
    this.pressed = down;
    return now;
  }
}

function beyond(value, deadband) {
  const size = Math.min(Math.abs(value), 1);
  return size <= deadband ? 0 : (Math.sign(value) * (size - deadband)) / (1 - deadband);
}

const KEYS = {
  ArrowRight: [0, 1],
  ArrowLeft: [0, -1],
  ArrowUp: [1, 1],
  ArrowDown: [1, -1],
  KeyD: [2, 1],
  KeyA: [2, -1],
  KeyW: [3, 1],
  KeyS: [3, -1],
};
const PUSH = 5; // how fast a key moves a stick [1/s]
const RETURN = 9; // how fast it returns [1/s]

export class Keyboard {
  constructor() {
    this.down = new Set();
    this.values = [0, 0, 0, 0];
  }

  /** Whether the key is one of ours. */
  press(code, down) {
    if (!(code in KEYS)) return false;
    if (down) this.down.add(code);
    else this.down.delete(code);
    return true;
  }

  release() {
    this.down.clear();
  }

  /** @param dt since the last call [s] */
  sticks(dt) {
    const wanted = [0, 0, 0, 0];
    for (const code of this.down) wanted[KEYS[code][0]] += KEYS[code][1];
    this.values = this.values.map((value, k) => {
      const step = (wanted[k] ? PUSH : RETURN) * dt;
      return value + Math.min(Math.max(wanted[k] - value, -step), step);
    });
    return this.values;
  }
}

/** Two round fields under the thumbs: left yaw and throttle, right roll and pitch. */
export class Touch {
  constructor(left, right) {
    this.values = [0, 0, 0, 0];
    this.#listen(left, 2, 3);
    this.#listen(right, 0, 1);
  }

  #listen(field, across, up) {
    const move = (event) => {
      if (!field.hasPointerCapture(event.pointerId)) return;
      const box = field.getBoundingClientRect();
      const reach = box.width / 2;
      this.values[across] = limit((event.clientX - box.left - reach) / (0.8 * reach));
      this.values[up] = limit((box.top + reach - event.clientY) / (0.8 * reach));
    };
    const end = () => (this.values[across] = this.values[up] = 0);
    field.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      field.setPointerCapture(event.pointerId);
      this.used = true;
      move(event);
    });
    field.addEventListener("pointermove", move);
    for (const kind of ["pointerup", "pointercancel"]) field.addEventListener(kind, end);
  }

  sticks() {
    return this.values;
  }
}

function limit(value) {
  return Math.min(Math.max(value, -1), 1);
}
