// Where drones are between the steps that have arrived.

import { Quaternion } from "three";
import { hermite, lerp } from "../data/flight.js";

const SETTLE = 0.02; // of a delay that has grown is believed at each step

/** The time of the race as the page shows it: a step that arrives is shown over the time that it lasts. */
export class Clock {
  reset() {
    this.base = null;
    this.newest = 0;
  }

  /** @param t of the race at the end of a step that lasts `dt`  @param now [s] */
  take(t, dt, now) {
    const base = now - (t - dt);
    if (this.base === null || t < this.newest || base < this.base) this.base = base;
    else this.base += SETTLE * (base - this.base);
    this.newest = t;
    this.dt = dt;
  }

  at(now) {
    if (this.base === null) return 0;
    return Math.min(Math.max(now - this.base, this.newest - this.dt), this.newest + this.dt);
  }
}

/** One drone: the two newest samples, a cubic between them, straight on after them. */
export class LiveFlight {
  constructor() {
    this.reset();
  }

  reset() {
    this.older = this.newer = null;
  }

  take(t, [x, y, z, vx, vy, vz, qw, qx, qy, qz]) {
    const sample = { t, position: [x, y, z], velocity: [vx, vy, vz], attitude: [qx, qy, qz, qw] };
    this.older = this.newer && this.newer.t < t ? this.newer : sample;
    this.newer = sample;
  }

  at(t, state = { position: [0, 0, 0], velocity: [0, 0, 0], attitude: [0, 0, 0, 1] }) {
    const { older, newer } = this;
    if (!newer) return state;
    const dt = newer.t - older.t || 1;
    const s = newer.t > older.t ? Math.min(Math.max((t - older.t) / dt, 0), 1) : 1;
    const beyond = Math.max(t - newer.t, 0);
    for (let k = 0; k < 3; k++) {
      const [v0, v1] = [older.velocity[k] * dt, newer.velocity[k] * dt];
      state.position[k] = hermite(older.position[k], v0, newer.position[k], v1, s) + beyond * newer.velocity[k];
      state.velocity[k] = lerp(older.velocity[k], newer.velocity[k], s);
    }
    Quaternion.slerpFlat(state.attitude, 0, older.attitude, 0, newer.attitude, 0, s);
    return state;
  }
}
