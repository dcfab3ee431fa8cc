import assert from "node:assert/strict";
import { test } from "node:test";
import { Race } from "../src/data/race.js";

const GATES = [0, 1].map((k) => ({
  position: [10 * k, 0, 2],
  yaw: 0,
  pitch: 0,
  roll: 0,
  size: [2, 2],
  shape: "rectangle",
}));

/** Drones on the x axis at a speed; two gates, one lap, so three crossings finish. */
function makeRace(drones, more = {}) {
  const rows = drones.map(({ speed }) => [
    [0, 5],
    [-5, -5 + 5 * speed],
    [0, 0],
    [2, 2],
    [speed, speed],
    [0, 0],
    [0, 0],
    [1, 1],
    [0, 0],
    [0, 0],
    [0, 0],
  ]);
  const known = { ghost: false, finish: null, crash: null, fate: "time limit", colour: "#0072B2", pilot: "p" };
  const data = { gates: GATES, first_gate: 1, laps: 1, duration: 5, events: [], ranking: [] };
  return new Race(
    { ...data, drones: drones.map((drone, k) => ({ ...known, number: k + 1, ...drone })), ...more },
    rows.map((columns) => columns.map((values) => Float64Array.from(values))),
  );
}

const order = (race, t) => race.standings(t).map(({ drone }) => drone.number);

test("places: finishers by time, then gates, then who passed the last one first", () => {
  const race = makeRace([
    { speed: 1, crossings: [1, 2] },
    { speed: 2, crossings: [0.9, 2.1] },
    { speed: 3, crossings: [1.2, 1.5, 4], finish: 4 },
    { speed: 4, crossings: [1.1, 1.6, 3], finish: 3 },
  ]);
  assert.deepEqual(order(race, 1), [2, 1, 4, 3]);
  assert.deepEqual(order(race, 2.05), [3, 4, 1, 2]);
  assert.deepEqual(order(race, 3.5), [4, 3, 1, 2]);
  assert.deepEqual(order(race, 5), [4, 3, 1, 2]);
});

test("on the grid, who is nearer to the first gate comes first", () => {
  const race = makeRace([
    { speed: 1, crossings: [] },
    { speed: 2, crossings: [] },
  ]);
  assert.deepEqual(order(race, 1), [2, 1]);
});

test("gaps are taken at the last gate that a drone passed, splits between its last two", () => {
  const race = makeRace([
    { speed: 1, crossings: [1, 2, 3], finish: 3 },
    { speed: 1, crossings: [1.25, 2.75] },
  ]);
  const [leader, second] = race.standings(4);
  assert.ok(Number.isNaN(leader.gap));
  assert.equal(second.gap, 0.75);
  assert.equal(second.split, 1.5);
  assert.deepEqual(race.lapTimes(race.drones[0], 4), [3]);
  assert.deepEqual(race.lapTimes(race.drones[0], 2.9), []);
});

test("a ghost has no place, and who crashed says how", () => {
  const race = makeRace([
    { speed: 1, crossings: [1], crash: 2, fate: "hit a gate" },
    { speed: 2, crossings: [1, 2], ghost: true },
  ]);
  assert.deepEqual(order(race, 3), [1]);
  assert.equal(race.standings(1.9)[0].status, "flying");
  assert.equal(race.standings(2)[0].status, "hit a gate");
});

test("gates follow each other from the one at which the race began", () => {
  const race = makeRace([{ speed: 1, crossings: [] }]);
  assert.deepEqual(
    [1, 2, 3, 4].map((crossing) => race.gateOf(crossing)),
    [1, 0, 1, 0],
  );
  assert.equal(race.crossingsToFinish, 3);
});

test("heading is the direction of flight, and towards the gate for who stands", () => {
  const flying = makeRace([{ speed: 3, crossings: [] }]);
  assert.deepEqual(flying.headingAt(flying.drones[0], 1), [1, 0]);
  const standing = makeRace([{ speed: 0, crossings: [0.5] }]);
  const [x, y] = standing.headingAt(standing.drones[0], 1);
  assert.ok(Math.abs(x - 1) < 1e-9 && Math.abs(y) < 1e-9);
});
