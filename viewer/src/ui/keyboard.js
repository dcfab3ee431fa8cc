// What keys do; the help overlay is made from the same table.

import { SPEEDS, TRAILS } from "./controls.js";

const KEYS = [
  { keys: [" ", "k"], shown: "Space", says: "play or pause", act: (app) => app.toggle() },
  {
    keys: ["ArrowLeft"],
    shown: "← →",
    says: "a second back or on; with Shift, a sample",
    act: (app, e) => jump(app, e, -1),
  },
  { keys: ["ArrowRight"], act: (app, e) => jump(app, e, 1) },
  { keys: ["Home"], shown: "Home End", says: "to the start, to the end", act: (app) => app.seek(0) },
  { keys: ["End"], act: (app) => app.seek(app.race.duration) },
  {
    keys: ["ArrowDown"],
    shown: "↑ ↓",
    says: "faster, slower",
    act: (app) => app.setSpeed(shift(SPEEDS, app.speed, -1)),
  },
  { keys: ["ArrowUp"], act: (app) => app.setSpeed(shift(SPEEDS, app.speed, 1)) },
  {
    keys: ["e"],
    shown: "e  Shift+e",
    says: "to the next or last overtake, collision or finish",
    act: (app) => app.toEvent(1),
  },
  { keys: ["E"], act: (app) => app.toEvent(-1) },
  {
    keys: ["o"],
    shown: "o c f t",
    says: "cameras: orbit, chase, first-person, top",
    act: (app) => app.setCamera("orbit"),
  },
  { keys: ["c"], act: (app) => app.setCamera("chase") },
  { keys: ["f"], act: (app) => app.setCamera("first-person") },
  { keys: ["t"], act: (app) => app.setCamera("top") },
  { keys: ["r"], shown: "r", says: "the orbit camera back to where it was at first", act: (app) => app.resetCamera() },
  { keys: ["0", "l"], shown: "1 … 9 0", says: "follow a drone, the leader", act: (app) => app.follow(null) },
  ...Array.from({ length: 9 }, (_, k) => ({ keys: [String(k + 1)], act: (app) => app.follow(k) })),
  { keys: ["p"], shown: "p n", says: "the race before, the next race", act: (app) => app.stepRace(-1) },
  { keys: ["n"], act: (app) => app.stepRace(1) },
  {
    keys: ["w"],
    shown: "w",
    says: "length of the trails",
    act: (app) => app.setTrail({ length: cycle(TRAILS, app.trail.length) }),
  },
  {
    keys: ["s"],
    shown: "s",
    says: "colour trails by speed or by drone",
    act: (app) => app.setTrail({ bySpeed: !app.trail.bySpeed }),
  },
  { keys: ["d"], shown: "d", says: "light or dark", act: (app) => app.theme.toggle() },
  { keys: ["h", "?"], shown: "h ?", says: "this help", act: (app) => app.toggleHelp() },
];

const ACTIONS = new Map(KEYS.flatMap(({ keys, act }) => keys.map((key) => [key, act])));

export function listenToKeys(app) {
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || belongsTo(event)) return;
    const act = ACTIONS.get(event.key);
    if (!act || !app.race) return;
    event.preventDefault();
    act(app, event);
  });
}

/** Keys that the focused element needs itself. An open help takes all but those that close it. */
function belongsTo({ target, key }) {
  const help = target.closest?.("dialog");
  if (help) return help.open && !["h", "?"].includes(key); // one that has just closed may still have the focus
  if (target.tagName === "SELECT") return true;
  if (target.type === "range") return ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"].includes(key);
  return target.tagName === "BUTTON" && key === " ";
}

/** Rows of the help overlay. */
export function keyRows() {
  return KEYS.filter(({ says }) => says).map(({ shown, says }) => {
    const row = document.createElement("div");
    const keys = document.createElement("dt");
    keys.append(...shown.split(/\s+/).map((key) => Object.assign(document.createElement("kbd"), { textContent: key })));
    row.append(keys, Object.assign(document.createElement("dd"), { textContent: says }));
    return row;
  });
}

function jump(app, { shiftKey }, direction) {
  if (shiftKey) app.step(direction);
  else app.seek(app.time + direction);
}

function shift(values, value, by) {
  const at = values.indexOf(value) + by;
  return values[Math.min(Math.max(at, 0), values.length - 1)];
}

function cycle(values, value) {
  return values[(values.indexOf(value) + 1) % values.length];
}
