// Gates that move, see `Motion` of src/cruise/config.py.

/** A gate as it stands at a time [s]; the gate itself where it stands still. */
export function gateAt(gate, t) {
  return gate.motion ? swayed(gate, Math.sin((2 * Math.PI * t) / gate.motion.period + gate.motion.phase)) : gate;
}

/** A gate at rest and as far as it gets to either side. */
export function poses(gate) {
  return gate.motion ? [-1, 0, 1].map((share) => swayed(gate, share)) : [gate];
}

function swayed(gate, share) {
  const { sway, swing } = gate.motion;
  return { ...gate, position: gate.position.map((x, axis) => x + share * sway[axis]), yaw: gate.yaw + share * swing };
}
