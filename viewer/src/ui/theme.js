// Light and dark: what the system prefers until the user says otherwise.

import palette from "../../../src/cruise/palette.json" with { type: "json" };

// How the scene is lit; its colours are those of src/cruise/palette.json.
const LIGHTS = {
  dark: { sky: "#dbe7ff", skyLight: 1.5, sunLight: 1.9, shadow: 0.55, speedScale: [0.22, 1.0] },
  light: { sky: "#ffffff", skyLight: 2.3, sunLight: 1.6, shadow: 0.4, speedScale: [0.0, 0.86] },
};
const SCENES = {
  dark: { ...palette.dark.scene, ...LIGHTS.dark },
  light: { ...palette.light.scene, ...LIGHTS.light },
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
