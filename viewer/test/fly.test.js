import assert from "node:assert/strict";
import { test } from "node:test";
import { Gamepads, Keyboard, LAYOUTS } from "../src/fly/devices.js";
import { Clock, LiveFlight } from "../src/fly/live_flight.js";

function hold(pad) {
  Object.defineProperty(globalThis, "navigator", { value: { getGamepads: () => [null, pad] }, configurable: true });
  const gamepads = new Gamepads();
  assert.equal(gamepads.find(), pad);
  return gamepads;
}

const pad = (mapping, axes) => ({ index: 1, connected: true, mapping, axes, buttons: [{ pressed: false }] });

test("a gamepad is flown in mode 2, stick up is forward and more throttle", () => {
  const gamepads = hold(pad("standard", [0.5, -1, -0.25, -0.5]));
  assert.equal(gamepads.kind, "gamepad");
  assert.deepEqual(gamepads.sticks(LAYOUTS.gamepad, 0), [-0.25, 0.5, 0.5, 1]);
});

test("a transmitter has its channels in the order AETR", () => {
  const gamepads = hold(pad("", [0.1, 0.2, 0.3, 0.4]));
  assert.equal(gamepads.kind, "transmitter");
  assert.deepEqual(gamepads.sticks(LAYOUTS.transmitter, 0), [0.1, 0.2, 0.4, 0.3]);
});

test("a dead band takes nothing from full deflection, and the throttle has none", () => {
  const gamepads = hold(pad("standard", [0.05, -0.05, 1, 0]));
  assert.deepEqual(gamepads.sticks(LAYOUTS.gamepad, 0.1), [1, 0, 0, 0.05]);
});

test("a gamepad that lies there is not held; a pressed start is told once", () => {
  const lying = pad("standard", [0, 0, 0, -1]);
  const gamepads = hold(lying);
  assert.equal(gamepads.touched, false);
  lying.buttons[0].pressed = true;
  assert.equal(gamepads.touched, true);
  assert.deepEqual([gamepads.started(), gamepads.started()], [true, false]);
});

test("keys move sticks at a pace and let them return", () => {
  const keyboard = new Keyboard();
  assert.equal(keyboard.press("ArrowUp", true), true);
  assert.equal(keyboard.press("KeyX", true), false);
  const slow = keyboard.sticks(0.1)[1];
  assert.ok(slow > 0 && slow < 1);
  assert.deepEqual(keyboard.sticks(10), [0, 1, 0, 0]);
  keyboard.release();
  assert.deepEqual(keyboard.sticks(10), [0, 0, 0, 0]);
});

test("a flight goes through its samples and straight on after them", () => {
  const flight = new LiveFlight();
  flight.take(1, [0, 0, 1, 2, 0, 0, 1, 0, 0, 0]);
  assert.deepEqual(flight.at(5).velocity, [2, 0, 0]);
  flight.take(1.1, [0.2, 0, 1, 2, 0, 0, 1, 0, 0, 0]);
  assert.ok(Math.abs(flight.at(1.05).position[0] - 0.1) < 1e-9);
  assert.ok(Math.abs(flight.at(1.1).position[0] - 0.2) < 1e-9);
  assert.ok(Math.abs(flight.at(1.15).position[0] - 0.3) < 1e-9);
});

test("a step is shown from when it arrives, however late others were", () => {
  const clock = new Clock();
  clock.reset();
  assert.equal(clock.at(3), 0);
  clock.take(0.02, 0.02, 10);
  assert.ok(Math.abs(clock.at(10.01) - 0.01) < 1e-9);
  clock.take(0.04, 0.02, 10.025); // 5 ms late: hardly believed
  assert.ok(Math.abs(clock.at(10.03) - 0.03) < 1e-3);
  assert.ok(clock.at(20) <= 0.06 + 1e-9); // not farther than a step beyond the newest
  clock.take(0, 0.02, 30); // a new race
  assert.ok(Math.abs(clock.at(30) + 0.02) < 1e-9);
});
