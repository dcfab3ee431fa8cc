// Where one drone is at any time, between samples too.

import { Quaternion } from "three";

export class Flight {
  /** @param columns what `unpackSamples` gives */
  constructor([time, x, y, z, vx, vy, vz, qw, qx, qy, qz]) {
    this.time = time;
    this.positions = interleave(x, y, z);
    this.velocities = interleave(vx, vy, vz);
    this.attitudes = interleave(qx, qy, qz, qw);
  }

  get end() {
    return this.time[this.time.length - 1];
  }

  /**
   * Position and velocity by a cubic Hermite curve through the samples with their velocities as tangents, attitude
   * (quaternion x, y, z, w) by spherical interpolation. Before the first and after the last sample the drone rests.
   */
  at(t, state = { position: [0, 0, 0], velocity: [0, 0, 0], attitude: [0, 0, 0, 1] }) {
    const { time, positions, velocities, attitudes } = this;
    const k = Math.max(0, Math.min(countUntil(time, t), time.length - 1) - 1);
    const next = Math.min(k + 1, time.length - 1);
    const dt = time[next] - time[k] || 1;
    const s = Math.min(Math.max((t - time[k]) / dt, 0), 1);
    for (let axis = 0; axis < 3; axis++) {
      const [p0, p1] = [positions[3 * k + axis], positions[3 * next + axis]];
      const [v0, v1] = [velocities[3 * k + axis] * dt, velocities[3 * next + axis] * dt];
      state.position[axis] = hermite(p0, v0, p1, v1, s);
      state.velocity[axis] = lerp(velocities[3 * k + axis], velocities[3 * next + axis], s);
    }
    Quaternion.slerpFlat(state.attitude, 0, attitudes, 4 * k, attitudes, 4 * next, s);
    return state;
  }

  speedAt(t) {
    const { velocity } = this.at(t, scratch);
    return Math.hypot(...velocity);
  }
}

const scratch = { position: [0, 0, 0], velocity: [0, 0, 0], attitude: [0, 0, 0, 1] };

/** How many of the ascending `times` are at or before `t`. */
export function countUntil(times, t) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}

export function lerp(a, b, s) {
  return a + (b - a) * s;
}

/** The cubic from p0 to p1 whose slopes over s in [0, 1] are v0 and v1 at the ends. */
export function hermite(p0, v0, p1, v1, s) {
  const rest = 1 - s;
  return rest * rest * ((1 + 2 * s) * p0 + s * v0) + s * s * ((3 - 2 * s) * p1 - rest * v1);
}

function interleave(...columns) {
  const width = columns.length;
  const rows = new Float64Array(columns[0].length * width);
  columns.forEach((column, axis) => column.forEach((value, k) => (rows[k * width + axis] = value)));
  return rows;
}
