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
