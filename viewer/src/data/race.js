// One race: its drones, and who is where in the order at any time.

import { countUntil, Flight } from "./flight.js";
import { gateAt } from "./motion.js";
import { unpackSamples } from "./samples.js";

const PAST = 0.45; // the direction of flight is that from here ... [s]
const AHEAD = 0.25; // ... to here, which is smooth where the velocity is not [s]
const STANDING = 0.5; // a drone that moves less than this in between looks to its gate [m]

export class Race {
  /** @param data a race as `pack_race` of src/cruise/viewer/packing.py gives it */
  static async unpack(data) {
    const flights = await Promise.all(data.drones.map((drone) => unpackSamples(drone.samples)));
    return new Race(data, flights);
  }

  constructor(data, columns) {
    Object.assign(this, data);
    this.drones = data.drones.map((drone, index) => ({ ...drone, index, flight: new Flight(columns[index]) }));
    this.racers = this.drones.filter((drone) => !drone.ghost);
    this.topSpeed = Math.max(1, ...this.drones.map((drone) => topSpeed(drone.flight)));
  }

  /** The gate of a crossing number, from 1. */
  gateOf(crossing) {
    return (this.first_gate + crossing - 1) % this.gates.length;
  }

  get crossingsToFinish() {
    return this.laps * this.gates.length + 1;
  }

  /** "flying", "finished", or the way it crashed or ended. */
  statusAt(drone, t) {
    if (drone.finish !== null && t >= drone.finish) return "finished";
    if (drone.crash !== null && t >= drone.crash) return drone.fate;
    return t >= drone.flight.end && t >= this.duration && drone.finish === null ? drone.fate : "flying";
  }

  /** Whether a drone has crashed by now. */
  crashedAt(drone, t) {
    return drone.crash !== null && t >= drone.crash;
  }

  /** One row per racing drone, first to last. Gaps and splits in s, NaN where there is none. */
  standings(t) {
    const rows = this.racers.map((drone) => this.#row(drone, t));
    rows.sort(byOrder);
    const leader = rows[0];
    rows.forEach((row, place) => {
      row.rank = place + 1;
      row.gap = gapTo(leader, row);
    });
    return rows;
  }

  #row(drone, t) {
    const { crossings } = drone;
    const passed = countUntil(crossings, t);
    const state = drone.flight.at(t);
    const next = gateAt(this.gates[this.gateOf(passed + 1)], t).position;
    return {
      drone,
      passed,
      status: this.statusAt(drone, t),
      crashed: this.crashedAt(drone, t),
      finish: drone.finish !== null && t >= drone.finish ? drone.finish : Infinity,
      lap: Math.min(this.laps, Math.max(0, Math.floor((passed - 1) / this.gates.length) + 1)),
      split: passed > 1 ? crossings[passed - 1] - crossings[passed - 2] : NaN,
      last: passed ? crossings[passed - 1] : Infinity,
      toGate: Math.hypot(...next.map((x, axis) => x - state.position[axis])),
      speed: t < drone.flight.end ? Math.hypot(...state.velocity) : 0,
    };
  }

  /** Durations of the laps that a drone has completed by now [s]; the first counts from the start. */
  lapTimes(drone, t) {
    const gates = this.gates.length;
    const ends = [0];
    for (let c = gates; c < drone.crossings.length && drone.crossings[c] <= t; c += gates)
      ends.push(drone.crossings[c]);
    return ends.slice(1).map((end, lap) => end - ends[lap]);
  }

  /** Unit vector [x, y] of the direction in which a drone flies; towards its gate where it stands. */
  headingAt(drone, t) {
    const { flight } = drone;
    const until = Math.min(t + AHEAD, flight.end);
    const from = Math.max(0, Math.min(t - PAST, until - PAST - AHEAD));
    const [a, b] = [flight.at(from).position, flight.at(until).position];
    const way = [b[0] - a[0], b[1] - a[1]];
    const length = Math.hypot(...way);
    if (length < STANDING) {
      const gate = gateAt(this.gates[this.gateOf(countUntil(drone.crossings, t) + 1)], t).position;
      const here = flight.at(t).position;
      const toGate = [gate[0] - here[0], gate[1] - here[1]];
      const distance = Math.hypot(...toGate) || 1;
      const weight = (STANDING - length) / distance;
      way[0] += weight * toGate[0];
      way[1] += weight * toGate[1];
    }
    const norm = Math.hypot(...way) || 1;
    return [way[0] / norm, way[1] / norm];
  }
}

function topSpeed({ velocities }) {
  let best = 0;
  for (let k = 0; k < velocities.length; k += 3) best = Math.max(best, Math.hypot(...velocities.subarray(k, k + 3)));
  return best;
}

/**
 * Finishers by time; then by gates passed; then by who passed the last of them first: places change at gates, and at the
 * end the order is the result. On the grid, who is nearer to the gate comes first.
 */
function byOrder(a, b) {
  if (a.finish !== b.finish) return a.finish - b.finish;
  if (a.passed !== b.passed) return b.passed - a.passed;
  return a.passed ? a.last - b.last : a.toGate - b.toGate;
}

/** How much later a drone passed its last gate than the leader did [s]. */
function gapTo(leader, row) {
  if (row === leader || row.passed === 0) return NaN;
  return row.last - leader.drone.crossings[row.passed - 1];
}
