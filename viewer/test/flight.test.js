import assert from "node:assert/strict";
import { test } from "node:test";
import { countUntil, Flight } from "../src/data/flight.js";

const TIMES = [0, 0.1, 0.3, 0.6];

/** Columns of a flight whose position, velocity and attitude are functions of time. */
function columns(position, velocity, attitude = () => [1, 0, 0, 0]) {
  const rows = TIMES.map((t) => [t, ...position(t), ...velocity(t), ...attitude(t)]);
  return rows[0].map((_, column) => Float64Array.from(rows, (row) => row[column]));
}

function close(actual, expected, tolerance = 1e-12) {
  assert.equal(actual.length, expected.length);
  actual.forEach((value, k) => assert.ok(Math.abs(value - expected[k]) < tolerance, `${actual} is not ${expected}`));
}

test("a cubic path is met everywhere, since the curve between samples is the cubic with their velocities", () => {
  const position = (t) => [1 + 2 * t, 3 * t * t, 5 * t ** 3 - t];
  const velocity = (t) => [2, 6 * t, 15 * t * t - 1];
  const flight = new Flight(columns(position, velocity));
  for (let t = 0; t <= 0.6; t += 0.013) close(flight.at(t).position, position(t));
});

test("samples are met exactly, and before the first and after the last the drone rests", () => {
  const position = (t) => [Math.sin(t), Math.cos(t), t];
  const flight = new Flight(columns(position, () => [1, 2, 3]));
  TIMES.forEach((t) => close(flight.at(t).position, position(t)));
  close(flight.at(-1).position, position(0));
  close(flight.at(9).position, position(0.6));
  close(flight.at(9).velocity, [1, 2, 3]);
});

test("attitude turns at a constant rate about a fixed axis", () => {
  const turn = (t) => [Math.cos(t), 0, 0, Math.sin(t)]; // about z by an angle of 2 t
  const rest = () => [0, 0, 0];
  const flight = new Flight(columns(rest, rest, turn));
  const [w, x, y, z] = turn(0.47);
  close(flight.at(0.47).attitude, [x, y, z, w]);
});

test("a flight of one sample is where it is", () => {
  const flight = new Flight([0, 1, 2, 3, 4, 5, 6, 1, 0, 0, 0].map((value) => Float64Array.of(value)));
  close(flight.at(0).position, [1, 2, 3]);
  close(flight.at(7).position, [1, 2, 3]);
});

test("countUntil counts what is at or before", () => {
  const counts = [-1, 0, 0.05, 0.1, 0.5, 0.6, 7].map((t) => countUntil(TIMES, t));
  assert.deepEqual(counts, [0, 1, 1, 2, 3, 4, 4]);
});
