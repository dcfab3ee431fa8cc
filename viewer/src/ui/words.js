// What the page says of events and times.

/** One short sentence about an event of a race. */
export function describe(race, { kind, drone, gate, other }) {
  const who = `Drone ${drone + 1}`;
  if (kind === "overtake") return `${who} overtakes drone ${other + 1} at gate ${gate + 1}`;
  if (kind === "collision_drone") {
    const [a, b] = [drone, other].sort((x, y) => x - y);
    return other < 0 ? `${who} hits a drone` : `Drones ${a + 1} and ${b + 1} collide`;
  }
  if (kind === "collision_gate_frame") return `${who} hits gate ${gate + 1}`;
  if (kind === "crossing") return `${who} passes gate ${gate + 1}`;
  if (kind === "missed_gate") return `${who} misses gate ${gate + 1}`;
  if (kind === "finish") return `${who} finishes${place(race, drone)}`;
  return `${who} ${race.said[kind]}`;
}

function place(race, drone) {
  const rank = race.ranking.indexOf(drone) + 1;
  return rank === 1 ? " first and wins" : `, place ${rank}`;
}

/** "12.34", or "1:02.34" from a minute on. */
export function clock(seconds, decimals = 2) {
  const rounded = Number(seconds.toFixed(decimals));
  if (rounded < 60) return rounded.toFixed(decimals);
  const rest = (rounded % 60).toFixed(decimals);
  return `${Math.floor(rounded / 60)}:${rest.padStart(decimals ? decimals + 3 : 2, "0")}`;
}

/** A number, or a dash where there is none. */
export function number(value, decimals, sign = "") {
  return Number.isFinite(value) ? sign + value.toFixed(decimals) : "–";
}
