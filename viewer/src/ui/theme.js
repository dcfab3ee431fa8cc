// Light and dark: what the system prefers until the user says otherwise. Colours of the scene live here, the rest in CSS.

const SCENES = {
  dark: {
    background: "#0a0e15",
    ground: "#1a2230",
    grid: "#3d4b61",
    gate: "#8793a6",
    gateStrip: "#dfe7f2",
    highlight: "#f0e442",
    arms: "#8b95a5",
    crashed: "#5b6472",
    sky: "#dbe7ff",
    skyLight: 1.5,
    sunLight: 1.9,
    shadow: 0.55,
    speedScale: [0.22, 1.0],
    black: "#ffffff", // a black drone would vanish
  },
  light: {
    background: "#e9edf2",
    ground: "#fbfcfd",
    grid: "#bcc6d2",
    gate: "#77818f",
    gateStrip: "#39424e",
    highlight: "#e6007e",
    arms: "#4d5662",
    crashed: "#9aa3ad",
    sky: "#ffffff",
    skyLight: 2.3,
    sunLight: 1.6,
    shadow: 0.4,
    speedScale: [0.0, 0.86],
    black: "#000000",
  },
};

export class Theme {
  /** @param changed called with the scene's colours, now and after every change */
  constructor(changed) {
    this.changed = changed;
    this.system = window.matchMedia("(prefers-color-scheme: light)");
    this.system.addEventListener("change", () => this.chosen || this.#show());
    this.chosen = null;
    this.#show();
  }

  get name() {
    return this.chosen ?? (this.system.matches ? "light" : "dark");
  }

  get scene() {
    return SCENES[this.name];
  }

  choose(name) {
    if (!(name in SCENES)) throw new Error(`no theme ${name}`);
    this.chosen = name;
    this.#show();
  }

  toggle() {
    this.choose(this.name === "dark" ? "light" : "dark");
  }

  /** The colour of a drone in this scheme, and that of writing on it. */
  colourOf(drone) {
    const colour = drone.colour === "#000000" ? this.scene.black : drone.colour;
    return { colour, ink: luminance(colour) > 0.22 ? "#0a0e15" : "#ffffff" };
  }

  #show() {
    document.documentElement.dataset.theme = this.name;
    this.changed(this);
  }
}

/** Relative luminance of "#rrggbb", as in the WCAG. */
function luminance(colour) {
  const parts = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255);
  const [red, green, blue] = parts.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
}
