// Names of gates and drones, written over the picture at a size that does not change with distance.

const AWAY = 26; // of a drone's label from the drone [px]
const SIZE = 20; // of a drone's label, with the space round it [px]
const SPOTS = [-90, -45, -135, 0, 180, 90].map((degrees) => (degrees * Math.PI) / 180); // where it may be, best first

export class Labels {
  constructor(element) {
    this.element = element;
    this.gates = [];
    this.drones = [];
  }

  load(race, gates) {
    this.element.replaceChildren();
    this.gates = gates.gates.map(({ top }, index) => {
      const label = this.#add("gate-label", String(index + 1));
      if (index === race.first_gate) label.append(start());
      return { label, place: top };
    });
    this.drones = race.drones.map((drone) => ({ drone, label: this.#add("drone-label", String(drone.number)) }));
    this.drones.forEach(({ drone, label }) => label.classList.toggle("ghost", drone.ghost));
  }

  #add(kind, text) {
    const label = document.createElement("div");
    label.className = kind;
    label.textContent = text;
    this.element.append(label);
    return label;
  }

  /** @param look (drone) => {hidden, focus, colour, ink} */
  update(stage, places, look) {
    const fixed = this.gates.map(({ label, place }) => ({ label, at: project(place, stage, 14) }));
    const rows = this.drones.map(({ drone, label }, k) => {
      const { hidden, focus, colour, ink } = look(drone);
      label.style.background = colour;
      label.style.color = ink;
      label.classList.toggle("focus", focus);
      return { label, at: hidden ? null : project(places[k], stage) };
    });
    spreadOut(
      rows.filter((row) => row.at),
      fixed.filter((gate) => gate.at),
    );
    [...fixed, ...rows].forEach(({ label, at }) => put(label, at));
  }
}

function start() {
  const word = document.createElement("span");
  word.textContent = "start";
  return word;
}

/** Where a place of the world is on the canvas, `above` pixels higher; null where it cannot be seen. */
export function project(place, { camera, width, height }, above = 0) {
  const at = place.clone().project(camera);
  if (at.z > 1 || at.z < -1 || Math.abs(at.x) > 1.05 || Math.abs(at.y) > 1.15) return null;
  return { x: ((at.x + 1) / 2) * width, y: ((1 - at.y) / 2) * height - above, depth: at.z };
}

/** Every label of a drone goes to the first spot round it that nothing covers, where it can to the one it had. */
function spreadOut(rows, placed) {
  for (const row of rows.sort((a, b) => a.at.depth - b.at.depth)) {
    const spots = [row.label.spot ?? 0, ...SPOTS.keys()];
    const places = spots.map((spot) => ({ spot, ...beside(row.at, SPOTS[spot]) }));
    row.at = places.find((place) => placed.every(({ at }) => apart(at, place))) ?? places[1];
    row.label.spot = row.at.spot;
    placed.push(row);
  }
}

function beside({ x, y }, angle) {
  return { x: x + AWAY * Math.cos(angle), y: y + AWAY * Math.sin(angle) };
}

function apart(a, b) {
  return Math.abs(a.x - b.x) >= SIZE || Math.abs(a.y - b.y) >= SIZE;
}

function put(label, at) {
  label.hidden = !at;
  if (at) label.style.transform = `translate(${at.x.toFixed(1)}px, ${at.y.toFixed(1)}px) translate(-50%, -50%)`;
}
