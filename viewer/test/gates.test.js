import assert from "node:assert/strict";
import { test } from "node:test";
import { Box3 } from "three";
import { Gates } from "../src/view/gates.js";

const gate = (shape, x, yaw) => ({ shape, position: [x, 0, 2], size: [2, 1.5], yaw, pitch: 0, roll: 0 });

test("gates of every shape stand where they are, and their frames are drawn at once", () => {
  const warned = [];
  console.warn = (text) => warned.push(text);
  const race = { gates: [gate("rectangle", 0, 0), gate("round", 10, Math.PI / 2)], frame_width: 0.3, racers: [] };
  const { group } = new Gates(race);
  assert.deepEqual(warned, []);
  assert.equal(group.children.length, 2 + 3); // a strip of light each, then frames, stilts, arrows
  const { min, max } = new Box3().setFromObject(group.children[2]);
  const near = (found, wanted) => assert.ok(Math.abs(found - wanted) < 0.01, `${found} is not ${wanted}`);
  near(min.x, -0.06); // the first looks along x, so that its frame is thin there
  near(max.x, 10 + 1 + 0.3); // the second along y
  near(min.y, -1 - 0.3);
  near(max.z, 2 + 1 + 0.3);
});

test("a gate that moves is drawn where it is at the time", () => {
  const motion = { period: 4, sway: [0, 1, 0.5], swing: 0, phase: 0 };
  const still = gate("rectangle", 0, 0);
  const gates = new Gates({ gates: [still, { ...still, motion }], frame_width: 0.3, racers: [] });
  const boxes = (t) => {
    gates.update(t, -1);
    gates.group.updateMatrixWorld();
    return gates.group.children.map((child) => new Box3().setFromObject(child));
  };
  const [rest, away] = [boxes(0), boxes(1)];
  // the strips of both, then frames, stilts and arrow of the one that stands still, and of the one that moves
  for (const k of [0, 2, 3, 4]) assert.deepEqual(away[k], rest[k]);
  for (const k of [1, 5, 7])
    assert.ok(Math.abs(away[k].min.y - rest[k].min.y - 1) < 1e-6 && Math.abs(away[k].max.y - rest[k].max.y - 1) < 1e-6);
  assert.ok(Math.abs(away[5].max.z - rest[5].max.z - 0.5) < 1e-6);
  assert.deepEqual([away[6].min.z, away[7].max.z], [0, rest[7].max.z]); // on the ground
  assert.ok(Math.abs(gates.gates[1].top.y - 1) < 1e-9);
});
