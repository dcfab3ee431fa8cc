// What a person has chosen, kept by the browser for every vehicle, and the form to choose it by.

import { CHANNELS, LAYOUTS } from "./devices.js";

const KEY = "cruise-fly";
const AXES = 8;
const OWN = {
  name: "",
  uptilt: 15, // of the camera [deg]
  fov: 105, // across the picture [deg]
  throttle: "auto",
  deadband: 0.04,
  volume: 0.5,
  layouts: {},
};

// Of the form: lowest, highest and step of every number.
const NUMBERS = {
  tilt: [5, 80, 1],
  speed: [0.5, 40, 0.5],
  uptilt: [-20, 70, 1],
  fov: [50, 150, 1],
  deadband: [0, 0.3, 0.01],
  volume: [0, 1, 0.05],
};
const RATE_RANGES = [
  [0, 2000],
  [0, 2000],
  [0, 1],
];

export class Settings {
  constructor() {
    this.value = { ...OWN };
    this.changed = () => {};
  }

  /** Those of a vehicle: what was chosen for it, or what is usual. */
  load({ name, usual, modes }) {
    this.vehicle = name;
    this.modes = modes;
    const { name: _, centred: __, ...flight } = usual;
    const stored = read();
    this.value = { ...OWN, ...flight, ...stored.own, ...stored[`vehicle ${name}`] };
    if (!modes.includes(this.value.mode)) this.value.mode = usual.mode;
  }

  change(values) {
    Object.assign(this.value, values);
    const stored = read();
    const { mode, rates, tilt, speed, ...own } = this.value;
    write({ ...stored, own, [`vehicle ${this.vehicle}`]: { mode, rates, tilt, speed } });
    this.changed();
  }

  /** What the race is told. */
  message(centred) {
    const { mode, rates, tilt, speed, name } = this.value;
    return { settings: { mode, rates, tilt, speed, centred, name } };
  }

  /** Fill the form with what is chosen, and take what is chosen in it. @param kind "gamepad" or "transmitter" */
  show(form, kind) {
    this.kind = kind;
    form.elements.name.value = this.value.name;
    form.elements.throttle.value = this.value.throttle;
    for (const [id, [min, max, step]] of Object.entries(NUMBERS))
      Object.assign(form.elements[id], { min, max, step, value: this.value[id] });
    this.value.rates.forEach((row, axis) =>
      row.forEach((value, k) => {
        const [min, max] = RATE_RANGES[k];
        Object.assign(form.elements[`rate-${axis}-${k}`], { min, max, step: "any", value });
      }),
    );
    const layout = this.value.layouts[kind] ?? LAYOUTS[kind];
    CHANNELS.forEach((channel) => {
      const options = Array.from({ length: AXES }, (_, k) => new Option(`axis ${k + 1}`, String(k)));
      form.elements[`axis-${channel}`].replaceChildren(...options);
      form.elements[`axis-${channel}`].value = String(layout[channel][0]);
      form.elements[`sign-${channel}`].checked = layout[channel][1] < 0;
    });
    form.oninput = () => this.change(this.#read(form));
  }

  #read(form) {
    const numbers = Object.entries(NUMBERS).map(([id, [min, max]]) => [
      id,
      within(form.elements[id].value, min, max, this.value[id]),
    ]);
    const rates = this.value.rates.map((row, axis) =>
      row.map((old, k) => within(form.elements[`rate-${axis}-${k}`].value, ...RATE_RANGES[k], old)),
    );
    const layout = Object.fromEntries(
      CHANNELS.map((channel) => [
        channel,
        [Number(form.elements[`axis-${channel}`].value), form.elements[`sign-${channel}`].checked ? -1 : 1],
      ]),
    );
    return {
      ...Object.fromEntries(numbers),
      rates,
      name: printable(form.elements.name.value),
      throttle: form.elements.throttle.value,
      layouts: { ...this.value.layouts, [this.kind]: layout },
    };
  }
}

/** Without what a race refuses in a name. */
function printable(text) {
  const plain = text.replace(/\p{Zs}/gu, " ").replace(/[\p{C}\p{Zl}\p{Zp}]/gu, "");
  return [...plain].slice(0, 24).join("");
}

function within(text, low, high, otherwise) {
  const value = text === "" ? NaN : Number(text);
  return Number.isFinite(value) ? Math.min(Math.max(value, low), high) : otherwise;
}

function read() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? {};
  } catch {
    return {}; // a browser may keep nothing
  }
}

function write(value) {
  try {
    localStorage.setItem(KEY, JSON.stringify(value));
  } catch {
    // then it holds until the page is closed
  }
}
