import assert from "node:assert/strict";
import { test } from "node:test";
import { clock, describe, number } from "../src/ui/words.js";

test("times", () => {
  assert.equal(clock(0), "0.00");
  assert.equal(clock(59.994), "59.99");
  assert.equal(clock(59.996), "1:00.00");
  assert.equal(clock(125.5, 1), "2:05.5");
  assert.equal(number(NaN, 2), "–");
  assert.equal(number(0.5, 2, "+"), "+0.50");
});

test("events", () => {
  const said = { collision_flip: "flips over", collision_pole: "hits a pole" };
  const race = { ranking: [1, 0], said };
  const say = (kind, more = {}) => describe(race, { kind, drone: 0, gate: -1, other: -1, ...more });
  assert.equal(say("overtake", { other: 2, gate: 3 }), "Drone 1 overtakes drone 3 at gate 4");
  assert.equal(say("collision_drone", { other: 2 }), "Drones 1 and 3 collide");
  assert.equal(say("collision_drone", { drone: 2, other: 0 }), "Drones 1 and 3 collide");
  assert.equal(say("collision_gate_frame", { gate: 4 }), "Drone 1 hits gate 5");
  assert.equal(say("collision_pole"), "Drone 1 hits a pole");
  assert.equal(say("collision_flip"), "Drone 1 flips over");
  assert.equal(say("finish"), "Drone 1 finishes, place 2");
  assert.equal(say("finish", { drone: 1 }), "Drone 2 finishes first and wins");
});
